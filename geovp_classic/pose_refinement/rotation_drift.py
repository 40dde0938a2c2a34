"""Errors of recorded rotations: registration shows those of the past, a Gaussian process predicts
those of the future.

A recorded rotation has three errors. A lag: it was taken some milliseconds before or after the
image, the same for all of a recording. Vibration between camera and recorder, independent in every
frame; the last frame's share is in every future pose, since these are relative to it. And a drift
of heading and tilt whose rate is correlated for some time. Together this is one Gaussian process,
white noise and an integrated Ornstein-Uhlenbeck process, with one unknown time. Its expected future
is linear in its registered past (Rasmussen & Williams 2006, eq. 2.23; with an unknown coefficient,
section 2.7). Larger errors are jumps, not drift: see `unmeasured_intervals`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement.angle_kernels import (
    covariance_of_differences,
    integrated_ornstein_uhlenbeck,
)
from geovp_classic.pose_refinement.unmeasured_intervals import (
    REGISTRATION_RAD,
    Recording,
    agreement_weight,
    recordings,
)
from geovp_classic.types import BoolArray, Context, FloatArray, Motion, PrivilegedInput

RATE_RAD_S = np.radians(0.05)  # standard deviation of the rate at which headings and tilts drift
LAG_S = 0.008  # standard deviation of the lag between recordings and images
LEAST_S = 1e-6


@dataclass(frozen=True)
class DriftModel:
    """Error model of the rotation about one axis; standard deviations in seconds, over
    RATE_RAD_S.
    """

    white_s: float
    time_constant_s: float  # of the correlation of the drift rate
    registration_s: float = 0.4  # white noise of the registration

    def covariance(self, one_s: FloatArray, other_s: FloatArray) -> FloatArray:
        """Covariance [N, M] of the errors at times [N] and [M], relative to the one at time 0."""
        drifted = covariance_of_differences(
            integrated_ornstein_uhlenbeck(1.0, self.time_constant_s), one_s, 0.0, other_s, 0.0
        )
        return drifted + self.white_s**2 * (1.0 + (one_s[:, None] == other_s))

    def observed_covariance(self, past_s: FloatArray) -> FloatArray:
        """The covariance [P, P] of past errors with the noise of the registration."""
        return self.covariance(past_s, past_s) + self.registration_s**2 * np.eye(len(past_s))


# About the camera's x, y and z axis: a car pitches with every bump; chosen on train and val.
AXES = (DriftModel(0.4, 0.2), DriftModel(0.2, 1.6), DriftModel(0.2, 0.4))
# Larger errors of past rotations are jumps, as after an unmeasured interval; those do not continue.
JUMP_RAD = np.radians(0.2)


@dataclass(frozen=True)
class RotationDrift:
    """Future poses without the lag and the rotation errors that the errors of past ones predict.

    Poses that do not continue the past get no correction of the lag. Where the last frame lies in
    an unmeasured interval, the weight is what that interval's own correction leaves.
    """

    needs = PrivilegedInput.NONE  # nothing: it compares registered poses with the given ones

    def refine(self, context: Context, motion: Motion) -> Motion:
        """The motion with other future poses."""
        futures = [
            _corrected(now, one)
            for now, one in zip(motion.futures, recordings(context, motion), strict=True)
        ]
        return motion.refined(motion.past, np.stack(futures))


def _corrected(world_from_cam: FloatArray, recording: Recording) -> FloatArray:
    """The future poses [F, 4, 4] with lag and drift of the recording removed."""
    given, times_s, now = recording.given, recording.times_s, recording.now
    intervals = recording.intervals
    measured = ~np.any(
        [one.inside(len(given)) for one in intervals] + [np.zeros(len(given), bool)], axis=0
    )
    by_lag = (
        _by_lag(given, times_s, now, measured)
        if recording.is_continuous
        else np.zeros((len(given), 6))
    )
    past_rad, used = recording.past_rad, np.flatnonzero(measured[:now])
    lag_s, drift = _expected(past_rad[used], by_lag[used, 3:], times_s[used], times_s[now + 1 :])
    weight = agreement_weight(past_rad[used], JUMP_RAD)
    if any(one.inside(len(given))[now] for one in intervals):
        weight *= agreement_weight(past_rad[:now], REGISTRATION_RAD)
    shift = weight * lag_s * by_lag[now + 1 :, :3]
    errors_rad = weight * (lag_s * by_lag[now + 1 :, 3:] + drift)
    last_from_cam = se3.inverse(recording.world_from_last) @ world_from_cam
    synchronised = se3.compose(last_from_cam[:, :3, :3], last_from_cam[:, :3, 3] + shift)
    return recording.world_from_last @ se3.turned(synchronised, errors_rad)


def _expected(
    errors_rad: FloatArray,  # [P, 3], of past rotations
    by_lag: FloatArray,  # [P, 3], their change per second of lag
    past_s: FloatArray,  # [P]
    future_s: FloatArray,  # [F]
) -> tuple[float, FloatArray]:
    """The expected lag of the images after the recorded poses, and drift [F, 3] of future
    rotations.
    """
    # All axes in one vector, since they share the lag: [3 P].
    shared = by_lag.T.ravel() * LAG_S / RATE_RAD_S
    covariance = block_diag(*(axis.observed_covariance(past_s) for axis in AXES)) + np.outer(
        shared, shared
    )
    weights = np.linalg.solve(covariance, errors_rad.T.ravel())
    drift = [
        axis.covariance(future_s, past_s) @ one
        for axis, one in zip(AXES, np.split(weights, 3), strict=True)
    ]
    return float(shared @ weights) * LAG_S / RATE_RAD_S, np.stack(drift, axis=1)


def _by_lag(
    reference_from_cam: FloatArray,  # [T, 4, 4]
    times_s: FloatArray,  # [T]
    reference: int,
    measured: BoolArray,  # [T]
) -> FloatArray:
    """Changes of positions and rotations [T, 6] per second of lag."""
    step = np.arange(len(times_s))  # central differences, but not across unmeasured poses
    before, after = np.maximum(step - 1, 0), np.minimum(step + 1, len(step) - 1)
    before, after = np.where(measured[before], before, step), np.where(measured[after], after, step)
    duration_s = np.maximum(times_s[after] - times_s[before], LEAST_S)[:, None]
    turning = se3.turn(reference_from_cam[before], reference_from_cam[after]) / duration_s
    position = reference_from_cam[:, :3, 3]
    moving = (position[after] - position[before]) / duration_s
    moving = moving - moving[reference] - np.cross(turning[reference], position)
    return np.concatenate([moving, turning - turning[reference]], axis=1)
