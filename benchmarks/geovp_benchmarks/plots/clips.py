"""Film strips and paths of kept clips."""

from collections.abc import Mapping

import numpy as np
from matplotlib.style import context

from geovp.drawing.page import SHEET, Page
from geovp.drawing.strip import draw_strip
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.plots.style import line_styles
from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.store import Method
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Motion, Trajectory


@context(SHEET)
def clip_pages(material: Material, number: int, name: str) -> list[Page]:
    """Draw the figures of one clip; its number keeps file names apart."""
    clip, past = material.results.clips().read(name), material.protocol["num_past"]
    rows, width_in = {"ground truth": clip.frames[past:]}, material.options.width_in
    motions: dict[str, Motion] = {}  # renderers of one pose source have the same poses
    for method, prediction in material.predictions(name, material.shown):
        text = ", ".join(notes(material, method, name)[: 0 if width_in else 3])
        rows[f"{method.label}: {text}".strip(": ")] = prediction.frames[0]
        if prediction.motion:
            motions.setdefault(method.pose_source or method.label, prediction.motion)
    data, pages = stored_facts.data_name(material.protocol), []
    if len(rows) > 1:
        pages.append(Page(f"strip-{number:02d}-{name}", name, f"Clip {name}", data))
        ahead_s = clip.times_s[past:] - clip.times_s[past - 1]
        draw_strip(pages[-1], rows, ahead_s, width_in or 6.8)
    if clip.trajectory and motions:
        pages.append(Page(f"paths-{number:02d}-{name}", name, f"Paths of clip {name}", data))
        _draw_paths(pages[-1], clip.trajectory, past - 1, motions, width_in or 4.8)
    return pages


def notes(material: Material, method: Method, clip: str) -> list[str]:
    """Return the scores of the first sample on a clip."""
    place, notes, num_samples = material.protocol["clips"].index(clip), [], 1
    for metric, facts in material.frame_metrics.items():
        values = material.values(method, metric)
        num_samples = max(num_samples, values.shape[1])
        if np.isfinite(values[place, 0]).any():
            title = stored_facts.title(metric)
            notes.append(f"{title} {np.nanmean(values[place, 0]):#.3g} {facts['unit']}".strip())
    return [f"sample 1 of {num_samples}", *notes] if num_samples > 1 else notes


def _draw_paths(
    page: Page, actual: Trajectory, last: int, motions: Mapping[str, Motion], width_in: float
) -> None:
    """Draw the true and predicted paths from above with equal scales; samples are thin lines.

    Motions of unknown scale cover the true distance in the past.
    """
    (axes,) = page.add_axes(width_in, 0.7 * width_in)
    truth = _from_above(actual.world_from_cam, last)
    lines = {}
    (lines["past"],) = axes.plot(*truth[: last + 1].T, color="0.85", linewidth=3)
    (lines["ground truth"],) = axes.plot(*truth[last:].T, color="black", linewidth=3)
    styles = line_styles([(label, "") for label in motions])
    for (label, motion), line_style in zip(motions.items(), styles, strict=True):
        poses, scale = motion.past.world_from_cam, 1.0
        length = np.linalg.norm(_from_above(poses, last)[0])
        if not motion.past.is_metric and length > 0:
            scale = float(np.linalg.norm(truth[0]) / length)
            label = f"{label} (scaled to the true path)"
        if len(motion.futures) > 1:
            line_style |= {"linewidth": 0.5, "markersize": 2, "alpha": 0.7}
        for future in motion.futures:
            points = scale * _from_above(np.concatenate([poses, future]), last)
            (lines[label],) = axes.plot(*points[last:].T, **line_style, markevery=(5, 5))
    (lines["last observed camera"],) = axes.plot(0, 0, ">", color="black", markersize=8)
    axes.set_aspect("equal", adjustable="datalim")
    unit = "m" if actual.is_metric else "the ground truth's unit"
    axes.set(xlabel=f"forward ({unit})", ylabel=f"left ({unit})")
    page.add_legend(lines)


def _from_above(world_from_cam: FloatArray, last: int) -> FloatArray:
    """Return (forward, left) [N, 2] of cameras [N, 4, 4] in the frame of the last observed one."""
    last_from_cam = se3.inverse(world_from_cam[last]) @ world_from_cam
    return np.stack([last_from_cam[:, 2, 3], -last_from_cam[:, 0, 3]], axis=-1)
