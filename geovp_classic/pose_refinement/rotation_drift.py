"""Errors of recorded rotations: registration shows those of the past, a Gaussian process predicts
those of the future.

A recorded rotation has three errors. A lag: it was taken some milliseconds before or after the
image, the same for all of a recording. Vibration between camera and recorder, independent in every
frame; that of the last frame is in every future pose, since these are relative to it. And a drift
of heading and tilt whose rate is correlated for some time. Together this is one Gaussian process,
white noise and an integrated Ornstein-Uhlenbeck process, with one unknown time. Its expected future
is linear in its registered past (Rasmussen & Williams 2006, eq. 2.23; with an unknown coefficient,
section 2.7). Larger errors are jumps, not drift: see `unmeasured_intervals`.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement.angle_kernels import (
    IntegratedOrnsteinUhlenbeck,
    covariance_of_differences,
)
from geovp_classic.pose_refinement.unmeasured_intervals import (
    IntervalDetector,
    Recording,
    agreement_weight,
    recordings,
)
from geovp_classic.types import (
    BoolArray,
    Context,
    FloatArray,
    Motion,
    PrivilegedInput,
)


@dataclass(frozen=True)
class DriftModel:
    """Error model of the rotation about one axis; standard deviations in seconds, over the rate of
    the drift.
    """

    white_s: float
    time_constant_s: float  # of the correlation of the drift rate
    registration_s: float = 0.4  # white noise of the registration

    def covariance(self, a_s: FloatArray, b_s: FloatArray) -> FloatArray:
        """Return the covariance [N, M] of the errors at times [N] and [M], relative to time 0."""
        drift = IntegratedOrnsteinUhlenbeck(1.0, self.time_constant_s)
        white = self.white_s**2 * (1.0 + np.equal.outer(a_s, b_s))
        return covariance_of_differences(drift, a_s, 0.0, b_s, 0.0) + white

    def observed_covariance(self, past_s: FloatArray) -> FloatArray:
        """Return the covariance [P, P] of past errors with the noise of the registration."""
        return self.covariance(
            past_s, past_s
        ) + self.registration_s**2 * np.eye(len(past_s))


@dataclass(frozen=True)
class RotationDrift:
    """Future poses without the lag and the rotation errors that the errors of past ones predict.

    Poses that do not continue the past get no correction of the lag. Where the last frame lies in
    an unmeasured interval, the weight is what that interval's own correction leaves.
    """

    # Rotations about the camera's x, y and z axis: a car pitches with every bump. Chosen on train
    # and val.
    pitch: DriftModel = DriftModel(0.4, 0.2)
    yaw: DriftModel = DriftModel(0.2, 1.6)
    roll: DriftModel = DriftModel(0.2, 0.4)
    # Standard deviation of the rate at which headings and tilts drift.
    rate_deviation_rad_s: float = 8.7e-4  # 0.05 degrees/s
    lag_deviation_s: float = (
        0.008  # standard deviation of the lag between recordings and images
    )
    # Larger errors of past rotations are jumps, as after an unmeasured interval. They do not
    # continue.
    jump_rad: float = 3.5e-3  # 0.2 degrees
    registration_error_rad: float = 8.7e-4  # 0.05 degrees
    detector: IntervalDetector = field(default_factory=IntervalDetector)

    needs = (
        PrivilegedInput.NONE
    )  # it compares registered poses with the given ones

    def refine(self, context: Context, motion: Motion) -> Motion:
        """Return the motion with other future poses."""
        futures = [
            self._correct(future, recording)
            for future, recording in zip(
                motion.futures, recordings(context, motion), strict=True
            )
        ]
        return motion.refined(motion.past, np.stack(futures))

    def _correct(
        self, world_from_cam: FloatArray, recording: Recording
    ) -> FloatArray:
        """Return the future poses [F, 4, 4] with lag and drift of the recording removed."""
        given = recording.given
        times_s = recording.times_s
        last = recording.last
        is_unmeasured = np.zeros(len(given), bool)
        for interval in self.detector.detect(recording):
            is_unmeasured |= interval.inside(len(given))
        by_lag = (
            _by_lag(given, times_s, last, ~is_unmeasured)
            * recording.is_continuous()
        )
        past_rad = recording.past_rad
        used = np.flatnonzero(~is_unmeasured[:last])
        future = slice(last + 1, None)
        lag_s, drift_rad = self._expected(
            past_rad[used], by_lag[used, 3:], times_s[used], times_s[future]
        )
        weight = agreement_weight(past_rad[used], self.jump_rad)
        if is_unmeasured[last]:
            weight *= agreement_weight(
                past_rad[:last], self.registration_error_rad
            )
        last_from_cam = se3.inverse(recording.world_from_last) @ world_from_cam
        last_from_cam[:, :3, 3] += weight * lag_s * by_lag[future, :3]
        errors_rad = weight * (lag_s * by_lag[future, 3:] + drift_rad)
        return recording.world_from_last @ se3.turned(last_from_cam, errors_rad)

    def _expected(
        self,
        errors_rad: FloatArray,  # [P, 3], of past rotations
        by_lag: FloatArray,  # [P, 3], their change per second of lag
        past_s: FloatArray,  # [P]
        future_s: FloatArray,  # [F]
    ) -> tuple[float, FloatArray]:
        """Return the expected lag of the images after the recorded poses, and the drift [F, 3] of
        future rotations.
        """
        axes = (self.pitch, self.yaw, self.roll)
        # All axes in one vector [3 P], since they share the lag.
        lag_scale = self.lag_deviation_s / self.rate_deviation_rad_s
        by_shared_lag = by_lag.T.ravel() * lag_scale
        covariance = block_diag(
            *(axis.observed_covariance(past_s) for axis in axes)
        )
        covariance += np.outer(by_shared_lag, by_shared_lag)
        weights = np.linalg.solve(covariance, errors_rad.T.ravel())
        drift = [
            axis.covariance(future_s, past_s) @ axis_weights
            for axis, axis_weights in zip(
                axes, np.split(weights, 3), strict=True
            )
        ]
        return float(by_shared_lag @ weights) * lag_scale, np.stack(
            drift, axis=1
        )


def _by_lag(
    reference_from_cam: FloatArray,  # [T, 4, 4]
    times_s: FloatArray,  # [T]
    reference: int,
    is_measured: BoolArray,  # [T]
) -> FloatArray:
    """Return the changes of positions and rotations [T, 6] per second of lag."""
    step = np.arange(
        len(times_s)
    )  # central differences, but not across unmeasured poses
    before = np.maximum(step - 1, 0)
    before = np.where(is_measured[before], before, step)
    after = np.minimum(step + 1, len(step) - 1)
    after = np.where(is_measured[after], after, step)
    duration_s = np.maximum(times_s[after] - times_s[before], 1e-6)[:, None]
    turning = (
        se3.turn(reference_from_cam[before], reference_from_cam[after])
        / duration_s
    )
    position = reference_from_cam[:, :3, 3]
    moving = (position[after] - position[before]) / duration_s
    moving = moving - moving[reference] - np.cross(turning[reference], position)
    return np.concatenate([moving, turning - turning[reference]], axis=1)
