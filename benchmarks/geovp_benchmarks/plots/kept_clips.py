"""Film strips and paths of the clips that were kept."""

from dataclasses import replace

import numpy as np

from geovp_benchmarks.plots import strips, style, trajectories
from geovp_benchmarks.plots.layout import Layout
from geovp_benchmarks.plots.material import Material, Page, numbered, title
from geovp_benchmarks.plots.video import HORIZONS
from geovp_benchmarks.results.store import Cell
from geovp_benchmarks.results.stored_facts import higher_is_better
from geovp_classic.types import Clip, FloatArray, Motion, Prediction


def pages(material: Material, number: int, name: str, layout: Layout) -> list[Page]:
    """The figures of one clip; its number goes into the names of the files, so many images stand
    side by side.
    """
    clip = material.results.clip(name)
    kept = {
        cell.name: material.results.prediction(cell.name, name)
        for cell in material.cells
        if name in dict(material.results.predictions(cell.name))
    }
    file = f"{number:02d}-{name}"
    return _strips(material, clip, kept, file, layout) + _paths(material, clip, kept, file)


def _strips(
    material: Material, clip: Clip, kept: dict[str, Prediction], file: str, layout: Layout
) -> list[Page]:
    past = material.protocol["num_past"]
    future = len(clip) - past
    horizons = [k for k in HORIZONS if k <= future] or [future]
    most = layout.most_tiles
    if most is not None and most <= len(horizons):  # the first, the last, and some between
        at = np.linspace(0, len(horizons) - 1, most - 1) if most > 2 else [len(horizons) - 1]
        horizons = [horizons[round(i)] for i in at]
    steps = [k - 1 for k in horizons]
    ahead_s = clip.times_s[past:][steps] - clip.times_s[past - 1]
    truth = strips.Truth(clip.frames[past - 1], clip.frames[past:][steps], horizons, ahead_s)
    cells = [cell for cell in material.cells if cell.name in kept]
    rows = [_strip(material, cell, kept[cell.name], clip.name, steps) for cell in cells]
    if not rows:
        return []
    means = f"; the small numbers are means over the {future} frames of this clip"
    if not strips.has_room(truth, rows, layout.width_in):
        rows = [replace(row, note="") for row in rows]
        means = (
            "; of several samples the first"
            if any(len(kept[cell.name].frames) > 1 for cell in cells)
            else ""
        )
    heading = style.Heading(f"Clip {clip.name}", material.data + means)
    pages = numbered(
        "strip", file, clip.name, heading, strips.draw(truth, rows, heading, layout.width_in)
    )
    if any(row.covered is not None and not row.covered.all() for row in rows):
        inpainted = (
            f"{material.data}; pixels in pink were not seen in the past: inpainted, or left blank"
        )
        heading = style.Heading(f"Clip {clip.name}, inpainted pixels", inpainted)
        figures = strips.draw(
            truth, [strips.mark_inpainted(row) for row in rows], heading, layout.width_in
        )
        pages += numbered("inpainted", file, clip.name, heading, figures, ("png",))
    return pages


def _strip(
    material: Material, cell: Cell, prediction: Prediction, clip: str, steps: list[int]
) -> strips.Row:
    """The first sample's frames, with that sample's scores on this clip."""
    covered = None if prediction.covered is None else prediction.covered[0, steps]
    words = "\n".join(notes(material, cell, clip, len(prediction.frames)))
    return strips.Row(cell.label, words, prediction.frames[0, steps], covered)


def notes(material: Material, cell: Cell, clip: str, samples: int) -> list[str]:
    """The first sample's scores on a clip, and out of how many it is."""
    rows = material.rows[cell.name].of_clips((clip,))
    found = [f"sample 1 of {samples}"] if samples > 1 else []
    for metric, facts in material.protocol["metrics"].items():
        values = rows.where(rows.metric.among((metric,)) & (rows.sample == 0)).value
        is_score = facts["role"] == "frame" and higher_is_better(metric, facts) is not None
        if is_score and not np.isnan(values).all():
            found.append(f"{title(metric)} {np.nanmean(values):#.3g} {facts['unit']}".strip())
    return found


def _paths(material: Material, clip: Clip, kept: dict[str, Prediction], file: str) -> list[Page]:
    past = material.protocol["num_past"]
    if clip.trajectory is None:
        return []
    above = trajectories.from_above(
        clip.trajectory.world_from_cam, clip.trajectory.world_from_cam[past - 1]
    )
    truth = trajectories.Path("ground truth", above[:past], above[None, past:], style.GROUND_TRUTH)
    motions: dict[str, Motion] = {}  # one per pose source: its renderers share it
    for cell in material.cells:
        prediction = kept.get(cell.name)
        if prediction is not None and prediction.motion is not None:
            motions.setdefault(cell.pose_source or cell.label, prediction.motion)
    if not motions:
        return []
    styles = style.line_styles([(label, "") for label in motions])
    paths = [
        _path(label, motions[label], truth.past, line)
        for label, line in zip(motions, styles, strict=True)
    ]
    seen = (
        f"{material.data}, from above, in the last observed camera's frame; a mark every 5 frames"
    )
    heading = style.Heading(f"Paths of clip {clip.name}", seen)
    unit = "m" if clip.trajectory.is_metric else "the ground truth's unit"
    figures = trajectories.draw(truth, paths, unit, heading)
    return numbered("paths", file, clip.name, heading, figures)


def _path(
    label: str, motion: Motion, true_past: FloatArray, line: style.LineStyle
) -> trajectories.Path:
    """A motion of unknown scale is scaled to the length of the true past, which its
    label states.
    """
    last = motion.past.world_from_cam[-1]
    past = trajectories.from_above(motion.past.world_from_cam, last)
    futures = trajectories.from_above(motion.futures, last)
    length, true_length = (
        np.linalg.norm(np.diff(points, axis=0), axis=1).sum() for points in (past, true_past)
    )
    if motion.past.is_metric or length == 0:
        return trajectories.Path(label, past, futures, line)
    scale = true_length / length
    return trajectories.Path(
        f"{label} (scaled to the true path)", past * scale, futures * scale, line
    )
