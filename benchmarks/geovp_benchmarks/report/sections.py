"""The chapters of the report."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from geovp_benchmarks import plots
from geovp_benchmarks.analysis import confidence as confidences
from geovp_benchmarks.report.markup import Html, fold, image, joined, table, tag
from geovp_benchmarks.results.store import Cell, Results
from geovp_benchmarks.results.stored_facts import MARKS, data_name, higher_is_better, summary, title
from geovp_benchmarks.tables.explanation import flat
from geovp_benchmarks.tables.table_model import Column, Row, Table

CURVES = ("horizon", "samples")
FOLDED = ("Confidence", "Methods", "Protocol")
MEMORY = (
    "memory: the process's highest resident memory while it predicted the method's clips, metrics "
    "not counted; what it "
    "held at that time because of other methods is in it (libraries, networks, memory not yet "
    "given back to the system)."
)


@dataclass(frozen=True)
class EmbeddedFigure:
    """A figure as a file inside the page."""

    kind: str
    subject: str  # the metric or the clip
    element: Html

    @classmethod
    def all(cls, drawn: Iterable[tuple[plots.Page, Mapping[Path, bytes]]]) -> list[Self]:
        """Line plots as svg, from the figures' files; the page has films in place of film
        strips.
        """
        return [
            cls(page.kind, page.subject, image(content, "svg", page.caption))
            for page, files in drawn
            for path, content in files.items()
            if page.kind in (*CURVES, "paths") and path.suffix == ".svg"
        ]


def chapter(title: str, content: Html) -> Html:
    """A chapter that folds; those that few read come folded."""
    is_open = {} if title in FOLDED else {"open": ""}
    return tag(
        "section",
        tag("details", tag("summary", tag("h2", title)), content, **is_open),
        id=_anchor(title),
    )


def opening(protocol: Mapping[str, Any], cells: Sequence[Cell], chapters: Iterable[str]) -> Html:
    """The title, a summary of protocol and statuses, and links to the chapters."""
    counts = Counter(cell.status for cell in cells)
    statuses = ", ".join(f"{count} {status}" for status, count in counts.items())
    links = (tag("a", title, href=f"#{_anchor(title)}") for title in chapters)
    box = tag(
        "input",
        type="search",
        id="filter",
        placeholder="filter methods by name",
        aria_label="filter methods by name",
    )
    lead = tag("p", f"{summary(protocol)}. Methods: {statuses}.")
    return tag("header", tag("h1", str(protocol["name"])), lead, tag("nav", *links, box))


def scores(built: Sequence[Table], compared: Table | None = None) -> Html:
    """The main table with its notes, and differences where asked for; the tables over sets of
    pixels are folded.
    """
    main, *others = built
    differences = (
        []
        if compared is None
        else [tag("p", compared.title), _scores(compared), _notes(compared.notes[1:])]
    )
    notes = fold("Notes", _notes(main.notes))
    return joined(
        (
            _scores(main),
            notes,
            *differences,
            *(fold(other.title, _scores(other)) for other in others),
        )
    )


def horizon(figures: Sequence[EmbeddedFigure]) -> Html:
    """Curves of whole frames and poses and over samples in pairs; those over sets of pixels are
    folded.
    """
    curves = [figure for figure in figures if figure.kind in CURVES]
    whole = [figure.element for figure in curves if "@" not in figure.subject]
    apart = [figure.element for figure in curves if "@" in figure.subject]
    pairs = [tag("div", *elements, class_="pairs") for elements in (whole, apart) if elements]
    return joined((*pairs[: bool(whole)], fold("Over sets of pixels", *pairs[bool(whole) :])))


def confidence(results: Results) -> Html:
    """How well each row's confidence ranks its errors in the first frame metric; nothing without
    confidences.
    """
    abouts = results.protocol()["metrics"]
    frame = (name for name, one in abouts.items() if one["role"] == "frame")
    metric = next(
        (name for name in frame if higher_is_better(name, abouts[name]) is not None), None
    )
    found = [] if metric is None else confidences.rankings(results, metric)
    if metric is None or not found:
        return Html("")
    words = f"Spearman correlation with {title(metric)}. " + confidences.NOTE.format(title(metric))
    lines = [one.texts() for one in found]
    return joined((table(confidences.HEAD, lines, [one.label for one in found]), _notes([words])))


def paths(figures: Sequence[EmbeddedFigure]) -> dict[str, list[Html]]:
    """The paths of each kept clip."""
    found: dict[str, list[Html]] = {}
    for figure in figures:
        if figure.kind == "paths":
            found.setdefault(figure.subject, []).append(figure.element)
    return found


def methods(cells: Sequence[Cell], num_clips: int) -> Html:
    """Status, time, memory and settings of each cell."""
    if not cells:
        return Html("")
    stages = list(dict.fromkeys(stage for cell in cells for stage in cell.seconds))
    times = (f"{stage} (s per clip)" for stage in stages)
    head = ("method", tag("th", "status", class_="words"), "clips", *times, "memory (MB)")
    rows = [_method(cell, stages, num_clips) for cell in cells]
    folds = [fold(cell.label, _settings(cell)) for cell in cells if cell.components]
    notes = [MEMORY] if any(_memory_mb(cell) for cell in cells) else []
    return joined(
        (
            table(head, rows, [cell.label for cell in cells]),
            _notes(notes),
            tag("h3", "Settings"),
            *folds,
        )
    )


def protocol(shared: Mapping[str, Any]) -> Html:
    """The settings that all methods share."""
    width_px, height_px = shared["size_px"]
    num_clips = len(shared["clips"])
    rows = {
        "data set": f"{data_name(shared)}: " + "; ".join(_lines(shared["dataset"])),
        "split hash": str(shared["split_hash"]),
        "clips": f"{num_clips}, a new one every {shared['stride']} frames",
        "frames": f"{shared['num_past']} observed, {shared['num_future']} predicted",
        "size": f"{width_px} x {height_px} pixels",
        "versions": ", ".join(f"{name} {version}" for name, version in shared["versions"].items()),
    }
    listed = table(
        (), ((term, tag("td", text, class_="words")) for term, text in rows.items() if text)
    )
    return joined((listed, fold(f"All {num_clips} clips", tag("p", ", ".join(shared["clips"])))))


def _notes(notes: Iterable[str]) -> Html:
    return tag("ul", *(tag("li", note) for note in notes), class_="notes")


def _scores(scored: Table) -> Html:
    head = ("method", "clips", *(column.heading for column in scored.columns))
    rows = (
        (
            tag("td", row.name, tag("sup", f"\u00a0{row.marks}"))
            if row.marks
            else tag("td", row.name),
            scored.clips(row),
            *(_score(scored, row, column) for column in scored.columns),
        )
        for row in scored.rows
    )
    return table(head, rows, [row.name for row in scored.rows])


def _score(scored: Table, row: Row, column: Column) -> Html:
    mean, error = scored.texts(row, column)
    return tag(
        "td",
        tag("b", mean) if scored.is_best(row, column) else mean,
        tag("span", error, class_="error"),
    )


def _method(cell: Cell, stages: Sequence[str], num_clips: int) -> Iterator[str]:
    yield tag("td", cell.label)
    reason = f": {cell.reason}" if cell.reason else ""
    trace = str(cell.record.get("traceback") or "")
    unfolded = fold("traceback", tag("pre", trace)) if trace else Html("")
    yield tag("td", tag("span", cell.status, class_=cell.status), reason, unfolded, class_="words")
    yield f"{cell.num_clips} of {num_clips}"
    for stage in stages:
        known = stage in cell.seconds and cell.num_clips > 0
        yield f"{cell.seconds[stage] / cell.num_clips:.2f}" if known else "-"
    yield f"{_memory_mb(cell):.0f}" if _memory_mb(cell) else "-"


def _memory_mb(cell: Cell) -> float:
    """Return the method's own peak memory, 0 where unknown."""
    return float(cell.record.get("peak_memory_mb", 0.0)) if cell.record.get("peak_is_own") else 0.0


def _settings(cell: Cell) -> Html:
    """The resolved components, in the format of a matrix file."""
    tables_of = {"pose_source": "pose_sources", "renderer": "renderers", "predictor": "predictors"}
    blocks = []
    for role, settings in cell.components.items():
        name = cell.record.get(role) or cell.name
        blocks.append(
            "\n".join([f"[{tables_of.get(role, role)}.{json.dumps(name)}]", *_lines(settings)])
        )
    inputs = ", ".join(MARKS[name][1] for name in cell.privileged_inputs) or "nothing"
    return joined(
        (
            tag("p", f"Privileged inputs: {inputs}."),
            tag("pre", "\n\n".join(blocks)),
        )
    )


def _lines(settings: Mapping[str, Any]) -> Iterator[str]:
    """Lines of TOML with dotted keys."""
    return (f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in flat(settings))


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")
