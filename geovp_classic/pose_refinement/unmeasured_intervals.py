"""Unmeasured intervals of recorded poses: detected, and interpolated with the help of the images.

Where satellite navigation or its log fails for a second or two, recordings continue uniformly: on a
straight line, at one rate of turn, until the next measured pose. No vehicle does. A camera within
such an interval looks up to a degree beside its recorded direction, and this error is in every
future pose, since those are relative to it. But registration ties the past to the last frame, and
the recording ties measured poses to the end of the interval. Between them a Gaussian process for
each axis interpolates (Rasmussen & Williams 2006, eq. 2.23).
"""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement.angle_kernels import (
    IntegratedOrnsteinUhlenbeck,
    Kernel,
    Matern52,
    covariance_of_differences,
)
from geovp_classic.pose_refinement.registration import unrefined
from geovp_classic.types import (
    BoolArray,
    Context,
    FloatArray,
    Motion,
    PrivilegedInput,
)


@dataclass(frozen=True)
class Recording:
    """Recorded past and future poses, and the registered past ones."""

    given: FloatArray  # [P + F, 4, 4], last camera from camera
    registered: FloatArray  # [P, 4, 4]
    times_s: FloatArray  # [P + F], 0 for the last observed one
    is_metric: bool
    world_from_last: FloatArray  # [4, 4]

    @property
    def last(self) -> int:
        """Return the step of the last observed frame."""
        return len(self.registered) - 1

    @property
    def past_rad(self) -> FloatArray:
        """Return the errors of past rotations [P, 3], as rotation vectors."""
        return se3.turn(self.given[: len(self.registered)], self.registered)

    def is_continuous(
        self,
        max_change: float = 0.5,  # of the velocity at the last observed frame, over the speed
    ) -> bool:
        """Return whether the future poses continue the past."""
        if not 0 < self.last < len(self.given) - 1:
            return False
        around = slice(self.last - 1, self.last + 2)
        durations_s = np.diff(self.times_s[around])
        before, after = (
            np.diff(self.given[around, :3, 3], axis=0) / durations_s[:, None]
        )
        return bool(
            np.linalg.norm(after - before)
            <= max_change * np.linalg.norm(before)
        )


