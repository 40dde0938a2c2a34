"""Predictions of a method with some of its stages replaced by ground truth.

Future poses relative to the last observed one are split in the x-z plane of that camera: *path* is
the curve on the plane and *speed* the distance along it; *height* is along y; *yaw* (right),
*pitch* (up) and *roll* (clockwise) are the angles of R = Ry(yaw) Rx(pitch) Rz(roll).

*Past poses* is the shape of the past, *scale* the metres per unit. With either of them from ground
truth, the source forecasts again from the corrected past if its odometry can be replaced. True
future positions are in the unit of the past, so that a common error of the scale affects only
forecasters and depths in metres. True poses are the recorded ones, registered to all images.

*Holes* are pixels that even true poses do not show; *dynamic objects* are copied from the real
frames, too. *Exposure* is the median ratio of grey levels.
"""

import functools
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from geovp_benchmarks.evaluation.variants import Method
from geovp_classic.depth.given import Given
from geovp_classic.depth.stereo import Stereo
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import DepthSource, PoseSource, Renderer, Scene
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.planar import Planar
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.pose_sources.registered import Registered
from geovp_classic.rendering.exposure import ExposureEstimator
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Motion,
    PrivilegedInput,
    Trajectory,
    Views,
)

Oracles = frozenset[str]  # the stages from ground truth
POSE_STAGES = ("speed", "path", "yaw", "pitch", "roll", "height")
STAGES = (
    *("past poses", "scale", *POSE_STAGES),
    *("depth", "holes", "dynamic objects", "exposure"),
)


class OracleClip:
    """One clip, predicted with any stages from ground truth; shared steps run once."""

    def __init__(self, method: Method, clip: Clip) -> None:
        truth = Registered()
        self.source = method.predictor.pose_source
        self.renderer = method.predictor.renderer
        self.true_depth = with_true_depth(self.renderer, clip) or self.renderer
        needs = method.predictor.needs | truth.needs | self.true_depth.needs
        self.context, self.target = clip.split(method.matrix.num_past, needs)
        self.steps = np.array(method.steps)
        self.truth = truth.estimate(self.context.only(truth.needs))
        self.estimate = self.source.estimate(self.context.only(self.source.needs))
        self.scale = metres_per_unit(self.estimate.past, self.truth.past)
        self.forecast = functools.cache(self._forecast)
        self.scene = functools.cache(self._scene)
        self.view = functools.cache(self._view)

    def frames(self, oracles: Oracles) -> tuple[ByteArray, ByteArray]:
        """Return predicted and real frames [N, H, W, 3].

        Frames with less than 10 % of covered pixels at true poses are left out. Raises
        Incompatible if there is no other frame.
        """
        views = self.view(oracles.intersection(STAGES[:9]))
        is_seen = self.view(frozenset(STAGES[:9])).covered
        used = np.flatnonzero(is_seen.mean(axis=(1, 2)) >= 0.1)
        if not len(used):
            raise Incompatible(f"{self.context.name}: the future shows nothing of the past")
        steps = self.steps[used]
        real = self.target.frames[steps]
        frames = views.frames[used]
        if "exposure" in oracles:
            triples = zip(frames, real, views.covered[used], strict=True)
            frames = np.stack([matched_exposure(*triple) for triple in triples])
        if "holes" in oracles:
            frames = np.where(is_seen[used][..., None], frames, real)
        if "dynamic objects" in oracles and self.target.moving is not None:
            frames = np.where(self.target.moving[steps][..., None], real, frames)
        return frames, real

    def motion(self, oracles: Oracles) -> Motion:
        """Return the motion with these stages from ground truth."""
        past = self.past(oracles)
        truth = last_from_future(self.truth)
        truth[:, :3, 3] *= self.unit(oracles)
        forecast = self.forecast(oracles & {"past poses", "scale"})
        futures = past.world_from_cam[-1] @ mixed_poses(forecast, truth, oracles)
        return Motion(past, futures[None], np.ones(len(past), dtype=bool))

    def unit(self, oracles: Oracles) -> float:
        """Return the units of the past per metre."""
        return 1.0 if "scale" in oracles else 1 / self.scale

    def past(self, oracles: Oracles) -> Trajectory:
        """Return the past with its poses or its scale from ground truth."""
        past, factor = self.estimate.past, self.unit(oracles) * self.scale
        if "past poses" in oracles:
            past, factor = self.truth.past, self.unit(oracles)
        poses = past.world_from_cam.copy()
        poses[:, :3, 3] *= factor
        is_metric = "scale" in oracles or self.estimate.past.is_metric
        return Trajectory(poses, past.times_s, is_metric)

    def _forecast(self, oracles: Oracles) -> FloatArray:
        """Return the forecast from the past as last_from_cam [F, 4, 4]."""
        source = with_past(self.source, self.past(oracles)) if oracles else None
        if source is not None:
            return last_from_future(source.estimate(self.context.only(source.needs)))
        forecast = last_from_future(self.estimate)
        forecast[:, :3, 3] *= self.unit(oracles) * self.scale
        return forecast

    def _scene(self, oracles: Oracles) -> Scene:
        renderer = self.true_depth if "depth" in oracles else self.renderer
        return renderer.reconstruct(self.context.only(renderer.needs), self.past(oracles))

    def _view(self, oracles: Oracles) -> Views:
        return self.render(oracles, self.motion(oracles).futures[0, self.steps])

    def render(self, oracles: Oracles, world_from_cam: FloatArray) -> Views:
        """Render the scene from poses [N, 4, 4] at the scored steps."""
        scene = self.scene(oracles & {"past poses", "scale", "depth"})
        times_s = self.context.times_s[self.context.num_past + self.steps]
        return scene.view(world_from_cam, times_s, self.context.intrinsics)


