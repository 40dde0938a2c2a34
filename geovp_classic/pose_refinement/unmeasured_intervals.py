"""Unmeasured intervals of recorded poses: detected, and interpolated with the help of the images.

Where satellite navigation or its log fails for a second or two, recordings continue uniformly: on a
straight line, at one rate of turn, until the next measured pose. No vehicle does. A camera within
such an interval looks up to a degree beside its recorded direction, and this error is in every
future pose, since those are relative to it. But registration ties the past to the last frame, and
the recording ties measured poses to the end of the interval. Between them a Gaussian process for
each axis interpolates (Rasmussen & Williams 2006, eq. 2.23).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement.angle_kernels import (
    Kernel,
    covariance_of_differences,
    integrated_ornstein_uhlenbeck,
    matern52,
)
from geovp_classic.pose_refinement.registration import unrefined
from geovp_classic.types import BoolArray, Context, FloatArray, Motion, PrivilegedInput

# Steps are uniform when rate and speed change by less than this from one to the next; measured ones
# hardly ever are.
UNIFORM_RAD_S = np.radians(0.02)
UNIFORM_M_S = 0.05
SLOWEST_M_S = 0.5  # a standing camera moves uniformly, too
LEAST_STEPS = 5
REGISTRATION_RAD = np.radians(
    0.05
)  # error of registration: a uniform motion that agrees with the images to this was measured
MOST_CHANGE = 0.5  # share of the speed, between two steps of one path
AFTER_S = 0.5  # how long after the interval measured poses are used
NOISE_RAD = np.radians(0.03)  # of registered and of recorded rotations

# About the camera's x, y and z axis: chosen on poses of 00, 02, 08 and 09, with intervals cut into
# them.
AXES = (
    matern52(np.radians(0.6), 0.25),
    integrated_ornstein_uhlenbeck(np.radians(2.0), 1.2),
    integrated_ornstein_uhlenbeck(np.radians(2.0), 0.15),
)


@dataclass(frozen=True)
class UnmeasuredIntervals:
    """Future rotations after an unmeasured last frame: interpolated between registration and the
    interval's end.

    Their weight is how much the images contradict the uniform motion that was recorded.
    """

    needs = PrivilegedInput.NONE  # nothing: it compares registered poses with the given ones

    def refine(self, context: Context, motion: Motion) -> Motion:
        """The motion with other future rotations; unchanged where the last frame's pose was
        measured.
        """
        futures = motion.futures.copy()
        for number, recording in enumerate(recordings(context, motion)):
            for interval in recording.intervals:
                if interval.inside(len(recording.given))[recording.now]:
                    errors_rad = interval.errors(recording.given, recording.seen, recording.times_s)
                    share = 1 - agreement_weight(
                        recording.past_rad[: recording.now], REGISTRATION_RAD
                    )
                    last_from_cam = se3.inverse(recording.world_from_last) @ futures[number]
                    futures[number] = recording.world_from_last @ se3.turned(
                        last_from_cam, share * errors_rad
                    )
        return motion.refined(motion.past, futures)


@dataclass(frozen=True)
class Recording:
    """Recorded past and future poses, and the registered past ones."""

    given: FloatArray  # [P + F, 4, 4], last camera from camera
    seen: FloatArray  # [P, 4, 4]
    times_s: FloatArray  # [P + F], 0 for the last observed one
    is_metric: bool
    world_from_last: FloatArray  # [4, 4]

    @property
    def now(self) -> int:
        """The step of the last observed frame."""
        return len(self.seen) - 1

    @property
    def past_rad(self) -> FloatArray:
        """The errors of past rotations [P, 3], as rotation vectors."""
        return se3.turn(self.given[: len(self.seen)], self.seen)

    @property
    def is_continuous(self) -> bool:
        """Whether the future poses continue the past: the velocity after the reference is near the
        one before it.
        """
        around = slice(self.now - 1, self.now + 2)
        if not 0 < self.now < len(self.given) - 1:
            return False
        before, after = (
            np.diff(self.given[around, :3, 3], axis=0) / np.diff(self.times_s[around])[:, None]
        )
        return bool(np.linalg.norm(after - before) <= MOST_CHANGE * np.linalg.norm(before))

    @property
    def intervals(self) -> list[Interval]:
        """The unmeasured intervals."""
        return (
            find_intervals(self.given, self.times_s)
            if self.is_metric and self.is_continuous
            else []
        )


def recordings(context: Context, motion: Motion) -> list[Recording]:
    """One for each of the motion's futures; Incompatible where nothing has been registered."""
    recorded, seen = unrefined(motion, "this refinement"), motion.past.world_from_cam
    last = recorded.past.world_from_cam[-1]
    times_s = context.times_s - motion.past.times_s[-1]
    return [
        Recording(
            se3.inverse(last) @ np.concatenate([recorded.past.world_from_cam, future]),
            se3.inverse(seen[-1]) @ seen,
            times_s,
            motion.past.is_metric,
            last,
        )
        for future in recorded.futures
    ]


