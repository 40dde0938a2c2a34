"""Pose sources: the camera's whole motion, past and future, from recorded poses or from odometry and a forecast."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geovp_classic.data import pose_files
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.forecasting import constant
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import planar, se3
from geovp_classic.interfaces import Forecaster, Odometry, PoseSource
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.types import BoolArray, Context, FloatArray, Grant, Motion, Trajectory


@dataclass(frozen=True)
class RecordedPast:
    """The recorded past poses, as an odometry without error."""

    needs = Grant.PAST_POSES  # the recorded past poses

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The recorded past [P], every step tracked; Incompatible when the clip has no poses."""
        past = _recorded(context.past, "past")
        return past, np.ones(len(past), dtype=bool)


@dataclass(frozen=True)
class GroundTruth:
    """The recorded motion in 3D, past and future: the perfect pose source (GT-3D)."""

    needs = Grant.PAST_POSES | Grant.FUTURE_POSES  # the recorded poses of past and future

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The recorded motion, one sample; Incompatible when the clip has no poses."""
        past, future = _recorded(context.past, "past"), _recorded(context.future, "future")
        return Motion(past, future.world_from_cam[None], np.ones(len(past), dtype=bool))


@dataclass(frozen=True)
class Chained:
    """Odometry for the past, a forecaster for the future; the defaults use no recorded pose and won on `val`."""

    odometry: Odometry = field(default_factory=Monocular)
    forecaster: Forecaster = field(default_factory=MotionPrior)

    @property
    def needs(self) -> Grant:
        """What the odometry needs; a forecaster sees nothing but poses."""
        return self.odometry.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The tracked past and its forecast; one sample when all samples are the same."""
        past, tracked = self.odometry.track(context.only(self.odometry.needs))
        futures = self.forecaster.forecast(past, context.times_s[context.num_past :], num_samples)
        same = (futures == futures[:1]).all()
        return Motion(past, futures[:1] if same else futures, tracked)


class _Continued:
    """The recorded past, continued by a forecaster without noise, which such a source is itself."""

    needs = Grant.PAST_POSES  # the recorded past poses

    def estimate(self: Forecaster, context: Context, num_samples: int = 1) -> Motion:
        """The recorded past and its continuation, one sample; Incompatible when the clip has no poses."""
        return Chained(RecordedPast(), self).estimate(context, num_samples)


class StandStill(_Continued, constant.Hold):
    """The recorded past, after which the camera stays where it is."""


class ConstantVelocity(_Continued, constant.ConstantVelocity):
    """The recorded past, after which the velocity of its last `num_steps` steps goes on without a turn."""


class ConstantTurn(_Continued, constant.ConstantTurn):
    """The recorded past, after which the SE(3) twist of its last `num_steps` steps goes on."""


@dataclass(frozen=True)
class Planar:
    """Any source whose futures are reduced to (x, z, yaw) on the vehicle's plane and lifted back (GT-2D from GT-3D).

    The plane is that of the last observed frame: the camera looks `pitch_deg` above it and is rolled clockwise by
    `roll_deg`. With both 0 it is the camera's own x-z plane. Height, pitch and roll stay as they are in that frame; the
    past is kept as it is.
    """

    source: PoseSource
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    @property
    def needs(self) -> Grant:
        """What the source needs."""
        return self.source.needs

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The source's motion with flattened futures."""
        motion = self.source.estimate(context.only(self.source.needs), num_samples)
        vehicle_from_cam = planar.level_vehicle_from_cam(np.deg2rad(self.pitch_deg), np.deg2rad(self.roll_deg))
        world_from_last = motion.past.world_from_cam[-1]
        states = planar.reduce(motion.futures, world_from_last, vehicle_from_cam)
        futures: FloatArray = planar.lift(states, world_from_last, vehicle_from_cam)
        return Motion(motion.past, futures, motion.tracked)


def _recorded(trajectory: Trajectory | None, which: str) -> Trajectory:
    if trajectory is None:
        raise Incompatible(f"this pose source needs recorded {which} poses, the clip has none: choose an odometry")
    return trajectory