def with_true_depth(renderer: Renderer, clip: Clip) -> Renderer | None:
    """Return the renderer with recorded depth, or else depth of the right images, if possible."""
    component: Any = renderer
    if not isinstance(getattr(component, "depth", None), DepthSource):
        return None
    if clip.depths is not None and getattr(component, "frames", "crop") == "crop":
        return replace(component, depth=Given())
    return None if clip.right is None else replace(component, depth=Stereo())


def matched_exposure(
    predicted: ByteArray,  # [H, W, 3]
    real: ByteArray,  # [H, W, 3]
    covered: BoolArray,  # [H, W]
) -> ByteArray:
    """Return the predicted frame at the exposure of the real one, by a median over coarse cells."""
    height, width = covered.shape
    size_px = (max(1, width // 8), max(1, height // 8))
    before, after, fraction = (
        np.asarray(cv2.resize(image.astype(np.float32), size_px, interpolation=cv2.INTER_AREA))
        for image in (pinhole.grey(predicted), pinhole.grey(real), covered)
    )
    limits = ExposureEstimator()
    is_valid = fraction > 0.99
    for image in (before, after):
        is_valid &= (image > limits.min_grey) & (image < limits.max_grey)
    if is_valid.sum() < 8:
        return predicted
    log_gain = float(np.median(np.log(after[is_valid] / before[is_valid])))
    return limits.tone_curve.apply(predicted, log_gain)


def metres_per_unit(estimate: Trajectory, truth: Trajectory) -> float:
    """Return the scale by least squares over distances to the last camera; 1 if stationary."""
    ours, real = (
        np.linalg.norm(path.world_from_cam[:-1, :3, 3] - path.world_from_cam[-1, :3, 3], axis=-1)
        for path in (estimate, truth)
    )
    return float(ours @ real / (ours @ ours)) if ours @ real > 0 else 1.0


@dataclass(frozen=True)
class FixedOdometry:
    """Odometry that returns a given trajectory."""

    past: Trajectory
    needs = PrivilegedInput.NONE

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """Return the trajectory, with all steps tracked."""
        return self.past, np.ones(len(self.past), dtype=bool)


def with_past(source: PoseSource, past: Trajectory) -> PoseSource | None:
    """Return the source that forecasts from a past; None if its odometry cannot be replaced."""
    if isinstance(source, Chained):
        return replace(source, odometry=FixedOdometry(past))
    if isinstance(source, (Refined, Planar)):
        inner = with_past(source.source, past)
        return None if inner is None else replace(source, source=inner)
    return None


def last_from_future(motion: Motion) -> FloatArray:
    """Return the first future as last_from_cam [F, 4, 4]."""
    return np.array(se3.inverse(motion.past.world_from_cam[-1]) @ motion.futures[0])


def mixed_poses(
    forecast: FloatArray,  # [F, 4, 4], last_from_cam
    truth: FloatArray,  # [F, 4, 4], in the same unit
    oracles: Oracles,
) -> FloatArray:
    """Return last_from_cam [F, 4, 4] with some POSE_STAGES from ground truth."""
    if oracles.isdisjoint(POSE_STAGES):
        return forecast
    if oracles.issuperset(POSE_STAGES):
        return truth
    poses = {name: truth if name in oracles else forecast for name in POSE_STAGES}
    angles_rad = [
        Rotation.from_matrix(poses[name][:, :3, :3]).as_euler("YXZ")[:, axis]
        for axis, name in enumerate(("yaw", "pitch", "roll"))
    ]
    rotation = Rotation.from_euler("YXZ", np.stack(angles_rad, axis=-1)).as_matrix()
    paced = np.diff(poses["speed"][:, [0, 2], 3], axis=0, prepend=0)
    distances = np.cumsum(np.linalg.norm(paced, axis=-1))
    position = poses["height"][:, :3, 3].copy()
    position[:, [0, 2]] = points_along(poses["path"][:, [0, 2], 3], distances)
    return se3.compose(rotation, position)


def points_along(
    path: FloatArray,  # [F, 2] as (x, z), from the origin
    distances: FloatArray,  # [F]
) -> FloatArray:
    """Return the points [F, 2] at distances along the path, which continues straight ahead."""
    corners = np.vstack([np.zeros(2), path])
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=-1)
    at, first = np.unique(np.cumsum([0.0, *lengths]), return_index=True)
    if len(at) == 1:
        return np.outer(distances, [0, 1])
    return np.asarray(make_interp_spline(at, corners[first], k=1)(distances))