@dataclass(frozen=True)
class Interval:
    """The steps of the last measured pose before and the first one after; None for one outside the
    sequence.
    """

    first: int | None
    last: int | None

    def inside(self, count: int) -> BoolArray:
        """Which of `count` poses are unmeasured."""
        unmeasured = np.zeros(count, dtype=bool)
        unmeasured[0 if self.first is None else self.first + 1 : self.last] = True
        return unmeasured

    def errors(
        self,
        given: FloatArray,  # [T, 4, 4], reference from camera, as recorded
        seen: FloatArray,  # [P, 4, 4], of the first P of them, up to the reference, registered
        times_s: FloatArray,  # [T], 0 for the reference
    ) -> FloatArray:
        """Errors of the rotations after the reference, a pose inside: rotation vectors [F, 3]; 0
        without an end.
        """
        if self.last is None:
            return np.zeros((len(times_s) - len(seen), 3))
        begin, end = self.first or 0, self.last
        rate_rad_s = se3.turn(given[begin], given[end - 1]) / (times_s[end - 1] - times_s[begin])
        uniform = se3.turned(
            np.tile(np.eye(4), (len(times_s), 1, 1)), times_s[:, None] * rate_rad_s
        )
        recorded, registered = (se3.turn(uniform[: len(poses)], poses) for poses in (given, seen))
        measured = (times_s > times_s[end]) & (times_s <= times_s[end] + AFTER_S)
        measured[: 0 if self.first is None else self.first + 1] = True
        # Registration ties the past to the reference, the recording ties measured poses to the
        # interval's end.
        times = np.concatenate([times_s[: len(seen) - 1], times_s[measured]])
        against = np.concatenate([np.zeros(len(seen) - 1), np.full(measured.sum(), times_s[end])])
        known = np.concatenate([registered[:-1], recorded[measured] - recorded[end]])
        known += (times - against)[:, None] * rate_rad_s
        future = np.minimum(
            np.arange(len(seen), len(times_s)), end
        )  # after the interval errors stay as at its end
        wanted = times_s[future]
        angles = [
            _expected(kernel, turned, times, against, wanted)
            for kernel, turned in zip(AXES, known.T, strict=True)
        ]
        corrected_poses = se3.turned(
            uniform[future], np.stack(angles, axis=1) - wanted[:, None] * rate_rad_s
        )
        return se3.turn(given[future], corrected_poses)


def _expected(
    kernel: Kernel,
    known: FloatArray,  # [N], angles at times [N] against those at others [N]
    times_s: FloatArray,
    against_s: FloatArray,
    wanted_s: FloatArray,  # [F]
) -> FloatArray:
    """The expected angles [F], relative to the one at time 0."""
    noise = NOISE_RAD**2 * (np.eye(len(known)) + (against_s[:, None] == against_s))
    weights = np.linalg.solve(
        covariance_of_differences(kernel, times_s, against_s, times_s, against_s) + noise, known
    )
    return np.asarray(
        covariance_of_differences(kernel, wanted_s, 0.0, times_s, against_s) @ weights
    )


def find_intervals(
    world_from_cam: FloatArray,  # [T, 4, 4] in metres
    times_s: FloatArray,  # [T]
) -> list[Interval]:
    """All unmeasured intervals of a sequence of poses, in order."""
    uniform = np.concatenate([[False], _is_uniform(world_from_cam, times_s), [False]])
    begins, ends = (
        np.flatnonzero(np.diff(uniform.astype(int)) == sign).tolist() for sign in (1, -1)
    )
    # Steps begin .. end are uniform; the one after those still leads out of the interval.
    runs = [
        (begin, end)
        for begin, end in zip(begins, ends, strict=True)
        if end - begin + 1 >= LEAST_STEPS
    ]
    return [
        Interval(begin if begin > 0 else None, end + 2 if end + 2 < len(times_s) else None)
        for begin, end in runs
    ]


def _is_uniform(world_from_cam: FloatArray, times_s: FloatArray) -> BoolArray:
    """Whether each step but the last continues uniformly in the next one [T - 2]."""
    intervals_s = np.diff(times_s)[:, None]
    turning = se3.turn(world_from_cam[:-1], world_from_cam[1:]) / intervals_s
    moving = np.diff(world_from_cam[:, :3, 3], axis=0) / intervals_s
    changes = (np.linalg.norm(np.diff(rates, axis=0), axis=1) for rates in (turning, moving))
    uniform = np.all(
        [change < most for change, most in zip(changes, (UNIFORM_RAD_S, UNIFORM_M_S), strict=True)],
        axis=0,
    )
    return np.asarray(uniform & (np.linalg.norm(moving[1:], axis=1) > SLOWEST_M_S))


def agreement_weight(past_rad: FloatArray, half_rad: float) -> float:
    """A weight from 1 for no past errors [P, 3] to 0 for large ones; one half for an RMS of
    `half_rad`.
    """
    return 1 / (1 + float((past_rad**2).sum()) / max(1, len(past_rad)) / half_rad**2)
