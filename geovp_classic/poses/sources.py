"""Pose sources: the camera's whole motion, past and future, from recorded poses or from odometry and a forecast."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import planar
from geovp_classic.interfaces import Forecaster, Odometry, PoseSource
from geovp_classic.poses import forecast
from geovp_classic.poses.motion_prior import MotionPrior
from geovp_classic.poses.odometry import Monocular
from geovp_classic.types import BoolArray, Context, FloatArray, Grant, Motion, Trajectory


@dataclass(frozen=True)
class RecordedPast:
    """The odometry that never errs: the recorded past poses."""

    @property
    def needs(self) -> Grant:
        """The recorded past poses."""
        return Grant.PAST_POSES

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The recorded past [P], every step tracked; Incompatible when the clip has no poses."""
        past = _recorded(context.past, "past")
        return past, np.ones(len(past), dtype=bool)


@dataclass(frozen=True)
class GroundTruth:
    """The recorded motion in 3D, past and future: what a perfect pose source would say (GT-3D)."""

    @property
    def needs(self) -> Grant:
        """The recorded poses of past and future."""
        return Grant.PAST_POSES | Grant.FUTURE_POSES

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


@dataclass(frozen=True)
class StandStill:
    """The recorded past, after which the camera stays where it is."""

    @property
    def needs(self) -> Grant:
        """The recorded past poses."""
        return Grant.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The recorded past and its last pose, held; Incompatible when the clip has no poses."""
        return Chained(RecordedPast(), forecast.Hold()).estimate(context, num_samples)


@dataclass(frozen=True)
class ConstantVelocity:
    """The recorded past, after which the velocity of its last `num_steps` steps goes on without a turn."""

    num_steps: int = 1

    def __post_init__(self) -> None:
        """Raise BadData for a number of steps below one."""
        forecast.ConstantVelocity(self.num_steps)

    @property
    def needs(self) -> Grant:
        """The recorded past poses."""
        return Grant.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The recorded past and its straight continuation; Incompatible when the clip has no poses."""
        return Chained(RecordedPast(), forecast.ConstantVelocity(self.num_steps)).estimate(context, num_samples)


@dataclass(frozen=True)
class ConstantTurn:
    """The recorded past, after which the SE(3) twist of its last `num_steps` steps goes on."""

    num_steps: int = 1

    def __post_init__(self) -> None:
        """Raise BadData for a number of steps below one."""
        forecast.ConstantTurn(self.num_steps)

    @property
    def needs(self) -> Grant:
        """The recorded past poses."""
        return Grant.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The recorded past and its screw continuation; Incompatible when the clip has no poses."""
        return Chained(RecordedPast(), forecast.ConstantTurn(self.num_steps)).estimate(context, num_samples)


@dataclass(frozen=True)
class Planar:
    """Any source whose futures are reduced to (x, z, yaw) on the vehicle's plane and lifted back (GT-2D from GT-3D).

    The plane is that of the last observed frame: the camera looks `pitch_deg` above it and is rolled clockwise by
    `roll_deg`. With both 0 it is the camera's own x-z plane. Height, pitch and roll stay as they are in that frame; the
    past is kept as the source says it.
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
