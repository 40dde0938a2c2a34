"""Accuracy of a depth source on the synthetic street, which has exact depth.

The measures are those of Eigen et al. 2014: absolute relative error, and the fraction of pixels
whose depth is off by a factor of less than 1.25, for depths up to 80 m, to which estimates are
clipped. All pixels with known depth count, whatever their confidence. Poses are the recorded ones.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from geovp.progress import tracked
from geovp_benchmarks.cli.options import option
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import DepthSource
from geovp_classic.types import BoolArray, Clip, FloatArray, Intrinsics, Trajectory

ARGUMENTS = {
    "": {
        "clips N = 8": option("Number of clips.", nargs="?"),
        "--source SPEC = multiview": (
            "Name or TOML table of a component, see `geovp list depth_sources`."
        ),
    }
}


def run(args: argparse.Namespace) -> Iterator[str]:
    """Yield medians over clips by set of pixels."""
    street = {"name": "synthetic", "num_clips": args.clips, "num_frames": 11}
    dataset = registry.build("datasets", street)
    source = registry.build("depth_sources", args.source, "--source")
    measured = defaultdict(list)
    for number in tracked(range(len(dataset))):
        for pixels, measures in evaluate(source, dataset[number]).items():
            measured[pixels].append(measures)
    lines = [["pixels", "clips", "abs rel", "< 1.25", "confidence"]]
    for pixels, each in measured.items():
        error, fraction, confidence = np.median(each, axis=0)
        texts = [f"{error:.3f}", f"{fraction:.3f}", f"{confidence:.2f}"]
        lines.append([pixels, str(len(each)), *texts])
    yield from grid(lines)


def evaluate(
    source: DepthSource,
    clip: Clip,  # with exact depth and metric poses
    max_depth_m: float = 80.0,
    max_factor: float = 1.25,
) -> dict[str, FloatArray]:
    """Return mean error, fraction within the factor and confidence [3] of the last observed frame.

    All frames but the last one are observed. There is an entry for each set of pixels that is not
    empty.
    """
    assert clip.depths is not None
    assert clip.trajectory is not None
    assert clip.moving is not None
    context, _ = clip.split(len(clip) - 1, source.needs)
    past, truth_m, is_moving = clip.trajectory[:-1], clip.depths[-2], clip.moving[-2]
    inverse_depths, confidences = source.inverse_depths(context, past)
    is_known = (truth_m > 0) & (truth_m <= max_depth_m)
    depth_m = 1 / np.maximum(inverse_depths[-1], 1 / max_depth_m)
    ratio = np.maximum(depth_m, 1e-3) / np.where(is_known, truth_m, 1)
    is_within = np.maximum(ratio, 1 / ratio) < max_factor
    measures = np.stack([np.abs(ratio - 1), is_within, confidences[-1]])
    is_near = near_epipole(past, clip.intrinsics)
    sets = {
        "static": ~is_moving,
        "moving": is_moving,
        "near-epipole": ~is_moving & is_near,
        "away": ~is_moving & ~is_near,
    }
    return {
        name: measures[:, is_known & mask].mean(axis=1)
        for name, mask in sets.items()
        if (is_known & mask).any()
    }


def near_epipole(past: Trajectory, camera: Intrinsics, radius_px: float = 32.0) -> BoolArray:
    """Return a mask [H, W] around the epipole of the last two frames in the last one.

    It is empty for a stationary camera and for sideways motion.
    """
    last_from_before = se3.inverse(past.world_from_cam[-1]) @ past.world_from_cam[-2]
    u, v, ahead = camera.matrix @ last_from_before[:3, 3]
    if abs(ahead) <= 1e-3:
        return np.zeros((camera.height_px, camera.width_px), bool)
    return np.linalg.norm(pinhole.pixel_grid(camera) - (u / ahead, v / ahead), axis=-1) < radius_px