@dataclass(frozen=True)
class Commanded:
    """The recorded past, after which the camera moves as commanded: by a trajectory file, or by speed and turn rate.

    `futures` is a TUM or KITTI file of the commanded motion; only how poses lie to one another counts, so its world
    frame is free. A TUM file starts at the last observed frame, whatever time it states there, and is read at the
    times to predict (screw motion in between). A KITTI file has no times: its first pose is the last observed frame's,
    and one pose follows for every frame to predict.

    Without a file the camera keeps `speed_m_s` along its viewing axis and turns right by `turn_deg_s` about its own
    vertical; that needs metric poses. A file is taken to be in the unit of the recorded poses.
    """

    futures: Path | None = None
    speed_m_s: float | None = None
    turn_deg_s: float = 0.0

    def __post_init__(self) -> None:
        if (self.futures is None) == (self.speed_m_s is None):
            raise BadData("commanded needs either futures, a trajectory file, or speed_m_s: give exactly one of them")
        if self.futures is not None and self.turn_deg_s != 0:
            raise BadData("commanded by a trajectory file has its turns from there: leave turn_deg_s out")
        if self.futures is not None and not self.futures.is_file():
            raise BadData(f"{self.futures} is missing, expected a TUM or KITTI trajectory of the commanded motion")

    needs = Grant.PAST_POSES  # the recorded past poses, on which the command goes on

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The recorded past and the commanded future, one sample; Incompatible when the clip has no poses."""
        if context.past is None:
            raise Incompatible("commanded goes on from recorded past poses, the clip has none: choose another clip")
        times_s = context.times_s[context.num_past - 1 :]
        last_from_cam = self._constant_turn(context.past, times_s) if self.futures is None else self._read(times_s)
        futures = context.past.world_from_cam[-1] @ last_from_cam
        return Motion(context.past, futures[None], np.ones(context.num_past, dtype=bool))

    def _constant_turn(self, past: Trajectory, times_s: FloatArray) -> FloatArray:
        """last_from_cam [F, 4, 4] of the commanded speed and turn rate."""
        assert self.speed_m_s is not None
        if not past.is_metric:
            raise Incompatible("speed_m_s is in metres, the recorded poses are not: command by a trajectory file")
        twist_per_s = np.array([0.0, 0.0, self.speed_m_s, 0.0, np.deg2rad(self.turn_deg_s), 0.0])
        return se3.exp((times_s[1:] - times_s[0])[:, None] * twist_per_s)

    def _read(self, times_s: FloatArray) -> FloatArray:
        """last_from_cam [F, 4, 4] of the commanded trajectory."""
        assert self.futures is not None
        if not pose_files.has_times(self.futures):
            _, poses = pose_files.read_kitti(self.futures)
            if len(poses) != len(times_s):
                count = len(times_s)
                expected = f"{count}: the last observed frame's and one for each of {count - 1} to predict"
                raise BadData(f"{self.futures}: {len(poses)} poses, expected {expected}")
            return se3.inverse(poses[0]) @ poses[1:]
        commanded = pose_files.read_tum(self.futures)
        duration_s, wanted_s = commanded.times_s[-1] - commanded.times_s[0], times_s[-1] - times_s[0]
        if duration_s < wanted_s - 1e-6:
            raise BadData(f"{self.futures} lasts {duration_s:.3g} s, expected at least the {wanted_s:.3g} s to predict")
        read_at_s = commanded.times_s[0] + times_s[1:] - times_s[0]
        return se3.inverse(commanded.world_from_cam[0]) @ _at(commanded, read_at_s)


def _at(trajectory: Trajectory, times_s: FloatArray) -> FloatArray:
    """world_from_cam [F, 4, 4] at any times within the trajectory, a screw motion between its poses."""
    after = np.clip(np.searchsorted(trajectory.times_s, times_s), 1, len(trajectory) - 1)
    before_s, after_s = trajectory.times_s[after - 1], trajectory.times_s[after]
    fraction = (times_s - before_s) / (after_s - before_s)
    poses = trajectory.world_from_cam
    return se3.interpolate(poses[after - 1], poses[after], fraction)
