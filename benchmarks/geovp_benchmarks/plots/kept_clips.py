"""Film strips and paths of kept clips."""

import numpy as np

from geovp_benchmarks.plots import strips, style, trajectories
from geovp_benchmarks.plots.material import Material, Page, page, title
from geovp_benchmarks.plots.style import Layout
from geovp_benchmarks.results.store import Method
from geovp_benchmarks.results.stored_facts import higher_is_better
from geovp_classic.types import Clip, FloatArray, Motion, Prediction


def pages(material: Material, number: int, name: str, layout: Layout) -> list[Page]:
    """Draw the figures of one clip; its number keeps file names apart."""
    clip = material.results.clip(name)
    predictions = {
        method.name: material.results.prediction(method.name, name)
        for method in material.methods
        if name in dict(material.results.predictions(method.name))
    }
    file = f"{number:02d}-{name}"
    drawn = _strips(material, clip, predictions, file, layout)
    return drawn + _paths(material, clip, predictions, file, layout)


def notes(material: Material, method: Method, clip: str, num_samples: int) -> list[str]:
    """Return the scores of the first sample on a clip."""
    number = material.protocol["clips"].index(clip)
    lines = [f"sample 1 of {num_samples}"] if num_samples > 1 else []
    for metric, facts in material.protocol["metrics"].items():
        values = material.values(method, metric)[number, 0]
        is_score = facts["role"] == "frame" and higher_is_better(metric, facts) is not None
        if is_score and not np.isnan(values).all():
            lines.append(f"{title(metric)} {np.nanmean(values):#.3g} {facts['unit']}".strip())
    return lines


def horizons(num_future: int, layout: Layout, min_tile_in: float = 0.8) -> list[int]:
    """Return the steps in a film strip: at most five, and as many as fit into the width."""
    steps = [k for k in (1, 5, 10, 15, 20) if k <= num_future] or [num_future]
    if layout.width_in is None:
        return steps
    num_tiles = max(1, int(layout.width_in / min_tile_in) - 1)
    if num_tiles >= len(steps):
        return steps
    places = np.linspace(len(steps) - 1, 0, num_tiles).round().astype(int)
    return [steps[place] for place in places[::-1]]


def _strips(
    material: Material, clip: Clip, predictions: dict[str, Prediction], file: str, layout: Layout
) -> list[Page]:
    past = material.protocol["num_past"]
    shown = horizons(len(clip) - past, layout)
    steps = [k - 1 for k in shown]
    ahead_s = clip.times_s[past:][steps] - clip.times_s[past - 1]
    truth = strips.Truth(clip.frames[past - 1], clip.frames[past:][steps], shown, ahead_s)
    rows = []
    for method in material.methods:
        prediction = predictions.get(method.name)
        if prediction is not None:
            note = "\n".join(notes(material, method, clip.name, len(prediction.frames))[:2])
            covered = None if prediction.covered is None else prediction.covered[0, steps]
            frames = prediction.frames[0, steps]
            note = "" if layout.width_in else note
            rows.append(strips.Strip(method.label, note, frames, covered))
    if not rows:
        return []
    rows = rows[: layout.max_lines]
    means = f"{material.data}; numbers are means over the frames of the clip"
    heading = style.Heading(f"Clip {clip.name}", means)
    figure = strips.draw(truth, rows, heading, layout)
    drawn = [page("strip", file, clip.name, heading, figure)]
    if any(row.covered is not None and not row.covered.all() for row in rows):
        subtitle = f"{material.data}; pink pixels were not observed: inpainted, or left blank"
        heading = style.Heading(f"Clip {clip.name}, inpainted pixels", subtitle)
        marked = [strips.mark_inpainted(row) for row in rows]
        figure = strips.draw(truth, marked, heading, layout)
        drawn.append(page("inpainted", file, clip.name, heading, figure, ("png",)))
    return drawn


def _paths(
    material: Material, clip: Clip, predictions: dict[str, Prediction], file: str, layout: Layout
) -> list[Page]:
    past = material.protocol["num_past"]
    motions: dict[str, Motion] = {}  # one per pose source: its renderers have the same poses
    for method in material.methods:
        prediction = predictions.get(method.name)
        if prediction is not None and prediction.motion is not None:
            motions.setdefault(method.pose_source or method.label, prediction.motion)
    if clip.trajectory is None or not motions:
        return []
    poses = clip.trajectory.world_from_cam
    above = trajectories.from_above(poses, poses[past - 1])
    truth = trajectories.Path("ground truth", above[:past], above[None, past:], style.GROUND_TRUTH)
    styles = style.line_styles([(label, "") for label in motions])
    paths = [
        _path(label, motion, truth.past, line)
        for (label, motion), line in zip(motions.items(), styles, strict=True)
    ]
    subtitle = f"{material.data}, from above, relative to the last observed camera"
    heading = style.Heading(f"Paths of clip {clip.name}", subtitle)
    unit = "m" if clip.trajectory.is_metric else "the ground truth's unit"
    figure = trajectories.draw(truth, paths, unit, heading, layout)
    return [page("paths", file, clip.name, heading, figure)]


def _path(
    label: str, motion: Motion, true_past: FloatArray, line: style.LineStyle
) -> trajectories.Path:
    """Scale a motion of unknown scale to the length of the true past, and say so in its label."""
    last = motion.past.world_from_cam[-1]
    past = trajectories.from_above(motion.past.world_from_cam, last)
    futures = trajectories.from_above(motion.futures, last)
    length, true_length = (
        np.linalg.norm(np.diff(points, axis=0), axis=1).sum() for points in (past, true_past)
    )
    if motion.past.is_metric or length == 0:
        return trajectories.Path(label, past, futures, line)
    scale = true_length / length
    label = f"{label} (scaled to the true path)"
    return trajectories.Path(label, past * scale, futures * scale, line)
