"""Accuracy of multi-view depth on the synthetic street, which has exact depth.

The measures are those of Eigen et al. 2014: absolute relative error, and the fraction of pixels
whose depth is off by a factor of less than 1.25, for depths up to 80 m, to which estimates are
clipped. All pixels with known depth count, whatever their confidence. Poses are the recorded ones.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.cli.options import add
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import DepthSource
from geovp_classic.types import BoolArray, Clip, FloatArray, Intrinsics, Trajectory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the number of clips."""
    add(parser, "clips", "N", "Number of clips. Default: 8.", 8, nargs="?")


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Yield medians over clips by source and set of pixels."""
    street = {"name": "synthetic", "num_clips": args.clips, "num_frames": 11}
    dataset = registry.build("datasets", street)
    sources = {
        "multiview": {"name": "multiview"},
        "given": {"name": "given"},
    }
    measured: dict[tuple[str, str], list[FloatArray]] = {}
    for number in tracked(range(len(dataset)), len(dataset), progress):
        clip = dataset[number]
        for name, settings in sources.items():
            source = registry.build("depth_sources", settings)
            for pixels, measures in DepthErrors().evaluate(source, clip).items():
                measured.setdefault((name, pixels), []).append(measures)
    lines = [["source", "pixels", "clips", "abs rel", "< 1.25", "confidence"]]
    for (name, pixels), each in measured.items():
        error, fraction, confidence = np.median(each, axis=0)
        texts = [f"{error:.3f}", f"{fraction:.3f}", f"{confidence:.2f}"]
        lines.append([name, pixels, str(len(each)), *texts])
    yield from grid(lines)


@dataclass(frozen=True)
class DepthErrors:
    """Errors of depth on the last observed frame."""

    max_depth_m: float = 80.0
    max_factor: float = 1.25
    epipole_radius_px: float = 32.0

    def evaluate(
        self, source: DepthSource, clip: Clip, num_past: int = 10
    ) -> dict[str, FloatArray]:
        """Return mean error, fraction within the factor and confidence [3] by set of pixels.

        Raises Incompatible for a clip without exact depth or metric poses.
        """
        if clip.depths is None or clip.trajectory is None or not clip.trajectory.is_metric:
            raise Incompatible(f"{clip.name} has no exact depth with metric poses")
        context, _ = clip.split(num_past, source.needs)
        past = clip.trajectory[:num_past]
        inverse_depths, confidences = source.inverse_depths(context, past)
        truth_m = clip.depths[num_past - 1]
        is_known = (truth_m > 0) & (truth_m <= self.max_depth_m)
        depth_m = 1 / np.maximum(inverse_depths[-1], 1 / self.max_depth_m)
        ratio = np.maximum(depth_m, 1e-3) / np.where(is_known, truth_m, 1)
        is_within = np.maximum(ratio, 1 / ratio) < self.max_factor
        measures = np.stack([np.abs(ratio - 1), is_within, confidences[-1]])
        moving = np.zeros(truth_m.shape, bool) if clip.moving is None else clip.moving[num_past - 1]
        sets = self.pixel_sets(moving, clip.intrinsics, past)
        return {
            name: measures[:, is_known & mask].mean(axis=1)
            for name, mask in sets.items()
            if (is_known & mask).any()
        }

    def pixel_sets(
        self, moving: BoolArray, camera: Intrinsics, past: Trajectory
    ) -> dict[str, BoolArray]:
        """Return masks [H, W] of static and moving pixels, and of static ones near the epipole."""
        distance_px = np.full(moving.shape, np.inf)
        center_px = epipole(past, camera)
        if center_px is not None:
            distance_px = np.linalg.norm(pinhole.pixel_grid(camera) - center_px, axis=-1)
        is_near = distance_px < self.epipole_radius_px
        return {
            "static": ~moving,
            "moving": moving,
            "near-epipole": ~moving & is_near,
            "away": ~moving & ~is_near,
        }


def epipole(past: Trajectory, camera: Intrinsics) -> FloatArray | None:
    """Return the epipole [2] of the last two frames in the last one.

    It is None for a stationary camera and for sideways motion.
    """
    last_from_before = se3.inverse(past.world_from_cam[-1]) @ past.world_from_cam[-2]
    ahead = -last_from_before[:3, 3]
    if abs(ahead[2]) <= max(1e-3, 1e-6 * np.linalg.norm(ahead)):
        return None
    return pinhole.project(ahead * np.sign(ahead[2]), camera)[0]  # the same one backwards
