"""Errors of a whole estimated trajectory: KITTI's drift, absolute and relative pose error.

World frame and unit of an estimate are arbitrary. Each number is therefore stated under an
alignment:

- `origin`: the first estimated pose becomes the first real one; nothing is fitted;
- `scale`: as `origin`, with the scale factor of Umeyama's similarity;
- `se3`: the rigid transform that fits all positions best (Umeyama 1991);
- `sim3`: the similarity that fits all positions best.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.geometry.alignment import umeyama
from geovp_classic.types import FloatArray, IntArray, Trajectory

Alignment = Literal["origin", "scale", "se3", "sim3"]
ALIGNMENTS: tuple[Alignment, ...] = get_args(Alignment)


@dataclass(frozen=True)
class Drift:
    """Mean drift over all segments (KITTI odometry development kit, evaluate_odometry)."""

    # t_rel; NaN if the trajectory is too short for any segment
    translation_percent: float
    rotation_deg_per_100m: float  # r_rel
    num_segments: int

    def __str__(self) -> str:
        if self.num_segments == 0:
            return "too short"
        return f"{self.translation_percent:.2f} % / {self.rotation_deg_per_100m:.3f} deg/100m"


def aligned(estimate: Trajectory, truth: Trajectory, alignment: Alignment) -> Trajectory:
    """Return the estimate in the truth's world and, where a scale is fitted, in its unit."""
    _check_lengths(estimate, truth)
    poses = estimate.world_from_cam.copy()
    positions = truth.world_from_cam[:, :3, 3]
    if alignment in ("scale", "sim3"):
        scale, _ = umeyama(poses[:, :3, 3], positions, with_scale=True)
        poses[:, :3, 3] *= scale
    if alignment in ("origin", "scale"):
        truth_from_estimate = truth.world_from_cam[0] @ se3.inverse(poses[0])
    else:
        _, truth_from_estimate = umeyama(poses[:, :3, 3], positions, with_scale=False)
    return Trajectory(truth_from_estimate @ poses, estimate.times_s, truth.is_metric)


def kitti_drift(
    estimate: Trajectory,
    truth: Trajectory,
    lengths_m: tuple[int, ...] = (100, 200, 300, 400, 500, 600, 700, 800),
    frames_between_starts: int = 10,
) -> Drift:
    """Return the error of the relative motion over segments of the truth, per metre of segment."""
    _check_lengths(estimate, truth)
    if not truth.is_metric:
        raise BadData("KITTI's drift is per metre, but the recorded poses are not in metres")
    steps_m = se3.step_lengths(truth.world_from_cam)
    distance_m = np.append(0.0, np.cumsum(steps_m))
    starts = np.arange(0, len(truth), frames_between_starts)
    errors = []
    for length_m in lengths_m:
        # the first frame farther than the length
        ends = np.searchsorted(distance_m, distance_m[starts] + length_m, side="right")
        has_end = ends < len(truth)
        error = _motion_errors(estimate, truth, starts[has_end], ends[has_end])
        errors.append(np.array(error) / length_m)
    translation, rotation_deg = np.concatenate(errors, axis=1)
    if len(translation) == 0:
        return Drift(np.nan, np.nan, 0)
    return Drift(100 * translation.mean(), 100 * rotation_deg.mean(), len(translation))


def absolute_error_m(estimate: Trajectory, truth: Trajectory) -> FloatArray:
    """Return the distances [T] of aligned positions; their root mean square is the ATE."""
    _check_lengths(estimate, truth)
    offset = estimate.world_from_cam[:, :3, 3] - truth.world_from_cam[:, :3, 3]
    return np.linalg.norm(offset, axis=-1)


def relative_error(
    estimate: Trajectory, truth: Trajectory, num_steps: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Return the RPE over `num_steps` frames: translation and rotation [T - num_steps].

    Translation is in the truth's unit, rotation in degrees. Raises BadData if the trajectories
    differ in length or have no such step.
    """
    _check_lengths(estimate, truth)
    if not 1 <= num_steps < len(truth):
        raise BadData(f"relative pose error over {num_steps} steps, expected 1 to {len(truth) - 1}")
    start = np.arange(len(truth) - num_steps)
    return _motion_errors(estimate, truth, start, start + num_steps)


def root_mean_square(values: FloatArray) -> float:
    """Return the square root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def _motion_errors(
    estimate: Trajectory, truth: Trajectory, start: IntArray, end: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return translation and rotation in degrees [N] between estimated and real motion."""
    estimated, real = (
        se3.inverse(path.world_from_cam[start]) @ path.world_from_cam[end]
        for path in (estimate, truth)
    )
    error = se3.inverse(estimated) @ real
    rotation_deg = np.rad2deg(se3.rotation_angle_rad(error))
    return np.linalg.norm(error[:, :3, 3], axis=-1), rotation_deg


def _check_lengths(estimate: Trajectory, truth: Trajectory) -> None:
    if len(estimate) != len(truth):
        raise BadData(
            f"{len(estimate)} estimated poses for {len(truth)} real ones: give one for each frame"
        )
