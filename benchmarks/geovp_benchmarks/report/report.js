"use strict";
const all = (selector, within = document) => [...within.querySelectorAll(selector)];
const byId = (id) => document.getElementById(id);
document.body.classList.add("scripted");

// Hide methods whose name does not contain the typed word; the ground truth stays.
// Few methods are shown until the switch is set or a word is typed.
const filter = byId("filter"), everything = byId("all");
const select = () => {
  const word = filter.value.trim().toLowerCase();
  document.body.classList.toggle("all", everything.checked || word !== "");
  all("[data-method]").forEach((item) => { item.hidden = !item.dataset.method.toLowerCase().includes(word); });
};
filter.addEventListener("input", select);
everything.addEventListener("change", select);
const keys = { m: () => everything.click() };
// A key that the focused control uses itself is left to it.
const isTaken = (control, key) => control.matches("input:not([type=checkbox], [type=range]), select")
  || (key === " " && control.matches("input, button, summary, th"))
  || (key.startsWith("Arrow") && control.matches("[type=range]"));
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || isTaken(event.target, event.key)) return;
  if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
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

// The browser of clips: one is shown at a time.
const clips = all(".clip"), choice = byId("clip");
const films = () => all(".film", clips[choice.selectedIndex]);
let showFilms = () => {};
const choose = (i) => {
  choice.selectedIndex = Math.max(0, Math.min(clips.length - 1, i));
  clips.forEach((clip, number) => { clip.hidden = number !== choice.selectedIndex; });
  showFilms();
};
if (clips.length) {
  const move = (steps) => choose(choice.selectedIndex + steps);
  const moves = { worst: () => choose(0), previous: () => move(-1), next: () => move(1), best: () => choose(clips.length - 1) };
  for (const [name, action] of Object.entries(moves)) {
    byId(name).addEventListener("click", action);
    keys[name[0]] = action;
  }
  choice.addEventListener("input", () => choose(choice.selectedIndex));
  byId("worst-clip")?.addEventListener("click", () => choose(0));  // it may have no film
}

// Films: an image holds all frames side by side; the variable --step selects one of them.
if (byId("step")) {
  const [step, play, when, left, right, inpainted] = ["step", "play", "when", "left", "right", "inpainted"].map(byId);
  const showStep = () => {
    const k = Number(step.value), seconds = when.dataset.stepS;
    document.body.style.setProperty("--step", k);
    when.textContent = k ? `+${k}` + (seconds ? ` (${(k * seconds).toFixed(seconds > 0.095 ? 1 : 2)} s)` : "") : "last observed";
  };
  const showPair = () => {
    const pair = [left, right].map((choice) => films()[choice.selectedIndex].cloneNode(true));
    pair.forEach((film) => delete film.dataset.more);
    byId("compared").replaceChildren(...pair);
  };
  showFilms = () => {
    all(".film-bar").forEach((bar) => { bar.hidden = !films().length; });
    if (!films().length) return;
    [left, right].forEach((choice, i) => {
      const name = choice.value || choice.dataset.first;
      choice.replaceChildren(...films().map((film) => new Option(film.dataset.name)));
      const before = films().findIndex((film) => film.dataset.name === name);
      choice.selectedIndex = before < 0 ? Math.min(i, films().length - 1) : before;
    });
    showPair();
  };
  step.addEventListener("input", showStep);
  [left, right].forEach((choice) => choice.addEventListener("input", showPair));
  inpainted.addEventListener("change", () => document.body.classList.toggle("marked", inpainted.checked));
  let timer = 0;
  const advance = () => {
    if (Number(step.value) + Number(step.step) > Number(step.max)) step.value = 0;
    else step.stepUp();
    showStep();
  };
  play.addEventListener("click", () => {
    const pause_ms = 1000 * Number(step.step) * Math.max(0.05, when.dataset.stepS || 0.1);
    timer = timer ? clearInterval(timer) || 0 : setInterval(advance, pause_ms);
    play.textContent = timer ? "pause" : "play";
  });
  keys.ArrowRight = () => { step.stepUp(); showStep(); };
  keys.ArrowLeft = () => { step.stepDown(); showStep(); };
  keys[" "] = () => play.click();
  keys.i = () => inpainted.click();
  showStep();
}
// The first clip that is shown is the worst with films.
if (clips.length) choose(Math.max(0, clips.findIndex((clip) => clip.querySelector(".film"))));
