"""How accurate multi-view depth and its stages are on the synthetic street, whose depth is exact.

The measures are those usual on KITTI (Eigen 2014): absolute relative error and the share of pixels
whose depth is off by a factor of less than 1.25, over depths of at most 80 m, to which estimates
are clipped. Every pixel of known depth counts, whatever its confidence; static, moving,
near-epipole and other pixels are separate rows. Poses are the recorded ones.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.arguments import positive
from geovp_benchmarks.progress import Progress, tracked
from geovp_classic import registry
from geovp_classic.errors import Incompatible
from geovp_classic.interfaces import DepthSource
from geovp_classic.types import BoolArray, Clip, FloatArray, Intrinsics, Trajectory

FARTHEST_M = 80.0
NEAREST_M = 1e-3
FACTOR = 1.25
NEAR_PX = 32.0  # from the epipole
AT_REST_M = 1e-3  # a shorter step has no direction
SOURCES: Mapping[str, Mapping[str, object]] = {
    "multiview": {"name": "multiview"},
    "without ground": {"name": "multiview", "ground": "none"},
    "given": {"name": "given"},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """How many clips of which street."""
    parser.add_argument(
        "clips", nargs="?", type=positive, default=8, metavar="CLIPS", help="how many clips (8)"
    )
    parser.add_argument(
        "seed", nargs="?", type=int, default=0, metavar="SEED", help="of the synthetic street (0)"
    )


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Medians over clips by source and set of pixels."""
    dataset = registry.build(
        "datasets", {"name": "synthetic", "num_clips": chosen.clips, "seed": chosen.seed}
    )
    clips = [dataset[i] for i in range(len(dataset))]
    rows: dict[str, list[DepthRow]] = {name: [] for name in SOURCES}
    pairs = [(name, clip) for name in SOURCES for clip in clips]
    for name, clip in tracked(pairs, len(pairs), progress):
        rows[name] += evaluate(registry.build("depth_sources", dict(SOURCES[name])), clip)
    yield from table(rows)


@dataclass(frozen=True)
class DepthRow:
    """One clip's last observed frame, one set of pixels."""

    pixels: str  # "static", "moving"; of the static ones "near-epipole" and "away"
    num_pixels: int
    absolute_relative_error: float
    share_within_factor: float  # of 1.25
    confidence: float  # the source's own, mean


def evaluate(source: DepthSource, clip: Clip, num_past: int = 10) -> list[DepthRow]:
    """Rows for the last observed frame of a clip; a set without a pixel has none.

    Incompatible for a clip without exact depth or metric poses, or one that lacks what the source
    needs.
    """
    if clip.depths is None or clip.trajectory is None or not clip.trajectory.is_metric:
        raise Incompatible(
            f"{clip.name} has no exact depth with metric poses: evaluate depth on the synthetic "
            "data"
        )
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
            rows.append(DepthRow(name, int(chosen.sum()), *means))
    return rows


def pixel_sets(
    moving: BoolArray | None,  # [H, W]
    camera: Intrinsics,
    past: Trajectory,
) -> dict[str, BoolArray]:
    """Masks [H, W] by name; all static without a mask of moving objects, none near for a camera at
    rest.
    """
    from geovp_classic.geometry import pinhole

    shape = (camera.height_px, camera.width_px)
    moving = np.zeros(shape, dtype=bool) if moving is None else moving
    epipole_px = epipole(past, camera)
    near = np.zeros(shape, dtype=bool)
    if epipole_px is not None:
        near = np.linalg.norm(pinhole.pixel_grid(camera) - epipole_px, axis=-1) < NEAR_PX
    return {
        "static": ~moving,
        "moving": moving,
        "near-epipole": ~moving & near,
        "away": ~moving & ~near,
    }


def epipole(past: Trajectory, camera: Intrinsics) -> FloatArray | None:
    """The epipole [2] of the last two frames, in the last one; None for a camera at rest or in
    sideways motion.
    """
    from geovp_classic.geometry import pinhole, se3  # with scipy, too heavy for --help

    if len(past) < 2:
        return None
    last_from_before = se3.inverse(past.world_from_cam[-1]) @ past.world_from_cam[-2]
    ahead = -last_from_before[:3, 3]
    if np.linalg.norm(ahead) < AT_REST_M or abs(ahead[2]) < 1e-6 * np.linalg.norm(ahead):
        return None
    pixel, _ = pinhole.project(
        ahead * np.sign(ahead[2]), camera
    )  # backward motion has the same one
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


def table(rows_by_source: Mapping[str, Sequence[DepthRow]]) -> Iterator[str]:
    """Lines of text: medians over clips per source and set of pixels."""
    yield f"{'source':<20}{'pixels':<14}{'clips':>6}{'abs rel':>9}{'< 1.25':>8}{'confidence':>12}"
    for source, rows in rows_by_source.items():
        for name in dict.fromkeys(row.pixels for row in rows):
            own = [row for row in rows if row.pixels == name]
            measures = [
                (row.absolute_relative_error, row.share_within_factor, row.confidence)
                for row in own
            ]
            error, within, confidence = np.median(measures, axis=0)
            heads = f"{source:<20}{name:<14}{len(own):>6}"
            yield f"{heads}{error:>9.3f}{within:>8.3f}{confidence:>12.2f}"
