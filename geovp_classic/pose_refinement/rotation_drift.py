"""How recorded rotations err, and for how long: what the images say of past ones, carried on into the future.

A recorded rotation errs in three ways. It was taken some milliseconds before or after the image: all of a recording
is out of step by the same time. The rig trembles against what records it, another way in every frame; the last frame's
share of that is in every coming pose, since these are counted from it. And headings and tilts drift, at a rate that
lasts for some time. All this is one Gaussian process, white noise and the integral of an Ornstein-Uhlenbeck process,
with one unknown time, whose past is known from registration: what is to be expected of its future is linear in that
(Rasmussen & Williams 2006, eq. 2.23; with an unknown coefficient, section 2.7). What errs by more than such a process
does jumped: where nothing was measured, the next measured pose says more (`gaps`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement.angle_kernels import covariance_of_differences, integrated_ornstein_uhlenbeck
from geovp_classic.pose_refinement.unmeasured_intervals import SEEN_RAD, Recording, agreement_weight, recordings
from geovp_classic.types import BoolArray, Context, FloatArray, Grant, Motion

RATE_RAD_S = np.radians(0.05)  # at which headings and tilts drift
LAG_S = 0.008  # by which recordings are out of step with images
LEAST_S = 1e-6


@dataclass(frozen=True)
class DriftModel:
    """How rotations about one axis err, in seconds: deviations over RATE_RAD_S."""

    white_s: float
    time_constant_s: float  # for how long a rate lasts (the time constant of its correlation)
    registration_s: float = 0.4  # white, too, but of the images' word, not of the recorded rotation

    def covariance(self, one_s: FloatArray, other_s: FloatArray) -> FloatArray:
        """Of the errors at times [N] and [M] against the one at time 0: [N, M]."""
        drifted = covariance_of_differences(
            integrated_ornstein_uhlenbeck(1.0, self.time_constant_s), one_s, 0.0, other_s, 0.0
        )
        return drifted + self.white_s**2 * (1.0 + (one_s[:, None] == other_s))

    def observed_covariance(self, past_s: FloatArray) -> FloatArray:
        """The covariance [P, P] of past errors as they are seen."""
        return self.covariance(past_s, past_s) + self.registration_s**2 * np.eye(len(past_s))


# About the camera's x, y and z axis: a car pitches with every bump; chosen on train and val.
AXES = (DriftModel(0.4, 0.2), DriftModel(0.2, 1.6), DriftModel(0.2, 0.4))
# Past rotations that are off by more than so much jumped, as where nothing was measured; such errors end, too.
JUMP_RAD = np.radians(0.2)


@dataclass(frozen=True)
class RotationDrift:
    """Coming poses in step with the images, and without the rotation errors that past ones foretell.

    Poses that don't go on from the past are turned by what is to be expected of their times alone. Where the last frame
    lies in an unmeasured interval, this counts as far as that interval's own errors don't.
    """

    @property
    def needs(self) -> Grant:
        """Nothing: it compares registered poses with the given ones."""
        return Grant.NONE

    def refine(self, context: Context, motion: Motion) -> Motion:
        """The motion with other coming poses."""
        futures = [_corrected(now, one) for now, one in zip(motion.futures, recordings(context, motion), strict=True)]
        return motion.refined(motion.past, np.stack(futures))


def _corrected(world_from_cam: FloatArray, recording: Recording) -> FloatArray:
    """The coming poses [F, 4, 4] with lag and drift of the recording taken out."""
    given, times_s, now = recording.given, recording.times_s, recording.now
    intervals = recording.intervals
    measured = ~np.any([one.inside(len(given)) for one in intervals] + [np.zeros(len(given), bool)], axis=0)
    by_lag = _by_lag(given, times_s, now, measured) if recording.is_continuous else np.zeros((len(given), 6))
    past_rad, observed_covariance = recording.past_rad, np.flatnonzero(measured[:now])
    lag_s, drifting = _expected(
        past_rad[observed_covariance], by_lag[observed_covariance, 3:], times_s[observed_covariance], times_s[now + 1 :]
    )
    weight = agreement_weight(past_rad[observed_covariance], JUMP_RAD)
    if any(one.inside(len(given))[now] for one in intervals):
        weight *= agreement_weight(past_rad[:now], SEEN_RAD)
    shift = weight * lag_s * by_lag[now + 1 :, :3]
    errors_rad = weight * (lag_s * by_lag[now + 1 :, 3:] + drifting)
    last_from_cam = se3.inverse(recording.world_from_last) @ world_from_cam
    in_step = se3.compose(last_from_cam[:, :3, :3], last_from_cam[:, :3, 3] + shift)
    return recording.world_from_last @ se3.turned(in_step, errors_rad)


def _expected(
    errors_rad: FloatArray,  # [P, 3], of past rotations
    by_lag: FloatArray,  # [P, 3], what those change by when they are taken a second later
    past_s: FloatArray,  # [P]
    future_s: FloatArray,  # [F]
) -> tuple[float, FloatArray]:
    """The time that images come later than recorded poses, and the drift [F, 3] of coming rotations."""
    # All axes one after the other, since they share the lag: [3 P].
    shared = by_lag.T.ravel() * LAG_S / RATE_RAD_S
    observed_covariance = block_diag(*(axis.observed_covariance(past_s) for axis in AXES)) + np.outer(shared, shared)
    certain = np.linalg.solve(observed_covariance, errors_rad.T.ravel())
    drifting = [axis.covariance(future_s, past_s) @ sure for axis, sure in zip(AXES, np.split(certain, 3), strict=True)]
    return float(shared @ certain) * LAG_S / RATE_RAD_S, np.stack(drifting, axis=1)


def _by_lag(
    reference_from_cam: FloatArray,  # [T, 4, 4]
    times_s: FloatArray,  # [T]
    reference: int,
    measured: BoolArray,  # [T]
) -> FloatArray:
    """What positions and rotations [T, 6] change by, a second of lag, when all are taken later."""
    step = np.arange(len(times_s))  # central differences, but none across a pose that nothing measured
    before, after = np.maximum(step - 1, 0), np.minimum(step + 1, len(step) - 1)
    before, after = np.where(measured[before], before, step), np.where(measured[after], after, step)
    duration_s = np.maximum(times_s[after] - times_s[before], LEAST_S)[:, None]
    turning = se3.turn(reference_from_cam[before], reference_from_cam[after]) / duration_s
    position = reference_from_cam[:, :3, 3]
    moving = (position[after] - position[before]) / duration_s
    moving = moving - moving[reference] - np.cross(turning[reference], position)
    return np.concatenate([moving, turning - turning[reference]], axis=1)
