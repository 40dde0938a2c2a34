"use strict";
const all = (selector, within = document) => [...within.querySelectorAll(selector)];
const byId = (id) => document.getElementById(id);
document.body.classList.add("scripted");

// Hide methods whose name does not contain the typed word; the ground truth stays.
byId("filter").addEventListener("input", (event) => {
  const word = event.target.value.trim().toLowerCase();
  all("[data-method]").forEach((item) => { item.hidden = !item.dataset.method.toLowerCase().includes(word); });
});

// Sort a table by a column: best first, a second click reverses; texts that are not numbers stay last.
const sortBy = (table, head) => {
  const column = head.cellIndex, best = head.dataset.order || "ascending";
  const other = best === "ascending" ? "descending" : "ascending";
  const order = head.getAttribute("aria-sort") === best ? other : best;
  all("thead th", table).forEach((item) => item.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", order);
  const sign = order === "ascending" ? 1 : -1;
  const value = (line) => {
    const text = line.cells[column].textContent.trim();
    return head.dataset.order ? parseFloat(text) : text.toLowerCase();
  };
  const compare = (a, b) => {
    const [x, y] = [value(a), value(b)];
    if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y);
    return x < y ? -sign : x > y ? sign : 0;
  };
  table.tBodies[0].append(...[...table.tBodies[0].rows].sort(compare));
};
all("table.sortable").forEach((table) => {
  const heads = all("thead th", table);
  heads.forEach((head) => {
    head.tabIndex = 0;
    head.title = "sort, best first";
    head.addEventListener("click", () => sortBy(table, head));
    head.addEventListener("keydown", (event) => { if (event.key === "Enter") sortBy(table, head); });
  });
  if (table.closest("#scores") && heads[2]?.dataset.order) sortBy(table, heads[2]);
});

// Open a folded chapter that a link leads to.
const unfold = () => {
  const chapter = location.hash && byId(location.hash.slice(1));
  const fold = chapter && chapter.querySelector(":scope > details");
  if (fold) fold.open = true;
};
addEventListener("hashchange", unfold);
unfold();

// Films: an image holds all frames side by side; the variable --step selects one of them.
const clips = all(".clip");
if (clips.length) {
  const [choice, step, play, when, left, right] = ["clip", "step", "play", "when", "left", "right"].map(byId);
  const films = () => all(".film", clips[choice.selectedIndex]);
  const showStep = () => {
    const k = Number(step.value), seconds = when.dataset.stepS;
    document.body.style.setProperty("--step", k);
    when.textContent = k ? `+${k}` + (seconds ? ` (${(k * seconds).toFixed(1)} s)` : "") : "last observed";
  };
  const showPair = () => {
    const pair = [left, right].map((select) => films()[select.selectedIndex].cloneNode(true));
    byId("compared").replaceChildren(...pair);
  };
  const showClip = () => {
    clips.forEach((clip, i) => { clip.hidden = i !== choice.selectedIndex; });
    [left, right].forEach((select, i) => {
      const name = select.value || select.dataset.first;
      select.replaceChildren(...films().map((film) => new Option(film.dataset.name)));
      const before = films().findIndex((film) => film.dataset.name === name);
      select.selectedIndex = before < 0 ? Math.min(i, films().length - 1) : before;
    });
    showPair();
  };
  const choose = (i) => { choice.selectedIndex = i; showClip(); };
  byId("worst").addEventListener("click", () => choose(0));
  byId("best").addEventListener("click", () => choose(clips.length - 1));
  choice.addEventListener("input", showClip);
  step.addEventListener("input", showStep);
  [left, right].forEach((select) => select.addEventListener("input", showPair));
  byId("inpainted").addEventListener("change", (event) => document.body.classList.toggle("marked", event.target.checked));
  let timer = 0;
  const advance = () => { step.value = (Number(step.value) + 1) % (Number(step.max) + 1); showStep(); };
  play.addEventListener("click", () => {
    timer = timer ? clearInterval(timer) || 0 : setInterval(advance, 1000 * Math.max(0.05, when.dataset.stepS || 0.1));
    play.textContent = timer ? "pause" : "play";
  });
  showStep();
  choose(Math.floor(clips.length / 2));
}
