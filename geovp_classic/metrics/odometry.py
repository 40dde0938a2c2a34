"""Errors of a whole estimated trajectory: KITTI's drift per length, absolute and relative pose
error.

Every number is stated under an alignment, because worlds and units of an estimate are arbitrary:

- `origin`: the first estimated pose becomes the first real one, nothing is fitted;
- `scale`: as `origin`, with the one scale factor that Umeyama's similarity finds;
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
KITTI_LENGTHS_M = (100, 200, 300, 400, 500, 600, 700, 800)
KITTI_STEP = 10  # a segment starts at every tenth frame


@dataclass(frozen=True)
class Drift:
    """Mean drift over all segments of the given lengths (KITTI odometry development kit,
    evaluate_odometry).
    """

    translation_percent: float  # t_rel; NaN when the trajectory is too short for any segment
    rotation_deg_per_100m: float  # r_rel
    num_segments: int

    def __str__(self) -> str:
        if self.num_segments == 0:
            return "too short"
        return f"{self.translation_percent:.2f} % / {self.rotation_deg_per_100m:.3f} deg/100m"


def aligned(estimate: Trajectory, truth: Trajectory, how: Alignment) -> Trajectory:
    """The estimate in the truth's world and, where a scale is fitted, in its unit."""
    _check_lengths(estimate, truth)
    scale, poses = 1.0, estimate.world_from_cam.copy()
    if how in ("scale", "sim3"):
        scale, _ = umeyama(poses[:, :3, 3], truth.world_from_cam[:, :3, 3], with_scale=True)
    poses[:, :3, 3] *= scale
    if how in ("origin", "scale"):
        truth_from_estimate = truth.world_from_cam[0] @ se3.inverse(poses[0])
    else:
        _, truth_from_estimate = umeyama(
            poses[:, :3, 3], truth.world_from_cam[:, :3, 3], with_scale=False
        )
    return Trajectory(truth_from_estimate @ poses, estimate.times_s, truth.is_metric)


def kitti_drift(
    estimate: Trajectory,
    truth: Trajectory,
    lengths_m: tuple[int, ...] = KITTI_LENGTHS_M,
) -> Drift:
    """Drift over segments of the truth: relative motion error at their end, per metre
    of segment.
    """
    _check_lengths(estimate, truth)
    distance_m = path_length(truth)
    starts = np.arange(0, len(truth), KITTI_STEP)
    errors = [
        _segment_errors(estimate, truth, distance_m, starts, length_m) for length_m in lengths_m
    ]
    translation, rotation_rad = (np.concatenate(column) for column in zip(*errors, strict=True))
    if not len(translation):
        return Drift(float("nan"), float("nan"), 0)
    return Drift(
        100 * float(translation.mean()),
        100 * float(np.rad2deg(rotation_rad.mean())),
        len(translation),
    )


def absolute_error_m(estimate: Trajectory, truth: Trajectory) -> FloatArray:
    """Distance of positions, step by step [T]; align first. Its root mean square is the ATE."""
    _check_lengths(estimate, truth)
    offset = estimate.world_from_cam[:, :3, 3] - truth.world_from_cam[:, :3, 3]
    return np.linalg.norm(offset, axis=-1)


def relative_error(
    estimate: Trajectory, truth: Trajectory, num_steps: int = 1
) -> tuple[FloatArray, FloatArray]:
    """RPE over `num_steps` frames: translation [T - num_steps] in the truth's unit, rotation in
    degrees.
    """
    _check_lengths(estimate, truth)
    if not 1 <= num_steps < len(truth):
        raise BadData(f"relative pose error over {num_steps} steps, expected 1 to {len(truth) - 1}")
    start = np.arange(len(truth) - num_steps)
    error = _relative_motion_error(estimate, truth, start, start + num_steps)
    return np.linalg.norm(error[:, :3, 3], axis=-1), np.rad2deg(se3.rotation_angle_rad(error))


def path_length(trajectory: Trajectory) -> FloatArray:
    """Distance driven up to each step [T], in the trajectory's unit."""
    steps = np.linalg.norm(np.diff(trajectory.world_from_cam[:, :3, 3], axis=0), axis=-1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def root_mean_square(values: FloatArray) -> float:
    """The square root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def _segment_errors(
    estimate: Trajectory, truth: Trajectory, distance_m: FloatArray, starts: IntArray, length_m: int
) -> tuple[FloatArray, FloatArray]:
    """Translation and rotation error per metre of every segment of one length."""
    ends = np.searchsorted(
        distance_m, distance_m[starts] + length_m, side="right"
    )  # first frame farther than length
    inside = ends < len(truth)
    error = _relative_motion_error(estimate, truth, starts[inside], ends[inside])
    return np.linalg.norm(error[:, :3, 3], axis=-1) / length_m, se3.rotation_angle_rad(
        error
    ) / length_m


def _relative_motion_error(
    estimate: Trajectory, truth: Trajectory, start: IntArray, end: IntArray
) -> FloatArray:
    """inverse(estimated motion) @ real motion from start to end [N, 4, 4]."""
    motions = [
        se3.inverse(path.world_from_cam[start]) @ path.world_from_cam[end]
        for path in (estimate, truth)
    ]
    return se3.inverse(motions[0]) @ motions[1]


def _check_lengths(estimate: Trajectory, truth: Trajectory) -> None:
    if len(estimate) != len(truth):
        raise BadData(
            f"{len(estimate)} estimated poses for {len(truth)} real ones: give one for each frame"
        )
