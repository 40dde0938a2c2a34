"""How right a depth source is where depth is known exactly: on static and moving things, near the epipole and away.

The measures are those usual on KITTI (Eigen 2014): absolute relative error and the share of pixels whose depth is off
by a factor of less than 1.25, over depths of at most 80 m, estimates being cut to that. Every pixel of known depth
counts, however unsure the source is of it. Poses are the recorded ones.

`python -m benchmarks.depth_evaluation [CLIPS [SEED]]` prints the table for multi-view depth and its parts on the
synthetic street, 8 clips with seed 0 if nothing else is said.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.commands import command, watched, whole_numbers
from geovp_classic import registry
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import DepthSource
from geovp_classic.types import BoolArray, Clip, FloatArray, Intrinsics, Trajectory

FARTHEST_M = 80.0
NEAREST_M = 1e-3
FACTOR = 1.25
NEAR_PX = 32.0  # from the epipole
STANDING_M = 1e-3  # a step of less has no direction
SOURCES: Mapping[str, Mapping[str, object]] = {
    "multiview": {"name": "multiview"},
    "without ground": {"name": "multiview", "ground": "none"},
    "given": {"name": "given"},
}


@dataclass(frozen=True)
class DepthRow:
    """One clip's last observed frame, one set of pixels."""

    clip: str
    pixels: str  # "static", "moving"; of the static ones "near-epipole" and "away"
    num_pixels: int
    absolute_relative_error: float
    share_within_factor: float  # of 1.25
    confidence: float  # the source's own, mean


def evaluate(source: DepthSource, clips: Iterable[Clip], num_past: int = 10) -> list[DepthRow]:
    """Rows for the last observed frame of every clip; sets without a pixel have none.

    Incompatible for a clip without exact depth or metric poses, or one that lacks what the source needs.
    """
    return [row for clip in clips for row in _rows(source, clip, num_past)]


def pixel_sets(
    moving: BoolArray | None,  # [H, W]
    camera: Intrinsics,
    past: Trajectory,
) -> dict[str, BoolArray]:
    """Masks [H, W] by name; without a mask of moving things all is static, standing still nothing is near."""
    shape = (camera.height_px, camera.width_px)
    moving = np.zeros(shape, dtype=bool) if moving is None else moving
    epipole_px = epipole(past, camera)
    near = np.zeros(shape, dtype=bool)
    if epipole_px is not None:
        near = np.linalg.norm(pinhole.pixel_grid(camera) - epipole_px, axis=-1) < NEAR_PX
    return {"static": ~moving, "moving": moving, "near-epipole": ~moving & near, "away": ~moving & ~near}


def epipole(past: Trajectory, camera: Intrinsics) -> FloatArray | None:
    """The pixel [2] of the last frame towards which the last step went; None for a camera that stood or went aside."""
    if len(past) < 2:
        return None
    last_from_before = se3.inverse(past.world_from_cam[-1]) @ past.world_from_cam[-2]
    ahead = -last_from_before[:3, 3]
    if np.linalg.norm(ahead) < STANDING_M or abs(ahead[2]) < 1e-6 * np.linalg.norm(ahead):
        return None
    pixel, _ = pinhole.project(ahead * np.sign(ahead[2]), camera)  # backward motion has the same one
    return pixel


def errors(
    inverse_depth: FloatArray,  # [H, W] per metre
    depth_m: FloatArray,  # [H, W], 0 = unknown
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Absolute relative error, whether within the factor, and which pixels count, each [H, W]."""
    counted = (depth_m > 0) & (depth_m <= FARTHEST_M)
    truth = np.where(counted, depth_m, 1.0)
    estimate = np.clip(1 / np.maximum(inverse_depth, 1 / FARTHEST_M), NEAREST_M, FARTHEST_M)
    within = np.maximum(estimate / truth, truth / estimate) < FACTOR
    return np.abs(estimate - truth) / truth, np.asarray(within & counted), np.asarray(counted)


def _rows(source: DepthSource, clip: Clip, num_past: int) -> list[DepthRow]:
    if clip.depths is None or clip.trajectory is None or not clip.trajectory.is_metric:
        raise Incompatible(f"{clip.name} has no exact depth with metric poses: evaluate depth on the synthetic data")
    context, _ = clip.split(num_past, source.needs)
    past, last = clip.trajectory[:num_past], num_past - 1
    inverse_depths, confidence = source.inverse_depths(context, past)
    error, within, counted = errors(inverse_depths[last], clip.depths[last])
    moving = None if clip.moving is None else clip.moving[last]
    rows = []
    for name, mask in pixel_sets(moving, clip.intrinsics, past).items():
        chosen = mask & counted
        if chosen.any():
            means = [float(one[chosen].mean()) for one in (error, within, confidence[last])]
            rows.append(DepthRow(clip.name, name, int(chosen.sum()), *means))
    return rows


def table(rows_by_source: Mapping[str, Sequence[DepthRow]]) -> str:
    """Lines of text: per source and set of pixels the medians over clips (a camera that stands sees no parallax)."""
    lines = [f"{'source':<20}{'pixels':<14}{'clips':>6}{'abs rel':>9}{'< 1.25':>8}{'confidence':>12}"]
    for source, rows in rows_by_source.items():
        for name in dict.fromkeys(row.pixels for row in rows):
            own = [row for row in rows if row.pixels == name]
            measures = [(row.absolute_relative_error, row.share_within_factor, row.confidence) for row in own]
            error, within, confidence = np.median(measures, axis=0)
            lines.append(f"{source:<20}{name:<14}{len(own):>6}{error:>9.3f}{within:>8.3f}{confidence:>12.2f}")
    return "\n".join(lines)


@command
def main(arguments: Sequence[str]) -> str:
    """The table."""
    count, seed = whole_numbers(arguments, (8, 0), "[CLIPS [SEED]]")
    dataset = registry.build("datasets", {"name": "synthetic", "num_clips": count, "seed": seed})
    clips = [dataset[i] for i in range(len(dataset))]
    sources = {name: registry.build("depth_sources", dict(spec)) for name, spec in SOURCES.items()}
    rows = {name: evaluate(source, watched(clips, count, name)) for name, source in sources.items()}
    return table(rows)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