def recordings(context: Context, motion: Motion) -> list[Recording]:
    """Return a recording for each future; Incompatible where nothing has been registered."""
    recorded = unrefined(motion, "this refinement")
    registered = motion.past.world_from_cam
    last = recorded.past.world_from_cam[-1]
    times_s = context.times_s - motion.past.times_s[-1]
    return [
        Recording(
            se3.inverse(last)
            @ np.concatenate([recorded.past.world_from_cam, future]),
            se3.inverse(registered[-1]) @ registered,
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
        """Return which of `count` poses are unmeasured."""
        is_unmeasured = np.zeros(count, dtype=bool)
        is_unmeasured[
            0 if self.first is None else self.first + 1 : self.last
        ] = True
        return is_unmeasured


@dataclass(frozen=True)
class IntervalDetector:
    """Unmeasured intervals are uniform motion: measured steps are hardly ever so even."""

    max_turn_change_rad_s: float = (
        3.5e-4  # 0.02 degrees/s from one step to the next
    )
    max_speed_change_m_s: float = 0.05
    min_speed_m_s: float = 0.5  # a stationary camera moves uniformly, too
    min_steps: int = 5

    def detect(self, recording: Recording) -> list[Interval]:
        """Return the unmeasured intervals of a recording; none without metres."""
        if recording.is_metric and recording.is_continuous():
            return self.find(recording.given, recording.times_s)
        return []

    def find(
        self,
        world_from_cam: FloatArray,  # [T, 4, 4] in metres
        times_s: FloatArray,  # [T]
    ) -> list[Interval]:
        """Return all unmeasured intervals of a sequence of poses, in order."""
        is_uniform = np.concatenate(
            [[0], self._is_uniform(world_from_cam, times_s), [0]]
        )
        changes = np.diff(is_uniform)
        begins = np.flatnonzero(changes == 1).tolist()
        ends = np.flatnonzero(changes == -1).tolist()
        intervals = []
        for begin, end in zip(begins, ends, strict=True):
            # Steps begin .. end are uniform; the one after those still leads out of the interval.
            if end - begin + 1 >= self.min_steps:
                first = begin if begin > 0 else None
                last = end + 2 if end + 2 < len(times_s) else None
                intervals.append(Interval(first, last))
        return intervals

    def _is_uniform(
        self, world_from_cam: FloatArray, times_s: FloatArray
    ) -> BoolArray:
        """Return whether each step but the last continues uniformly in the next one [T - 2]."""
        durations_s = np.diff(times_s)[:, None]
        turning = (
            se3.turn(world_from_cam[:-1], world_from_cam[1:]) / durations_s
        )
        moving = np.diff(world_from_cam[:, :3, 3], axis=0) / durations_s
        turn_change = np.linalg.norm(np.diff(turning, axis=0), axis=1)
        speed_change = np.linalg.norm(np.diff(moving, axis=0), axis=1)
        is_moving = np.linalg.norm(moving[1:], axis=1) > self.min_speed_m_s
        is_turn_even = turn_change < self.max_turn_change_rad_s
        return np.asarray(
            is_turn_even
            & (speed_change < self.max_speed_change_m_s)
            & is_moving
        )


@dataclass(frozen=True)
class UnmeasuredIntervals:
    """Future rotations after an unmeasured last frame: interpolated between registration and the
    interval's end.

    Their weight is how much the images contradict the uniform motion that was recorded.
    """

    detector: IntervalDetector = field(default_factory=IntervalDetector)
    # Rotations about the camera's x, y and z axis; chosen on poses of the sequences 00, 02, 08 and
    # 09, with intervals cut into them.
    pitch: Matern52 = field(default=Matern52(0.0105, 0.25))  # 0.6 degrees
    yaw: IntegratedOrnsteinUhlenbeck = field(
        default=IntegratedOrnsteinUhlenbeck(0.035, 1.2)
    )
    roll: IntegratedOrnsteinUhlenbeck = field(
        default=IntegratedOrnsteinUhlenbeck(0.035, 0.15)
    )
    # Uniform motion that agrees with registered rotations to this error was measured.
    registration_error_rad: float = 8.7e-4  # 0.05 degrees
    noise_rad: float = (
        5.2e-4  # 0.03 degrees, of registered and of recorded rotations
    )
    after_s: float = 0.5  # how long after the interval measured poses are used

    needs = (
        PrivilegedInput.NONE
    )  # it compares registered poses with the given ones

    def refine(self, context: Context, motion: Motion) -> Motion:
        """Return the motion with other future rotations; unchanged where the last frame's pose was
        measured.
        """
        futures = motion.futures.copy()
        for number, recording in enumerate(recordings(context, motion)):
            agreement = agreement_weight(
                recording.past_rad[: recording.last],
                self.registration_error_rad,
            )
            for interval in self.detector.detect(recording):
                if interval.inside(len(recording.given))[recording.last]:
                    errors_rad = self.errors(
                        interval,
                        recording.given,
                        recording.registered,
                        recording.times_s,
                    )
                    last_from_cam = (
                        se3.inverse(recording.world_from_last) @ futures[number]
                    )
                    turned = se3.turned(
                        last_from_cam, (1 - agreement) * errors_rad
                    )
                    futures[number] = recording.world_from_last @ turned
        return motion.refined(motion.past, futures)

    def errors(
        self,
        interval: Interval,
        given: FloatArray,  # [T, 4, 4], reference from camera, as recorded
        registered: FloatArray,  # [P, 4, 4], the first P of them, up to the reference
        times_s: FloatArray,  # [T], 0 for the reference
    ) -> FloatArray:
        """Return the errors of the rotations after the reference, a pose inside: rotation vectors
        [F, 3]; 0 without an end.
        """
        num_past = len(registered)
        if interval.last is None:
            return np.zeros((len(times_s) - num_past, 3))
        begin = interval.first or 0
        end = interval.last
        duration_s = times_s[end - 1] - times_s[begin]
        rate_rad_s = se3.turn(given[begin], given[end - 1]) / duration_s
        identity = np.tile(np.eye(4), (len(times_s), 1, 1))
        uniform = se3.turned(identity, times_s[:, None] * rate_rad_s)
        recorded_rad = se3.turn(uniform, given)
        registered_rad = se3.turn(uniform[:num_past], registered)
        is_measured = (times_s > times_s[end]) & (
            times_s <= times_s[end] + self.after_s
        )
        is_measured[: 0 if interval.first is None else interval.first + 1] = (
            True
        )
        # Registration ties the past to the reference, the recording ties measured poses to the
        # interval's end.
        at_s = np.concatenate([times_s[: num_past - 1], times_s[is_measured]])
        from_s = np.concatenate(
            [np.zeros(num_past - 1), np.full(is_measured.sum(), times_s[end])]
        )
        relative_rad = recorded_rad[is_measured] - recorded_rad[end]
        known_rad = np.concatenate([registered_rad[:-1], relative_rad])
        known_rad += (at_s - from_s)[:, None] * rate_rad_s
        # After the interval errors stay as at its end.
        future = np.minimum(np.arange(num_past, len(times_s)), end)
        future_s = times_s[future]
        kernels: tuple[Kernel, ...] = (self.pitch, self.yaw, self.roll)
        expected_rad = np.stack(
            [
                self._expected(kernel, measured_angles, at_s, from_s, future_s)
                for kernel, measured_angles in zip(
                    kernels, known_rad.T, strict=True
                )
            ],
            axis=1,
        )
        corrected = se3.turned(
            uniform[future], expected_rad - future_s[:, None] * rate_rad_s
        )
        return se3.turn(given[future], corrected)

    def _expected(
        self,
        kernel: Kernel,
        known_rad: FloatArray,  # [N], angles at times [N] against those at others [N]
        at_s: FloatArray,
        from_s: FloatArray,
        future_s: FloatArray,  # [F]
    ) -> FloatArray:
        """Return the expected angles [F], relative to the one at time 0."""
        has_same_origin = np.equal.outer(from_s, from_s)
        covariance = covariance_of_differences(
            kernel, at_s, from_s, at_s, from_s
        )
        covariance += self.noise_rad**2 * (np.eye(len(at_s)) + has_same_origin)
        weights = np.linalg.solve(covariance, known_rad)
        return (
            covariance_of_differences(kernel, future_s, 0.0, at_s, from_s)
            @ weights
        )


def agreement_weight(past_rad: FloatArray, half_rad: float) -> float:
    """Return a weight from 1 for no past errors [P, 3] to 0 for large ones; one half for an RMS of
    `half_rad`.
    """
    mean_square = float((past_rad**2).sum()) / max(1, len(past_rad))
    return 1 / (1 + mean_square / half_rad**2)
