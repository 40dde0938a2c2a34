"""From stored results to figures: which curves, strips and paths there are, and what they are called."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.figure import Figure

from benchmarks import statistics, tables
from benchmarks.plots import curves, strips, style, trajectories
from benchmarks.store import Cell, Results
from geovp_classic.types import Clip, FloatArray, Motion, Prediction

HORIZONS = (1, 5, 10, 15, 20)


@dataclass(frozen=True)
class Page:
    """One figure, ready to be written."""

    name: str  # of the file, without its ending
    kind: str  # "horizon", "strip", "invented" or "paths"
    subject: str  # the metric or the clip
    caption: str
    figure: Figure
    formats: tuple[str, ...] = ("png", "svg")


@dataclass(frozen=True)
class Job:
    """Figures that are drawn together."""

    name: str
    make: Callable[[], list[Page]]

    def draw(self) -> list[Page]:
        """The figures, in the suite's style."""
        with style.settings():
            return self.make()


@dataclass(frozen=True)
class _Material:
    """What all figures of a results folder are drawn from."""

    results: Results
    protocol: dict[str, Any]
    cells: list[Cell]  # with rows
    rows: dict[str, pa.Table]  # by cell
    step_s: float | None

    @property
    def data(self) -> str:
        return str(self.protocol["name"])


@dataclass(frozen=True)
class _Line:
    """One curve of every figure over horizon."""

    label: str
    cell: Cell
    reduce: statistics.Reduction
    stroke: style.Stroke


def jobs(results: Results) -> list[Job]:
    """What there is to draw; BadData when the folder holds no results."""
    material = _material(results)
    over_horizon = [
        Job(title(metric), partial(_curves, material, metric))
        for metric in metrics_of(material.rows.values())
        if "unit" in material.protocol["metrics"].get(metric.partition("@")[0], {})  # else nobody knows what it means
    ]
    by_clip = [
        Job(f"clip {name}", partial(_clip, material, number, name))
        for number, (name, _) in enumerate(results.clips(), 1)
    ]
    return over_horizon + by_clip


def title(metric: str) -> str:
    """A metric's name as a heading."""
    words = tables.title(metric)
    return words[:1].upper() + words[1:]


def metrics_of(tables: Iterable[pa.Table]) -> list[str]:
    """All metrics that have a value, in the order of the rows, those of a pixel set last."""
    known: dict[str, None] = {}
    for rows in tables:
        known |= dict.fromkeys(pc.unique(rows.filter(pc.is_valid(rows["value"]))["metric"]).to_pylist())
    return sorted(known, key=lambda name: name.partition("@")[2])


def _material(results: Results) -> _Material:
    protocol = results.protocol()
    rows = {cell.name: results.scores(cell.name) for cell in results.cells()}
    cells = [cell for cell in results.cells() if len(rows[cell.name])]
    return _Material(results, protocol, cells, rows, _step_s(results, protocol["num_past"]))


def _step_s(results: Results, num_past: int) -> float | None:
    """The seconds between two horizon steps, from the kept clips; None when they differ by more than a tenth."""
    clips = [results.clip(name) for name, _ in results.clips()]
    steps_s = [np.diff(clip.times_s[num_past - 1 :]).mean() for clip in clips]
    if not steps_s or max(steps_s) > 1.1 * min(steps_s):
        return None
    return float(np.mean(steps_s))


# Metric over horizon -------------------------------------------------------------------------------------------------


def _curves(material: _Material, metric: str) -> list[Page]:
    facts = material.protocol["metrics"][metric.partition("@")[0]]
    known = []
    for line in _lines(material.cells, facts["role"]):
        cube = statistics.cube(material.rows[line.cell.name], metric)
        if np.isfinite(cube.values).any():
            known.append((line, statistics.per_step(line.reduce(cube, facts["higher_is_better"]))))
    most = max(int(estimate.count.max()) for _, estimate in known)
    over = f"{material.data}: mean of {most} clip{'s' * (most != 1)}"
    over += ", band ± one standard error over clips" if most > 1 else ""
    words = style.Words(f"{title(metric)} over horizon", over)
    measure = curves.Measure(title(metric), facts["unit"], facts["higher_is_better"], material.step_s)
    figures = curves.draw([_curve(line, estimate, most) for line, estimate in known], measure, words)
    return _pages("horizon", metric, metric, words, figures)


def _curve(line: _Line, estimate: statistics.Estimate, most: int) -> curves.Curve:
    count = int(estimate.count.max())
    label = line.label if count == most else f"{line.label} (only {count} of {most} clips)"
    return curves.Curve(label, np.arange(1.0, len(estimate.mean) + 1), estimate.mean, estimate.error, line.stroke)


def _lines(cells: Sequence[Cell], role: str) -> list[_Line]:
    """One line per cell, or per pose source where the metric does not see the renderer; two where there are samples.

    Colours and dashes do not depend on which of the lines have values, so that all figures agree.
    """
    found: dict[tuple[str, str], tuple[str, Cell, statistics.Reduction]] = {}
    for cell in cells:
        first, second = cell.pose_source or cell.label, cell.renderer or ""
        label = cell.label
        if role == "trajectory":
            label, second = first, ""
        count = cell.num_samples
        mean = label if count == 1 else f"{label}, mean of {count}"
        found.setdefault((first, second), (mean, cell, statistics.mean_of_samples))
        if count > 1:
            best = (f"{label}, best of {count}", cell, statistics.best_of_samples)
            found.setdefault((first, f"{second}, best"), best)
    strokes = style.strokes(list(found))
    return [_Line(*facts, stroke) for facts, stroke in zip(found.values(), strokes, strict=True)]


