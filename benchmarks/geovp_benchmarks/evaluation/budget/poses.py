"""Forecast motion with some of its stages replaced by the truth.

Future poses are taken relative to the last observed one and split in the plane of that camera's x
and z axes (the vehicle's plane, up to how the camera is mounted): *path* is the curve on the plane
and *speed* the distance along it, so that both together are the position; *height* is along y;
*yaw* (right), *pitch* (up) and *roll* (clockwise) are the angles of R = Ry(yaw) Rx(pitch) Rz(roll).

*Past poses* is the shape of the true past, *scale* how many metres its unit is: with either one,
the source's forecast is made anew from the corrected past where its odometry can be swapped. True
future positions are always put in the unit of the past, so that a scale that is wrong everywhere
alters no image but through forecasters and depths in metres. The truth are the recorded poses
registered to all images.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.geometry import se3
from geovp_classic.interfaces import PoseSource
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.planar import Planar
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.pose_sources.registered import Registered
from geovp_classic.types import BoolArray, Context, FloatArray, Motion, PrivilegedInput, Trajectory

Oracles = frozenset[str]  # the stages that are true
PAST, SCALE = "past poses", "scale"
COMPONENTS = ("speed", "path", "yaw", "pitch", "roll", "height")
STAGES = (PAST, SCALE, *COMPONENTS)
TRUTH = Registered()


@dataclass(frozen=True)
class ClipMotions:
    """All mixtures of one clip's forecast and true motion; what they share is estimated once."""

    source: PoseSource
    context: Context
    again: dict[Oracles, FloatArray] = field(
        default_factory=dict
    )  # futures [F, 4, 4] forecast from a corrected past

    def motion(self, oracles: Oracles) -> Motion:
        """The motion with these stages from the truth; without any, it is the source's own."""
        about_past = oracles & {PAST, SCALE}
        past = self._past(about_past)
        truth = _relative(self.truth)
        truth[:, :3, 3] *= 1 if SCALE in oracles else 1 / self.scale
        forecast = truth if oracles >= set(COMPONENTS) else self._forecast(about_past, past)
        futures = past.world_from_cam[-1] @ mixed(forecast, truth, oracles)
        return Motion(past, futures[None], np.ones(len(past), dtype=bool))

    @cached_property
    def forecast(self) -> Motion:
        """The source's own motion."""
        return self.source.estimate(self.context.only(self.source.needs))

    @cached_property
    def truth(self) -> Motion:
        """The true motion."""
        return TRUTH.estimate(self.context.only(TRUTH.needs))

    @cached_property
    def scale(self) -> float:
        """Metres per unit of the estimated past: least squares over the distances to the last
        camera.
        """
        own, real = (
            np.linalg.norm(
                past.world_from_cam[:-1, :3, 3] - past.world_from_cam[-1, :3, 3], axis=-1
            )
            for past in (self.forecast.past, self.truth.past)
        )
        return (
            float(own @ real / (own @ own)) if own @ real > 0 else 1.0
        )  # standing: no scale shows

    def _past(self, about_past: Oracles) -> Trajectory:
        if PAST in about_past:
            factor, past = 1.0 if SCALE in about_past else 1 / self.scale, self.truth.past
        else:
            factor, past = self.scale if SCALE in about_past else 1.0, self.forecast.past
        poses = past.world_from_cam.copy()
        poses[:, :3, 3] *= factor
        return Trajectory(poses, past.times_s, SCALE in about_past or self.forecast.past.is_metric)

    def _forecast(self, about_past: Oracles, past: Trajectory) -> FloatArray:
        """The source's futures [F, 4, 4] relative to the last observed camera, in the unit of the
        past.
        """
        if not about_past:
            return _relative(self.forecast)
        if about_past not in self.again:
            source = with_past(self.source, past)
            futures = _relative(
                self.forecast
                if source is None
                else source.estimate(self.context.only(source.needs))
            )
            futures[:, :3, 3] *= self.scale if source is None and SCALE in about_past else 1
            self.again[about_past] = futures
        return self.again[about_past]


@dataclass(frozen=True)
class KnownPast:
    """An odometry that knows the past already."""

    past: Trajectory
    needs = PrivilegedInput.NONE

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The known past, every step tracked."""
        return self.past, np.ones(len(self.past), dtype=bool)


def with_past(source: PoseSource, past: Trajectory) -> PoseSource | None:
    """The source with the past given to its forecaster; None when it has no odometry that can be
    swapped.
    """
    if isinstance(source, Chained):
        return replace(source, odometry=KnownPast(past))
    if not isinstance(source, (Refined, Planar)):
        return None
    inner = with_past(source.source, past)
    return None if inner is None else replace(source, source=inner)


def mixed(
    forecast: FloatArray,  # [F, 4, 4], last_from_cam
    truth: FloatArray,  # [F, 4, 4], last_from_cam, in the same unit
    oracles: Oracles,
) -> FloatArray:
    """last_from_cam [F, 4, 4] with the components in `oracles` from the truth, the others from the
    forecast.
    """
    chosen = {name: truth if name in oracles else forecast for name in COMPONENTS}
    if all(poses is chosen["yaw"] for poses in chosen.values()):
        return chosen["yaw"]
    angles_rad = np.stack(
        [_euler(chosen[name])[:, i] for i, name in enumerate(("yaw", "pitch", "roll"))], axis=-1
    )
    path, paced, position = (
        chosen["path"][:, [0, 2], 3],
        chosen["speed"][:, [0, 2], 3],
        chosen["height"][:, :3, 3].copy(),
    )
    position[:, [0, 2]] = along(path, np.cumsum(np.linalg.norm(_steps(paced), axis=-1)))
    return se3.compose(Rotation.from_euler("YXZ", angles_rad).as_matrix(), position)


def along(
    path: FloatArray,  # [F, 2] as (x, z), from the origin
    distances: FloatArray,  # [F]
) -> FloatArray:
    """The points [F, 2] at these distances along the path, which goes on straight
    beyond its end.
    """
    steps = _steps(path)
    lengths = np.linalg.norm(steps, axis=-1)
    moving = np.flatnonzero(lengths)
    ahead = steps[moving[-1]] / lengths[moving[-1]] if len(moving) else np.array([0.0, 1.0])
    beyond = float(distances.max()) + 1.0
    corners = np.vstack([np.zeros(2), path, path[-1] + beyond * ahead])
    at = np.cumsum([0.0, *lengths, beyond])
    return np.stack([np.interp(distances, at, corners[:, axis]) for axis in (0, 1)], axis=-1)


def _steps(path: FloatArray) -> FloatArray:
    return np.diff(path, axis=0, prepend=np.zeros((1, 2)))


def _euler(last_from_cam: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(last_from_cam[:, :3, :3]).as_euler("YXZ"))


def _relative(motion: Motion) -> FloatArray:
    """last_from_cam [F, 4, 4] of the first sample, a copy."""
    return np.array(se3.inverse(motion.past.world_from_cam[-1]) @ motion.futures[0])
