"""Predictions of a method with some of its stages replaced by ground truth.

Future poses are relative to the last observed camera: *across*, *height* and *along* are positions
on its axes x, y and z; *yaw* (right), *pitch* (up) and *roll* (clockwise) are the angles of
R = Ry(yaw) Rx(pitch) Rz(roll).

*Past* is the trajectory of the observed frames, in metres. With the true one, the source forecasts
again if its odometry can be replaced. Without it, true future positions are in the unit of the
estimated past. True poses are the recorded ones, registered to all images.

*Holes* are pixels that even true poses do not show; *dynamic objects* are copied from the real
frames, too. *Exposure* is the median ratio of grey levels.
"""

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.depth.given import Given
from geovp_classic.depth.stereo import Stereo
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import DepthSource, PoseSource, Renderer, Scene
from geovp_classic.odometry.recorded_past import RecordedPast
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.registered import Registered
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.rendering.exposure import ToneCurve
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    FloatArray,
    Motion,
    PrivilegedInput,
    Views,
)

Oracles = frozenset[str]  # the stages from ground truth
POSE_STAGES = ("across", "height", "along", "yaw", "pitch", "roll")
STAGES = ("past", *POSE_STAGES, "depth", "holes", "dynamic objects", "exposure")


class OracleClip:
    """One clip, predicted with any stages from ground truth; shared steps run once."""

    def __init__(
        self, predictor: GeometricPredictor, clip: Clip, num_past: int, steps: Sequence[int]
    ) -> None:
        self.source, self.renderer = predictor.pose_source, predictor.renderer
        self.true_depth = with_true_depth(self.renderer, clip) or self.renderer
        self.context, self.target = clip.split(num_past, ~PrivilegedInput.NONE)
        self.steps = np.array(steps)  # of the future, to be scored
        self.truth = Registered().estimate(self.context)
        self.estimate = self.source.estimate(self.context.only(self.source.needs))
        real, estimated = (
            float(se3.step_lengths(path.world_from_cam[[0, -1]])[0])  # from the first to the last
            for path in (self.truth.past, self.estimate.past)
        )
        self.metres_per_unit = real / estimated if real and estimated else 1.0
        self.scene = functools.cache(self._scene)

    def frames(self, oracles: Oracles) -> tuple[ByteArray, ByteArray]:
        """Return predicted and real frames [N, H, W, 3].

        Frames with less than 10 % of covered pixels at true poses are left out. Raises
        Incompatible if there is no other frame.
        """
        used = self.is_seen.mean(axis=(1, 2)) >= 0.1
        if not used.any():
            raise Incompatible(f"{self.context.name}: the future shows nothing of the past")
        views = self.view(oracles)
        steps, frames = self.steps[used], views.frames[used]
        real = self.target.frames[steps]
        if "exposure" in oracles:
            triples = zip(frames, real, views.covered[used], strict=True)
            frames = np.stack([matched_exposure(*triple) for triple in triples])
        if "holes" in oracles:
            frames = np.where(self.is_seen[used][..., None], frames, real)
        if "dynamic objects" in oracles and self.target.moving is not None:
            frames = np.where(self.target.moving[steps][..., None], real, frames)
        return frames, real

    def motion(self, oracles: Oracles) -> Motion:
        """Return the motion with these stages from ground truth."""
        truth = last_from_future(self.truth)
        if "past" in oracles:
            motion, forecast = self.truth, self.forecast
        else:
            motion, forecast = self.estimate, last_from_future(self.estimate)
            truth[:, :3, 3] /= self.metres_per_unit
        futures = motion.past.world_from_cam[-1] @ mixed_poses(forecast, truth, oracles)
        return replace(motion, futures=futures[None])

    @functools.cached_property
    def forecast(self) -> FloatArray:
        """Return the forecast from the true past as last_from_cam [F, 4, 4] in metres."""
        source = with_recorded_past(self.source)
        if source is None:
            forecast = last_from_future(self.estimate)
            forecast[:, :3, 3] *= self.metres_per_unit
            return forecast
        context = replace(self.context, past=self.truth.past)
        return last_from_future(source.estimate(context.only(source.needs)))

    def _scene(self, oracles: Oracles) -> Scene:
        renderer = self.true_depth if "depth" in oracles else self.renderer
        past = self.motion(oracles).past
        return renderer.reconstruct(self.context.only(renderer.needs), past)

    def view(self, oracles: Oracles) -> Views:
        """Render the scored steps."""
        poses = self.motion(oracles).futures[0, self.steps]
        times_s = self.context.times_s[self.context.num_past + self.steps]
        scene = self.scene(oracles & {"past", "depth"})
        return scene.view(poses, times_s, self.context.intrinsics)

    @functools.cached_property
    def is_seen(self) -> BoolArray:
        """Return which pixels [N, H, W] the scene covers with all stages from ground truth."""
        return self.view(Oracles(STAGES)).covered


def with_true_depth(renderer: Renderer, clip: Clip) -> Renderer | None:
    """Return the renderer with recorded depth, or else depth of the right images, if possible."""
    component: Any = renderer
    if not isinstance(getattr(component, "depth", None), DepthSource):
        return None
    if clip.depths is not None and getattr(component, "frames", "crop") == "crop":
        return replace(component, depth=Given())
    return None if clip.right is None else replace(component, depth=Stereo())


def with_recorded_past(source: Any) -> PoseSource | None:
    """Return the source with recorded poses as odometry; None if it has no odometry."""
    if isinstance(source, Chained):
        return replace(source, odometry=RecordedPast())
    inner = with_recorded_past(source.source) if hasattr(source, "source") else None
    return None if inner is None else replace(source, source=inner)


def matched_exposure(
    predicted: ByteArray,  # [H, W, 3]
    real: ByteArray,  # [H, W, 3]
    covered: BoolArray,  # [H, W]
    blur_px: float = 4.0,  # so that errors of the poses hardly count
) -> ByteArray:
    """Return the predicted frame at the exposure of the real one: median ratio of grey values."""
    if not covered.any():
        return predicted
    before, after = (
        cv2.GaussianBlur(pinhole.grey(image), (0, 0), blur_px)[covered] + 1
        for image in (predicted, real)
    )
    return ToneCurve().apply(predicted, float(np.log(np.median(after / before))))


def last_from_future(motion: Motion) -> FloatArray:
    """Return the first future as last_from_cam [F, 4, 4]."""
    return np.array(se3.inverse(motion.past.world_from_cam[-1]) @ motion.futures[0])


def mixed_poses(
    forecast: FloatArray,  # [F, 4, 4], last_from_cam
    truth: FloatArray,  # [F, 4, 4], in the same unit
    oracles: Oracles,
) -> FloatArray:
    """Return last_from_cam [F, 4, 4] with some POSE_STAGES from ground truth."""
    mixed, true = (
        np.hstack([poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_euler("YXZ")])
        for poses in (forecast, truth)
    )
    is_true = [stage in oracles for stage in POSE_STAGES]
    mixed[:, is_true] = true[:, is_true]
    rotation = Rotation.from_euler("YXZ", mixed[:, 3:]).as_matrix()
    return se3.compose(rotation, mixed[:, :3])
