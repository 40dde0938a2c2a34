"""How recorded rotations err, and for how long: what the pictures say of past ones, carried on into the future.

A recorded rotation errs in two ways. The rig trembles against what records it, another way in every frame; the last
frame's share of that is in every coming pose, since these are counted from it. And headings and tilts drift, at a rate
that lasts for some tenths of a second. Both are one Gaussian process, white noise and the integral of an
Ornstein-Uhlenbeck process, whose past is known from registration: what is to be expected of its future is linear in
that (Rasmussen & Williams 2006, eq. 2.23). Only the ratios of its deviations matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Errors:
    """How rotations about one axis err, in seconds: deviations over the deviation of the drift's rate."""

    white_s: float
    lasting_s: float  # for how long a rate lasts (the time constant of its correlation)
    registration_s: float = 0.4  # white, too, but of the pictures' word, not of the recorded rotation

    def covariance(self, one_s: FloatArray, other_s: FloatArray) -> FloatArray:
        """Of the errors at times [N] and [M] against the one at time 0: [N, M]."""
        drift = self._drifted(one_s)[:, None] + self._drifted(other_s) - self._drifted(one_s[:, None] - other_s)
        return np.asarray(drift / 2 + self.white_s**2 * (1.0 + (one_s[:, None] == other_s)))

    def _drifted(self, seconds: FloatArray) -> FloatArray:
        """The variance of the drift over so many seconds."""
        lasts = np.abs(seconds) / self.lasting_s
        return np.asarray(2 * self.lasting_s**2 * (lasts + np.expm1(-lasts)))

    def weights(self, past_s: FloatArray, future_s: FloatArray) -> FloatArray:
        """What past errors [P] count for future ones: [F, P]."""
        known = self.covariance(past_s, past_s) + self.registration_s**2 * np.eye(len(past_s))
        return np.asarray(np.linalg.solve(known, self.covariance(past_s, future_s)).T)


# About the camera's x, y and z axis: a car pitches with every bump; chosen on train and val.
AXES = (Errors(0.4, 0.2), Errors(0.2, 0.4), Errors(0.2, 0.4))
# Past rotations that are off by more than so much jumped, as where a recording begins; such errors end, too.
JUMP_RAD = np.radians(0.2)


@dataclass(frozen=True)
class Drift:
    """Errors of past rotations against the last one."""

    seconds: FloatArray  # [P], negative: before the last frame
    errors_rad: FloatArray  # [P, 3] rotation vectors in the last frame

    def mended(self, reference_from_cam: FloatArray, seconds: FloatArray) -> FloatArray:
        """Poses [F, 4, 4] at times [F] after the last frame, their rotations without the errors to be expected."""
        expected = np.stack([axis.weights(self.seconds, seconds) for axis in AXES], axis=-1)  # [F, P, 3]
        errors_rad = self._belief() * (expected * self.errors_rad).sum(axis=1)
        turn = se3.exp(np.concatenate([np.zeros_like(errors_rad), errors_rad], axis=1))[:, :3, :3]
        return se3.compose(turn @ reference_from_cam[:, :3, :3], reference_from_cam[:, :3, 3])

    def _belief(self) -> float:
        """Between 1 for what drifts and 0 for what jumps."""
        return 1 / (1 + float((self.errors_rad**2).sum()) / max(1, len(self.errors_rad)) / JUMP_RAD**2)


def observed(
    given: FloatArray,  # [P, 4, 4], any frame
    seen: FloatArray,  # [P, 4, 4], as the pictures show them; the last one is the same
    times_s: FloatArray,  # [P]
) -> Drift:
    """The errors of past poses' rotations."""
    was, now = (se3.inverse(poses[-1]) @ poses[:-1] for poses in (given, seen))
    turn = se3.compose(now[:, :3, :3] @ np.swapaxes(was[:, :3, :3], -1, -2), np.zeros((len(was), 3)))
    return Drift(times_s[:-1] - times_s[-1], se3.log(turn)[:, 3:])
