"use strict";
const all = (selector, within = document) => [...within.querySelectorAll(selector)];
const one = (selector) => document.querySelector(selector);
document.body.classList.add("scripted");

// Rows by name, everywhere but the ground truth's.
one("#filter").addEventListener("input", (event) => {
  const word = event.target.value.trim().toLowerCase();
  all("[data-row]").forEach((row) => { row.hidden = !row.dataset.row.toLowerCase().includes(word); });
});

// Tables by a column: best first, then worst first; what is no number stays last.
const value = (row, column) => {
  const text = row.cells[column].textContent.trim();
  return column ? parseFloat(text) : text.toLowerCase();
};
all("table.sortable").forEach((table) => all("thead th", table).forEach((head, column) => {
  head.tabIndex = 0;
  const sort = () => {
    const first = head.textContent.includes("↑") ? "descending" : "ascending";
    const isAgain = head.getAttribute("aria-sort") === first;
    const sign = (first === "ascending") === isAgain ? -1 : 1;
    all("thead th", table).forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const order = (a, b) => {
      const [x, y] = [value(a, column), value(b, column)];
      if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y);
      return x < y ? -sign : x > y ? sign : 0;
    };
    table.tBodies[0].append(...[...table.rows].slice(1).sort(order));
  };
  head.addEventListener("click", sort);
  head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
}));

// A link to a folded chapter opens it.
const unfold = () => {
  const chapter = location.hash && document.getElementById(location.hash.slice(1));
  if (chapter) all("details", chapter).slice(0, 1).forEach((fold) => { fold.open = true; });
};
addEventListener("hashchange", unfold);
unfold();

// Films: every image holds all frames side by side.
const clips = all(".clip");
if (clips.length) {
  const [choice, step, play, when] = ["#clip", "#step", "#play", "#when"].map(one);
  const place = (film, k) => all("img", film).forEach((image) => {
    image.style.transform = `translateX(${(-100 * k) / film.dataset.frames}%)`;
  });
  const ahead = (k) => `+${k}` + (when.dataset.stepS ? ` (${(k * when.dataset.stepS).toFixed(1)} s)` : "");
  const show = () => {
    const k = Number(step.value);
    when.textContent = k ? ahead(k) : "last observed";
    clips.forEach((clip, i) => {
      clip.hidden = i !== choice.selectedIndex;
      if (!clip.hidden) all(".film", clip).forEach((film) => place(film, k));
    });
  };
  const forward = () => { step.value = (Number(step.value) + 1) % (Number(step.max) + 1); show(); };
  let timer = 0;
  play.addEventListener("click", () => {
    timer = timer ? clearInterval(timer) || 0 : setInterval(forward, 1000 * Math.max(0.05, when.dataset.stepS || 0.1));
    play.textContent = timer ? "pause" : "play";
  });
  [choice, step].forEach((control) => control.addEventListener("input", show));
  one("#inpainted").addEventListener("change", (event) => document.body.classList.toggle("marked", event.target.checked));
  all("img", document).filter((image) => image.closest(".film")).forEach((image) => {
    image.style.width = `${100 * image.closest(".film").dataset.frames}%`;
  });
  all(".strips").forEach((strips) => strips.parentElement.addEventListener("toggle", () => {
    if (strips.childElementCount) return;
    const steps = strips.dataset.steps.split(" "), films = all(".film", strips.closest(".clip"));
    const head = document.createElement("div");
    head.append(document.createElement("span"), ...steps.map((k) => {
      const words = document.createElement("b"), film = films[0];
      words.textContent = ahead(k);
      words.style.flex = `0 0 ${film.querySelector("img").naturalWidth / film.dataset.frames}px`;
      return words;
    }));
    strips.append(head);
    films.forEach((film) => {
      const row = document.createElement("div"), name = document.createElement("span");
      name.textContent = film.dataset.name;
      if (film.dataset.row) row.dataset.row = film.dataset.row;
      row.append(name, ...steps.map((k) => {
        const image = film.querySelector("img"), canvas = document.createElement("canvas");
        canvas.width = image.naturalWidth / film.dataset.frames;
        canvas.height = image.naturalHeight;
        canvas.getContext("2d").drawImage(image, -k * canvas.width, 0);
        return canvas;
      }));
      strips.append(row);
    });
    one("#filter").dispatchEvent(new Event("input"));
  }));
  show();
}
