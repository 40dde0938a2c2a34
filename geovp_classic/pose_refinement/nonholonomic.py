"""The nonholonomic constraint: future positions follow the direction of motion that past images
show.

Recorded rotations are right to hundredths of a degree over seconds, recorded positions are not:
where satellite navigation is corrected, a recorded car slides sideways or sinks at an angle of half
a degree. A vehicle cannot: its rear axle moves along the vehicle. So a camera on it moves in one
direction of its own frame, apart from the lever arm between camera and axle when it turns
(Scaramuzza 2011). The images of the past show this direction.

Given and expected directions are combined by their variances, both measured on the past: how far
the given poses' directions were from those of the images, and how far these were from the
constraint. Poses that agree with the images stay as they are, and so do those of a hand-held
camera.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement.registration import DIRECTION_SHARE, unrefined
from geovp_classic.types import BoolArray, Context, FloatArray, Motion, PrivilegedInput

LEVER_M, LEVER_DEVIATION_M = 1.0, 0.4  # lever arm: distance of the camera before the rear axle
MODEL_RAD = np.radians(0.1)  # least deviation of the constraint: tyres slip, roads tilt
# standard deviations at which the weight of the constraint halves; far beyond, motion is sideways
# on purpose
OUTLIER_SIGMAS = 15.0
LEAST_M = 1e-6


@dataclass(frozen=True)
class NonholonomicConstraint:
    """Future positions drawn to the direction in which the camera has been moving, in its own
    frame.
    """

    needs = PrivilegedInput.NONE  # nothing: it compares registered poses with the given ones

    def refine(self, context: Context, motion: Motion) -> Motion:
        """The motion with other future positions; unchanged where lengths are not metres or nothing
        moves.
        """
        given = unrefined(motion, "nonholonomic")
        registered = motion.past.world_from_cam
        direction = (
            motion_direction(given.past.world_from_cam, registered)
            if motion.past.is_metric
            else None
        )
        if direction is None:
            return motion
        last_from_cam = se3.inverse(registered[-1]) @ motion.futures
        return motion.refined(
            motion.past,
            registered[-1] @ np.stack([direction.constrain(future) for future in last_from_cam]),
        )


@dataclass(frozen=True)
class MotionDirection:
    """How the camera has been moving, in its own frame."""

    direction: FloatArray  # [3], unit length
    given_error_rad: float  # RMS per axis: given directions of motion against those of the images
    constraint_error_rad: float  # RMS per axis: the images' directions against the constraint

    def constrain(self, reference_from_cam: FloatArray) -> FloatArray:
        """Poses [F, 4, 4] in metres, one after the other, each step turned towards the direction;
        rotations stay.
        """
        if self.given_error_rad == 0 or len(reference_from_cam) == 0:
            return reference_from_cam
        before = np.concatenate([np.eye(4)[None], reference_from_cam[:-1]])
        steps = se3.log(se3.inverse(before) @ reference_from_cam)
        steps[:, :3] += self._correction(steps)
        positions, at = [], np.zeros(3)
        for rotation, step in zip(before[:, :3, :3], se3.exp(steps), strict=True):
            at = at + rotation @ step[:3, 3]
            positions.append(at)
        return se3.compose(reference_from_cam[:, :3, :3], np.stack(positions))

    def _correction(self, steps: FloatArray) -> FloatArray:
        """The correction [F, 3] of the translations of steps [F, 6] (a Kalman update with both
        directions).
        """
        length = np.maximum(np.linalg.norm(steps[:, :3], axis=1), LEAST_M)[:, None]
        turning = np.cross(steps[:, 3:], self.direction)
        off = (_expected(steps, self.direction) - steps[:, :3]) / length
        uncertain = LEVER_DEVIATION_M * turning / length
        own = (MODEL_RAD**2 + self.constraint_error_rad**2) * np.eye(3) + uncertain[
            :, :, None
        ] * uncertain[:, None]
        white = np.linalg.solve(own + self.given_error_rad**2 * np.eye(3), off[..., None])[..., 0]
        distance = (off * white).sum(axis=1, keepdims=True)
        return np.asarray(
            length * self.given_error_rad**2 * white / (1 + distance / OUTLIER_SIGMAS**2)
        )


def motion_direction(
    given: FloatArray,  # [P, 4, 4], any frame
    registered: FloatArray,  # [P, 4, 4], registered to the images; the last one is the same
) -> MotionDirection | None:
    """The direction of motion of past poses in metres; None when they do not move, or for a single
    one.
    """
    was, now = (se3.inverse(poses[-1]) @ poses[:-1] for poses in (given, registered))
    usable = _has_direction(was) & (np.linalg.norm(now[:, :3, 3], axis=1) > LEAST_M)
    if not usable.any():
        return None
    steps = se3.log(se3.inverse(registered[:-1]) @ registered[1:])
    direction = _unit(steps[:, :3].sum(axis=0))
    for _ in range(2):
        direction = _unit((steps[:, :3] - LEVER_M * np.cross(steps[:, 3:], direction)).sum(axis=0))
    steps[:, :3] = _expected(steps, direction)
    expected, at = [], np.eye(4)
    for step in se3.exp(-steps[::-1]):
        at = at @ step
        expected.append(at)
    return MotionDirection(
        direction,
        _rms_angle_rad(was, now, usable),
        _rms_angle_rad(np.stack(expected[::-1]), now, usable),
    )


def _expected(steps: FloatArray, direction: FloatArray) -> FloatArray:
    """The translation [F, 3] of a camera before the axle that goes as far along its direction as
    the steps [F, 6].
    """
    along = steps[:, :3] @ direction
    return np.asarray(along[:, None] * direction + LEVER_M * np.cross(steps[:, 3:], direction))


def _has_direction(reference_from_cam: FloatArray) -> BoolArray:
    length = np.linalg.norm(reference_from_cam[:, :3, 3], axis=1)
    return np.asarray((length > DIRECTION_SHARE * length.max(initial=0.0)) & (length > LEAST_M))


def _rms_angle_rad(one: FloatArray, other: FloatArray, usable: BoolArray) -> float:
    """Root mean square difference of two directions from the reference, per axis."""
    off = _unit(one[usable, :3, 3]) - _unit(other[usable, :3, 3])
    return float(np.sqrt((off**2).sum(axis=1).mean() / 2))


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(
        vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), LEAST_M)
    )
