"""How recorded rotations err, and for how long: what the pictures say of past ones, carried on into the future.

A recorded rotation errs in three ways. It was taken some milliseconds before or after the picture: all of a recording
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

from geovp_classic.depth import gaps
from geovp_classic.depth.angles import of_differences, wandering
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray, Trajectory

RATE_RAD_S = np.radians(0.05)  # at which headings and tilts drift
LAG_S = 0.008  # by which recordings are out of step with pictures
LEAST_S = 1e-6
MOST_CHANGE = 0.5  # share of the speed, between two steps of one way


@dataclass(frozen=True)
class Errors:
    """How rotations about one axis err, in seconds: deviations over RATE_RAD_S."""

    white_s: float
    lasting_s: float  # for how long a rate lasts (the time constant of its correlation)
    registration_s: float = 0.4  # white, too, but of the pictures' word, not of the recorded rotation

    def covariance(self, one_s: FloatArray, other_s: FloatArray) -> FloatArray:
        """Of the errors at times [N] and [M] against the one at time 0: [N, M]."""
        drifted = of_differences(wandering(1.0, self.lasting_s), one_s, 0.0, other_s, 0.0)
        return drifted + self.white_s**2 * (1.0 + (one_s[:, None] == other_s))

    def known(self, past_s: FloatArray) -> FloatArray:
        """The covariance [P, P] of past errors as they are seen."""
        return self.covariance(past_s, past_s) + self.registration_s**2 * np.eye(len(past_s))


# About the camera's x, y and z axis: a car pitches with every bump; chosen on train and val.
AXES = (Errors(0.4, 0.2), Errors(0.2, 1.6), Errors(0.2, 0.4))
# Past rotations that are off by more than so much jumped, as where nothing was measured; such errors end, too.
JUMP_RAD = np.radians(0.2)
SEEN_RAD = np.radians(0.05)  # what pictures err by; an even motion that they agree with to this is no gap


@dataclass(frozen=True)
class Drift:
    """Past poses, the last one the reference: as they were recorded and as pictures show them."""

    given: FloatArray  # [P, 4, 4], reference from camera
    seen: FloatArray  # [P, 4, 4]
    seconds: FloatArray  # [P], up to 0
    is_metric: bool

    def mended(self, reference_from_cam: FloatArray, seconds: FloatArray) -> FloatArray:
        """Poses [F, 4, 4] at times [F] after the last frame, in step with pictures and without the errors to expect.

        Poses that don't go on from the past are turned by what is to be expected of their times alone.
        """
        given, times_s = np.concatenate([self.given, reference_from_cam]), np.concatenate([self.seconds, seconds])
        past_rad, now = se3.turn(self.given, self.seen), len(self.given) - 1
        goes_on = _goes_on(given[:, :3, 3], times_s, now)
        unmeasured = gaps.found(given, times_s) if self.is_metric and goes_on else []
        measured = ~np.any([gap.inside(len(given)) for gap in unmeasured] + [np.zeros(len(given), bool)], axis=0)
        by_lag = _by_lag(given, times_s, now, measured) if goes_on else np.zeros((len(given), 6))
        known = np.flatnonzero(measured[:now])
        lag_s, drifting = _expected(past_rad[known], by_lag[known, 3:], times_s[known], seconds)
        believed = _believed(past_rad[known], JUMP_RAD)
        shift = believed * lag_s * by_lag[now + 1 :, :3]
        errors_rad = believed * (lag_s * by_lag[now + 1 :, 3:] + drifting)
        for gap in (gap for gap in unmeasured if gap.inside(len(given))[now]):
            jumped = gap.errors(given, self.seen, times_s)
            errors_rad += (1 - _believed(past_rad[:now], SEEN_RAD)) * (jumped - errors_rad)
        in_step = se3.compose(reference_from_cam[:, :3, :3], reference_from_cam[:, :3, 3] + shift)
        return se3.turned(in_step, errors_rad)


def observed(
    past: Trajectory,
    seen: FloatArray,  # [P, 4, 4], as the pictures show its poses; the last one is the same
) -> Drift:
    """What is known of past poses' errors."""
    given, now = (se3.inverse(poses[-1]) @ poses for poses in (past.world_from_cam, seen))
    return Drift(given, now, past.times_s - past.times_s[-1], past.is_metric)


def _expected(
    errors_rad: FloatArray,  # [P, 3], of past rotations
    by_lag: FloatArray,  # [P, 3], what those change by when they are taken a second later
    past_s: FloatArray,  # [P]
    future_s: FloatArray,  # [F]
) -> tuple[float, FloatArray]:
    """The time that pictures come later than recorded poses, and the drift [F, 3] of coming rotations."""
    # All axes one after the other, since they share the lag: [3 P].
    shared = by_lag.T.ravel() * LAG_S / RATE_RAD_S
    known = block_diag(*(axis.known(past_s) for axis in AXES)) + np.outer(shared, shared)
    certain = np.linalg.solve(known, errors_rad.T.ravel())
    drifting = [axis.covariance(future_s, past_s) @ sure for axis, sure in zip(AXES, np.split(certain, 3), strict=True)]
    return float(shared @ certain) * LAG_S / RATE_RAD_S, np.stack(drifting, axis=1)


def _goes_on(positions: FloatArray, times_s: FloatArray, now: int) -> bool:
    """Whether the step [T, 3] after the reference is as long, and leads as far that way, as the one before it."""
    if not 0 < now < len(positions) - 1:
        return False
    before, after = np.diff(positions[now - 1 : now + 2], axis=0) / np.diff(times_s[now - 1 : now + 2])[:, None]
    return bool(np.linalg.norm(after - before) <= MOST_CHANGE * np.linalg.norm(before))


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


def _believed(past_rad: FloatArray, half_rad: float) -> float:
    """Between 1 for no past errors [P, 3] and 0 for large ones; such errors are believed by half."""
    return 1 / (1 + float((past_rad**2).sum()) / max(1, len(past_rad)) / half_rad**2)