# Film strips and paths of a kept clip --------------------------------------------------------------------------------


def _clip(material: _Material, number: int, name: str) -> list[Page]:
    clip = material.results.clip(name)
    kept = {
        cell.name: material.results.prediction(cell.name, name)
        for cell in material.cells
        if name in dict(material.results.predictions(cell.name))
    }
    file = f"{number:02d}-{name}"
    return _strips(material, clip, kept, file) + _paths(material, clip, kept, file)


def _strips(material: _Material, clip: Clip, kept: dict[str, Prediction], file: str) -> list[Page]:
    past = material.protocol["num_past"]
    future = len(clip) - past
    horizons = [k for k in HORIZONS if k <= future] or [future]
    steps = [k - 1 for k in horizons]
    ahead_s = clip.times_s[past:][steps] - clip.times_s[past - 1]
    truth = strips.Truth(clip.frames[past - 1], clip.frames[past:][steps], horizons, ahead_s)
    cells = [cell for cell in material.cells if cell.name in kept]
    rows = [_strip(material, cell, kept[cell.name], clip.name, steps) for cell in cells]
    if not rows:
        return []
    means = f"{material.data}; the small numbers are means over the {future} frames of this clip"
    words = style.Words(f"Clip {clip.name}", means)
    pages = _pages("strip", file, clip.name, words, strips.draw(truth, rows, words))
    if any(row.covered is not None and not row.covered.all() for row in rows):
        unseen = f"{material.data}; pixels in pink were not seen in the past: the method invented them"
        words = style.Words(f"Clip {clip.name}, invented pixels", unseen)
        figures = strips.draw(truth, [strips.invented(row) for row in rows], words)
        invented = _pages("invented", file, clip.name, words, figures)
        pages += [replace(page, formats=("png",)) for page in invented]
    return pages


def _strip(material: _Material, cell: Cell, prediction: Prediction, clip: str, steps: list[int]) -> strips.Row:
    """The first sample's frames, with that sample's scores on this clip."""
    rows = material.rows[cell.name]
    rows = rows.filter(pc.and_(pc.equal(rows["clip"], clip), pc.equal(rows["sample"], 0)))
    samples = len(prediction.frames)
    notes = [f"sample 1 of {samples}"] if samples > 1 else []
    for metric, facts in material.protocol["metrics"].items():
        values = rows.filter(pc.equal(rows["metric"], metric))["value"]
        if facts["role"] == "frame" and values.null_count < len(values):
            notes.append(f"{title(metric)} {pc.mean(values).as_py():#.3g} {facts['unit']}".strip())
    covered = None if prediction.covered is None else prediction.covered[0, steps]
    return strips.Row(cell.label, "\n".join(notes), prediction.frames[0, steps], covered)


def _paths(material: _Material, clip: Clip, kept: dict[str, Prediction], file: str) -> list[Page]:
    past = material.protocol["num_past"]
    if clip.trajectory is None:
        return []
    above = trajectories.from_above(clip.trajectory.world_from_cam, clip.trajectory.world_from_cam[past - 1])
    truth = trajectories.Path("ground truth", above[:past], above[None, past:], style.TRUTH_STROKE)
    motions: dict[str, Motion] = {}  # one per pose source: its renderers share it
    for cell in material.cells:
        prediction = kept.get(cell.name)
        if prediction is not None and prediction.motion is not None:
            motions.setdefault(cell.pose_source or cell.label, prediction.motion)
    if not motions:
        return []
    strokes = style.strokes([(label, "") for label in motions])
    paths = [_path(label, motions[label], truth.past, stroke) for label, stroke in zip(motions, strokes, strict=True)]
    seen = f"{material.data}, from above, in the last observed camera's frame; a mark every 5 frames"
    words = style.Words(f"Paths of clip {clip.name}", seen)
    unit = "m" if clip.trajectory.is_metric else "the ground truth's unit"
    figures = trajectories.draw(truth, paths, unit, words)
    return _pages("paths", file, clip.name, words, figures)


def _path(label: str, motion: Motion, true_past: FloatArray, stroke: style.Stroke) -> trajectories.Path:
    """A motion of unknown scale is drawn with the true past's length, and its label says so."""
    last = motion.past.world_from_cam[-1]
    past = trajectories.from_above(motion.past.world_from_cam, last)
    futures = trajectories.from_above(motion.futures, last)
    length, true_length = (np.linalg.norm(np.diff(points, axis=0), axis=1).sum() for points in (past, true_past))
    if motion.past.is_metric or length == 0:
        return trajectories.Path(label, past, futures, stroke)
    scale = true_length / length
    return trajectories.Path(f"{label} (true scale lent)", past * scale, futures * scale, stroke)


def _pages(kind: str, name: str, subject: str, words: style.Words, figures: Sequence[Figure]) -> list[Page]:
    stem = f"{kind}-{re.sub('[^A-Za-z0-9]+', '-', name).strip('-').lower()}"
    caption = f"{words.title}. {words.subtitle}."
    many = len(figures) > 1
    return [Page(stem + f"-{n}" * many, kind, subject, caption, figure) for n, figure in enumerate(figures, 1)]
