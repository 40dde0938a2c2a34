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
from geovp_classic.pose_refinement.registration import has_direction, unrefined
from geovp_classic.types import (
    BoolArray,
    Context,
    FloatArray,
    Motion,
    PrivilegedInput,
)


@dataclass(frozen=True)
class MotionDirection:
    """The direction in which the camera has been moving, in its own frame."""

    direction: FloatArray  # [3], unit length
    given_error_rad: float  # RMS per axis: given directions of motion against those of the images
    constraint_error_rad: (
        float  # RMS per axis: the images' directions against the constraint
    )


@dataclass(frozen=True)
class NonholonomicConstraint:
    """Future positions drawn to the direction in which the camera has been moving, in its own
    frame.
    """

    lever_m: float = (
        1.0  # lever arm: distance of the camera before the rear axle
    )
    lever_deviation_m: float = 0.4  # standard deviation of the lever arm
    # Standard deviation of the constraint: tyres slip, roads tilt.
    model_deviation_rad: float = 1.75e-3  # 0.1 degrees
    # Standard deviations at which the weight of the constraint halves: sideways motion far beyond
    # is intended.
    outlier_deviations: float = 15.0

    needs = (
        PrivilegedInput.NONE
    )  # it compares registered poses with the given ones

    def refine(self, context: Context, motion: Motion) -> Motion:
        """Return the motion with other future positions; unchanged where lengths are not metres or
        nothing moves.
        """
        given = unrefined(motion, "nonholonomic")
        registered = motion.past.world_from_cam
        direction = self.motion_direction(given.past.world_from_cam, registered)
        if direction is None or not motion.past.is_metric:
            return motion
        last_from_cam = se3.inverse(registered[-1]) @ motion.futures
        futures = [
            self.constrain(future, direction) for future in last_from_cam
        ]
        return motion.refined(motion.past, registered[-1] @ np.stack(futures))

    def motion_direction(
        self,
        given: FloatArray,  # [P, 4, 4], any frame
        registered: FloatArray,  # [P, 4, 4], registered to the images; the last one is the same
    ) -> MotionDirection | None:
        """Return the direction of motion of past poses in metres; None when they do not move, or
        for a single one.
        """
        before, now = (
            se3.inverse(poses[-1]) @ poses[:-1] for poses in (given, registered)
        )
        is_usable = has_direction(before[:, :3, 3]) & now[:, :3, 3].any(axis=1)
        if not is_usable.any():
            return None
        steps = se3.log(se3.inverse(registered[:-1]) @ registered[1:])
        direction = _unit(steps[:, :3].sum(axis=0))
        for _ in range(2):
            levers = self.lever_m * np.cross(steps[:, 3:], direction)
            direction = _unit((steps[:, :3] - levers).sum(axis=0))
        steps[:, :3] = self._expected(steps, direction)
        pose = np.eye(4)
        expected = []
        for step in se3.exp(-steps[::-1]):
            pose = pose @ step
            expected.append(pose)
        return MotionDirection(
            direction,
            _rms_angle_rad(before, now, is_usable),
            _rms_angle_rad(np.stack(expected[::-1]), now, is_usable),
        )

    def constrain(
        self,
        reference_from_cam: FloatArray,  # [F, 4, 4] in metres, one after the other
        motion: MotionDirection,
    ) -> FloatArray:
        """Return the poses with each step turned towards the direction; rotations stay."""
        if motion.given_error_rad == 0 or len(reference_from_cam) == 0:
            return reference_from_cam
        before = np.concatenate([np.eye(4)[None], reference_from_cam[:-1]])
        steps = se3.log(se3.inverse(before) @ reference_from_cam)
        steps[:, :3] += self._correction(steps, motion)
        translations = se3.exp(steps)[:, :3, 3:]
        positions = np.cumsum(
            (before[:, :3, :3] @ translations)[..., 0], axis=0
        )
        return se3.compose(reference_from_cam[:, :3, :3], positions)

    def _correction(
        self,
        steps: FloatArray,  # [F, 6]
        motion: MotionDirection,
    ) -> FloatArray:
        """Return the correction [F, 3] of the translations (a Kalman update with both
        directions).
        """
        lengths = np.maximum(
            np.linalg.norm(steps[:, :3], axis=1, keepdims=True), 1e-6
        )
        errors = (
            self._expected(steps, motion.direction) - steps[:, :3]
        ) / lengths
        lever = (
            self.lever_deviation_m
            * np.cross(steps[:, 3:], motion.direction)
            / lengths
        )
        variance = self.model_deviation_rad**2 + motion.constraint_error_rad**2
        covariance = variance * np.eye(3) + lever[:, :, None] * lever[:, None]
        given_variance = motion.given_error_rad**2
        total = covariance + given_variance * np.eye(3)
        whitened = np.linalg.solve(total, errors[..., None])[..., 0]
        distance = (errors * whitened).sum(axis=1, keepdims=True)
        weight = 1 / (1 + distance / self.outlier_deviations**2)
        return np.asarray(weight * lengths * given_variance * whitened)

    def _expected(self, steps: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the translations [F, 3] of a camera before the axle that moves as far along its
        direction as in the steps [F, 6].
        """
        along = steps[:, :3] @ direction
        levers = self.lever_m * np.cross(steps[:, 3:], direction)
        return np.asarray(along[:, None] * direction + levers)


def _rms_angle_rad(
    poses: FloatArray, others: FloatArray, is_usable: BoolArray
) -> float:
    """Return the RMS difference per axis of directions from the reference."""
    difference = _unit(poses[is_usable, :3, 3]) - _unit(
        others[is_usable, :3, 3]
    )
    return float(np.sqrt((difference**2).sum(axis=1).mean() / 2))


def _unit(vectors: FloatArray) -> FloatArray:
    """Return vectors [..., 3] of unit length."""
    return np.asarray(
        vectors
        / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-6)
    )
