"""Renderers that begin with a depth source: depth and rendering, rooms on one floor, meet here and only here."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geovp_classic.abreast import unhindered
from geovp_classic.depth import course, drift, matching, registration
from geovp_classic.depth.ground import Ground, fit_ground
from geovp_classic.depth.movers import Movers
from geovp_classic.depth.multiview import Multiview
from geovp_classic.depth.road_ahead import RoadAhead
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.interfaces import DepthSource, Fill, Scene
from geovp_classic.render import billboards, fusion, surface, volume
from geovp_classic.render.exposure import Exposed, Exposure
from geovp_classic.render.fill import BorrowedDetail, NearestBackground
from geovp_classic.render.pace import seconds_of
from geovp_classic.render.supersampling import Supersampled
from geovp_classic.render.uncropped import uncropped
from geovp_classic.types import Context, FloatArray, Grant, Intrinsics, Trajectory, Views


@dataclass(frozen=True)
class DepthFusion:
    """All observed frames as one cloud of patches; holes are filled, magnified surfaces get their grain back."""

    depth: DepthSource = field(default_factory=Multiview)
    fill: Fill = field(default_factory=BorrowedDetail)
    frames: Literal["crop", "wide"] = "crop"  # wide: the uncropped ones, in full resolution
    num_frames: int = 10  # how many of the last observed frames are used
    with_registration: bool = True  # poses are first adjusted to what the pictures show; needed for the next two
    with_drift: bool = True  # coming poses are brought into step and lose the errors that past ones foretell
    with_road_ahead: bool = True  # coming poses are brought towards their height above the road in sight
    samples: int = 1  # along each side of a pixel; 2 smooth the edges of things and cost four times the drawing
    crack_px: int = 3  # gaps up to about twice this width are closed between surfaces, not invented
    agreement: float = 0.1  # two inverse depths are of one surface when they differ by less than this share
    grain: float = 1.0  # strength of the borrowed detail; 0 leaves magnified surfaces blurred
    moving: Literal["carried", "ignored"] = "carried"  # things that move by themselves go on, or stand like all else
    exposure: Literal["forecast", "kept"] = "forecast"  # the camera's exposure goes on changing, or stays the last one

    def __post_init__(self) -> None:
        """Raise BadData for settings that make no sense."""
        if self.frames not in ("crop", "wide"):
            raise BadData(f"frames is {self.frames!r}, expected 'crop' or 'wide'")
        if self.num_frames < 1:
            raise BadData(f"num_frames is {self.num_frames}, expected 1 or more observed frames to use")
        if self.samples < 1:
            raise BadData(f"samples is {self.samples}, expected 1 or more along each side of a pixel")
        if not (0 < self.agreement < 1 and self.crack_px >= 0 and self.grain >= 0):
            raise BadData("agreement must lie between 0 and 1, crack_px and grain must not be negative")
        if self.moving not in ("carried", "ignored"):
            raise BadData(f"moving is {self.moving!r}, expected 'carried' or 'ignored'")
        if self.exposure not in ("forecast", "kept"):
            raise BadData(f"exposure is {self.exposure!r}, expected 'forecast' or 'kept'")

    @property
    def needs(self) -> Grant:
        """What the depth source needs, and the uncropped frames when they are asked for."""
        return self.depth.needs | (Grant.WIDE_FRAMES if self.frames == "wide" else Grant.NONE)

    @unhindered
    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """The fused cloud of the last `num_frames` frames, in the world frame and the unit of the past."""
        recent, past = context.only(self.needs).recent(self.num_frames), past[-self.num_frames :]
        recent = uncropped(recent) if self.frames == "wide" else recent
        if not self.with_registration:
            return self._fused(recent, past, *self._depths(recent, past))
        pictures = np.stack([matching.grey(frame) for frame in recent.frames])
        found = registration.registered(pictures, recent.intrinsics, past.world_from_cam, len(past) - 1)
        better = Trajectory(found.world_from_cam, past.times_s, past.is_metric)
        way = course.observed(past.world_from_cam, found.world_from_cam) if past.is_metric else None
        inverse_depths, confidence, ground = self._depths(recent, better)
        road, errors = None, None
        if self.with_road_ahead and ground is not None:
            road = RoadAhead.seen(inverse_depths[-1], recent.intrinsics, ground)
        if self.with_drift:
            errors = drift.observed(past, found.world_from_cam)
        scene = self._fused(recent, better, inverse_depths, confidence, ground)
        seconds = recent.times_s[len(past) :] - past.times_s[-1]
        return Steered(scene, past.world_from_cam[-1], seconds, errors, found.steering, way, road)

    def _depths(self, recent: Context, past: Trajectory) -> tuple[FloatArray, FloatArray, Ground | None]:
        """Inverse depth and confidence [P, H, W], and the ground of the last frame."""
        inverse_depths, confidence = self.depth.inverse_depths(recent, past)
        return inverse_depths, confidence, fit_ground(inverse_depths[-1], recent.intrinsics)

    def _fused(
        self,
        recent: Context,
        past: Trajectory,
        inverse_depths: FloatArray,
        confidence: FloatArray,
        ground: Ground | None,
    ) -> Scene:
        things = _moving_things(recent, past, inverse_depths[-1], ground) if self.moving == "carried" else ()
        seconds = recent.times_s - past.times_s[-1]
        inverse_depths, confidence, cut = billboards.cut_out(
            things, inverse_depths, confidence, past.world_from_cam, seconds[: len(past)]
        )
        details = [None] * len(past) if recent.wide is None else recent.wide.frames
        sources = [
            surface.Source(frame, recent.intrinsics, pose, detail)
            for frame, pose, detail in zip(recent.frames, past.world_from_cam, details, strict=True)
        ]
        light = Exposure.of(sources, inverse_depths[-1], seconds[: len(past)])
        cloud, used = fusion.fuse(light.matched(sources), inverse_depths, confidence, self.agreement)
        standing = billboards.without(cloud, 0, cut[-1])
        street = fusion.CloudScene(standing, used, self.fill, self.crack_px * self.samples, self.grain)
        scene: Scene = billboards.Traffic(street, things, seconds[len(past) :]) if things else street
        scene = Supersampled(scene, self.samples) if self.samples > 1 else scene
        if self.exposure == "kept":
            return scene
        return Exposed(scene, sources[-1], light, seconds[len(past) :], whole=self.frames == "wide")


def _moving_things(
    recent: Context,
    past: Trajectory,
    inverse_depth: FloatArray,  # [H, W] of the last frame
    road: Ground | None,
) -> tuple[billboards.Billboard, ...]:
    """What moves by itself in the last frame, flat; in the unit of the past."""
    pictures = np.stack([matching.grey(frame) for frame in recent.frames])
    found = Movers().find(pictures, recent.intrinsics, past, inverse_depth, road)
    taken = recent.frames[-1], recent.intrinsics, past.world_from_cam[-1]
    return tuple(billboards.Billboard(taken[0], mover.mask, *taken[1:], mover.depth, mover.velocity) for mover in found)


@dataclass(frozen=True)
class Steered:
    """A scene for poses that are brought into line with what the pictures showed: drift, course, and road.

    Poses that are asked for together are taken for one way, in this order, the k-th for the k-th future time.
    """

    scene: Scene
    world_from_reference: FloatArray  # [4, 4]
    seconds: FloatArray  # [F] since the reference
    errors: drift.Drift | None  # of rotations
    steering: FloatArray  # [3, 3], in the reference's frame
    way: course.Course | None  # of the vehicle, where lengths are metres and it moved
    road: RoadAhead | None  # where there is one

    @unhindered
    def view(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> Views:
        """The scene from the poses [F, 4, 4], mended."""
        mended: FloatArray = se3.inverse(self.world_from_reference) @ world_from_cam
        if self.errors is not None:
            mended = self.errors.mended(mended, seconds_of(self.seconds, len(world_from_cam)))
        steered = se3.compose(mended[:, :3, :3], mended[:, :3, 3] @ self.steering.T)
        if self.way is not None:
            steered = self.way.followed(steered)
        if self.road is not None:
            steered = self.road.carried(steered)
        return self.scene.view(self.world_from_reference @ steered, intrinsics)


@dataclass(frozen=True)
class VolumeFusion:
    """All observed frames in one truncated signed distance volume that is ray-cast (Curless & Levoy 1996).

    Depths are in median depths of the last frame, so that any unit of the poses will do. Surfaces are averaged over
    frames and smooth over voxels; colours are the last frame's where it shows them, else the voxels'. Open3D's threads
    take blocks in any order: up to one pixel in ten thousand differs from run to run.
    """

    depth: DepthSource = field(default_factory=Multiview)
    fill: Fill = field(default_factory=NearestBackground)
    num_frames: int = 10  # how many of the last observed frames are used
    voxel_px: float = 2.5  # the edge of a voxel, as seen at the median depth
    reach: float = 5.0  # what is farther lies on a far plane
    agreement: float = 0.3  # a surface is what the last frame shows when inverse depths differ by at most this share

    def __post_init__(self) -> None:
        """Raise BadData for settings that make no sense."""
        if self.num_frames < 1:
            raise BadData(f"num_frames is {self.num_frames}, expected 1 or more observed frames to use")
        if not (0 < self.agreement < 1 and 0 < self.reach < 2 * self.voxel_px + 1):
            given = f"agreement {self.agreement}, voxel_px {self.voxel_px} and reach {self.reach}"
            raise BadData(f"{given}: agreement must lie between 0 and 1, reach between 0 and 2 voxel_px + 1")

    @property
    def needs(self) -> Grant:
        """What the depth source needs."""
        return self.depth.needs

    @unhindered
    def reconstruct(self, context: Context, past: Trajectory) -> volume.VolumeScene:
        """The volume of the last `num_frames` frames, in the world frame and the unit of the past."""
        recent, past = context.only(self.depth.needs).recent(self.num_frames), past[-self.num_frames :]
        inverse_depths, confidence = self.depth.inverse_depths(recent, past)
        known = confidence > 0
        known[-1] = True  # the last frame keeps all its pixels, as completed
        filled = volume.integrate(
            recent.frames, inverse_depths, known, recent.intrinsics, past.world_from_cam, self.voxel_px, self.reach
        )
        last = surface.Source(recent.frames[-1], recent.intrinsics, past.world_from_cam[-1])
        return volume.VolumeScene(filled, last, inverse_depths[-1].astype(np.float32), self.agreement, self.fill)
