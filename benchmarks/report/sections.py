"""The chapters of the report."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks import plots, tables
from benchmarks.report.markup import Html, definitions, fold, image, joined, table, tag
from benchmarks.store import Cell, Results

NOTHING = "-"
CURVES = ("horizon", "samples")
OWN_MEMORY = (
    "memory: the process's highest resident memory while it predicted the row's clips, metrics not counted; what it "
    "held at that time because of other rows is in it (libraries, networks, memory not yet given back to the system)."
)
PROCESS_MEMORY = "memory as the process's maximum so far, whatever it did before"


@dataclass(frozen=True)
class Facts:
    """What the chapters are written from."""

    protocol: Mapping[str, Any]
    cells: Sequence[Cell]
    tables: Sequence[tables.Table]

    @classmethod
    def read(cls, results: Results) -> Facts:
        """Everything but images."""
        return cls(results.protocol(), results.cells(), tables.build(results))

    @property
    def num_clips(self) -> int:
        """How many clips a complete cell has been run on."""
        return len(self.protocol["clips"])


@dataclass(frozen=True)
class Drawn:
    """A figure as a file inside the page."""

    kind: str
    group: str  # figures of one metric or clip share it
    element: Html

    @classmethod
    def of(cls, page: plots.Page, files: Mapping[str, bytes]) -> Drawn:
        """Lines as svg, photographs as jpg; taken from the files that were made of the figure, where they are there."""
        ending = "svg" if page.kind in (*CURVES, "paths") else "jpg"
        content = files[ending] if ending in files else plots.rendered(page, ending)
        return cls(page.kind, page.subject, image(content, ending, page.caption))


def chapter(title: str, inside: Html) -> Html:
    """A chapter with its heading."""
    return tag("section", tag("h2", title), inside, id=_anchor(title))


def opening(facts: Facts, chapters: Iterable[str]) -> Html:
    """The title, what this is in two lines, and where to find what."""
    protocol = facts.protocol
    width_px, height_px = protocol["size_px"]
    states = Counter(cell.status for cell in facts.cells)
    statuses = [joined((f"{count} ", tag("span", status, class_=status))) for status, count in states.items()]
    lead = (
        f"{facts.num_clips} clips of {tables.data_name(protocol)}: {protocol['num_past']} frames observed, "
        f"the next {protocol['num_future']} predicted at {width_px} x {height_px} pixels. Methods: "
    )
    links = (tag("a", title, href=f"#{_anchor(title)}") for title in chapters)
    commas = itertools.chain.from_iterable((", ", item) for item in statuses)
    return tag(
        "header",
        tag("h1", str(protocol["name"])),
        tag("p", lead, *list(commas)[1:], ".", class_="lead"),
        tag("nav", *links),
    )


def scores(facts: Facts) -> Html:
    """The main table with its notes, and the tables over sets of pixels behind a click."""
    main, *others = facts.tables
    notes = tag("ul", *(tag("li", note) for note in main.notes), class_="notes")
    return joined((_scores(main), notes, *(fold(other.title, _scores(other)) for other in others)))


def horizon(figures: Sequence[Drawn]) -> Html:
    """Curves over whole frames and poses and over samples in pairs, over sets of pixels behind a click."""
    curves = [figure for figure in figures if figure.kind in CURVES]
    whole = [figure.element for figure in curves if "@" not in figure.group]
    apart = [figure.element for figure in curves if "@" in figure.group]
    pairs = [tag("div", *elements, class_="pairs") for elements in (whole, apart) if elements]
    return joined((*pairs[: bool(whole)], fold("Over sets of pixels", *pairs[bool(whole) :])))


def clips(figures: Sequence[Drawn]) -> Html:
    """Film strip and paths of each kept clip; what was invented behind a click."""
    images = [figure for figure in figures if figure.kind not in CURVES]
    parts = []
    for clip, group in itertools.groupby(images, lambda figure: figure.group):
        of_kind: dict[str, list[Html]] = {"strip": [], "paths": [], "invented": []}
        for figure in group:
            of_kind[figure.kind].append(figure.element)
        shown = (*of_kind["strip"], *of_kind["paths"])
        parts.append(tag("div", tag("h3", clip), *shown, fold("Invented pixels", *of_kind["invented"])))
    return joined(parts)


def methods(facts: Facts) -> Html:
    """Status, time, memory and settings of each cell."""
    stages = list(dict.fromkeys(stage for cell in facts.cells for stage in cell.seconds))
    head = (
        "method",
        tag("th", "status", class_="words"),
        "clips",
        *(f"{stage} (s per clip)" for stage in stages),
        "memory (MB)",
    )
    rows = [_method(cell, stages, facts.num_clips) for cell in facts.cells]
    folds = [fold(cell.label, _settings(cell)) for cell in facts.cells if cell.components]
    notes = tag("ul", *(tag("li", note) for note in _memory_notes(facts.cells)), class_="notes")
    return joined((table(head, rows), notes, tag("h3", "Settings"), *folds) if rows else ())


def protocol(facts: Facts) -> Html:
    """What all methods share."""
    shared = facts.protocol
    width_px, height_px = shared["size_px"]
    pairs = [
        ("data set", f"{tables.data_name(shared)}: " + "; ".join(_flat(shared["dataset"]))),
        ("split hash", str(shared["split_hash"])),
        ("clips", f"{facts.num_clips}, a new one every {shared['stride']} frames"),
        ("frames", f"{shared['num_past']} observed, {shared['num_future']} predicted"),
        ("size", f"{width_px} x {height_px} pixels, centre-cropped to a square and resized"),
        ("versions", ", ".join(f"{name} {version}" for name, version in shared["versions"].items())),
    ]
    names = tag("p", ", ".join(shared["clips"]))
    return joined((definitions(pairs), fold(f"All {facts.num_clips} clips", names)))


def _scores(scored: tables.Table) -> Html:
    head = ("method", "clips", *(_unbroken(column.heading) for column in scored.columns))
    rows = (
        (
            tag("td", row.name, tag("sup", f"\u00a0{row.marks}")) if row.marks else tag("td", row.name),
            str(row.num_clips),
            *(_score(scored, row, column) for column in scored.columns),
        )
        for row in scored.rows
    )
    return table(head, rows)


def _score(scored: tables.Table, row: tables.Row, column: tables.Column) -> Html:
    """Mean and standard error, bold where no complete row is better."""
    mean, error = scored.texts(row, column)
    if mean in ("unavailable", NOTHING):
        return tag("td", mean, class_="unit")
    return tag("td", tag("b", mean) if scored.is_best(row, column) else mean, tag("span", error, class_="error"))


def _method(cell: Cell, stages: Sequence[str], num_clips: int) -> Iterator[str]:
    yield tag("td", cell.label)
    reason = f": {cell.reason}" if cell.reason else ""
    trace = str(cell.record.get("traceback") or "")
    unfolded = fold("traceback", tag("pre", trace)) if trace else Html("")
    yield tag("td", tag("span", cell.status, class_=cell.status), reason, unfolded, class_="words")
    yield f"{cell.num_clips} of {num_clips}"
    for stage in stages:
        known = stage in cell.seconds and cell.num_clips > 0
        yield f"{cell.seconds[stage] / cell.num_clips:.2f}" if known else NOTHING
    memory_mb = float(cell.record.get("peak_memory_mb", 0.0))
    yield f"{memory_mb:.0f}" if memory_mb else NOTHING


def _memory_notes(cells: Sequence[Cell]) -> Iterator[str]:
    """What the column of memory means in which rows."""
    known = [cell for cell in cells if cell.record.get("peak_memory_mb")]
    own = [cell.label for cell in known if cell.record.get("peak_is_own")]
    others = [cell.label for cell in known if not cell.record.get("peak_is_own")]
    if own:
        yield OWN_MEMORY
    if others:
        yield f"{PROCESS_MEMORY}: {', '.join(others)}." if own else f"{PROCESS_MEMORY}."


def _settings(cell: Cell) -> Html:
    """The resolved components, as a matrix file would have them."""
    tables_of = {"pose_source": "pose_sources", "renderer": "renderers", "predictor": "predictors"}
    blocks = []
    for role, settings in cell.components.items():
        name = cell.record.get(role) or cell.name
        blocks.append("\n".join([f"[{tables_of.get(role, role)}.{json.dumps(name)}]", *_flat(settings)]))
    granted = ", ".join(tables.MARKS[grant][1] for grant in cell.grants) or "nothing"
    return joined((tag("p", f"Granted beyond the observed frames: {granted}."), tag("pre", "\n\n".join(blocks))))


def _flat(settings: Mapping[str, Any], above: str = "") -> Iterable[str]:
    """Lines of TOML with dotted keys."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key} = {json.dumps(value, ensure_ascii=False)}"


def _unbroken(heading: str) -> str:
    """The arrow stays with the word before it."""
    return heading.replace(" ↑", "\u00a0↑").replace(" ↓", "\u00a0↓")


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")
