"""The simple predictive-display model: a flat road below the horizon, everything else infinitely
far away.

The road moves by its plane-induced homography, the rest by the infinite homography of a rotating
camera. It holds on open, flat roads; upright objects close by are smeared over the road.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, planar, se3
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import Inpainter
from geovp_classic.observation import recent
from geovp_classic.rendering import patches
from geovp_classic.rendering.inpainting import inpainted_views
from geovp_classic.rendering.source import Source, resampled, warp
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    PrivilegedInput,
    Trajectory,
    Views,
)


@dataclass(frozen=True)
class GroundFarPlane:
    """Ground plane and far plane of the last observed frame, from the camera's height and the
    horizon.
    """

    inpainter: Inpainter = DetailTransfer()
    # A shorter path has no direction of travel: the pitch is 0. Set by hand: heights are a tenth as
    # exact.
    min_path_m: float = 0.1

    needs = PrivilegedInput.CAMERA_HEIGHT

    def reconstruct(self, context: Context, past: Trajectory) -> "GroundFarScene":
        """Return the two planes; raise Incompatible without a camera height or metric poses."""
        context, past = recent(context, past, "crop", len(past))
        if context.camera_height_m is None:
            raise Incompatible(
                "ground-far-plane needs the camera's height, the clip has none: set camera_height_m"
            )
        if not past.is_metric:
            raise Incompatible(
                "the camera's height is in metres, the poses are not: give the odometry a scale"
            )
        level_from_cam = planar.level_vehicle_from_cam(self._pitch_rad(past))
        normal_last = level_from_cam[1, :3]
        last = Source(context.frames[-1], context.intrinsics, past.world_from_cam[-1])
        return GroundFarScene(last, normal_last, context.camera_height_m, self.inpainter)

    def _pitch_rad(self, past: Trajectory) -> float:
        """Return how far the camera looks above the ground.

        This is its angle to the direction of travel, averaged over the past, because a vehicle
        travels along its road.
        """
        after_from_before = se3.inverse(se3.steps(past.world_from_cam))
        steps_m = -after_from_before[:, :3, 3]
        if np.abs(steps_m[:, 2]).sum() <= self.min_path_m:
            return 0.0
        return planar.travel_pitch_rad(steps_m)


@dataclass(frozen=True)
class GroundFarScene:
    """The last observed frame, laid on the ground below the horizon and on infinity above it."""

    last: Source
    normal_last: FloatArray  # [3], unit normal of the ground, downwards, in the last camera's frame
    height_m: float
    inpainter: Inpainter

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4]; uncovered outside the last frame."""
        views = [self._view(pose, intrinsics) for pose in world_from_cam]
        return inpainted_views(views, self.inpainter, resampled(self.last, intrinsics))

    def _view(
        self, world_from_cam: FloatArray, intrinsics: Intrinsics
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """Return frame [H, W, 3], coverage and depth [H, W] from one pose."""
        inverse_depth = self._inverse_depth(world_from_cam, intrinsics)
        frame, covered, _, _ = warp(self.last, inverse_depth, world_from_cam, intrinsics)
        return frame, covered, patches.depths(inverse_depth, covered)

    def _inverse_depth(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> FloatArray:
        """Return the inverse depth [H, W]: of the ground below this view's horizon, 0 above it.

        It is NaN on the ground when the camera is below the ground.
        """
        last_from_cam = se3.inverse(self.last.world_from_source) @ world_from_cam
        normal_cam = self.normal_last @ last_from_cam[:3, :3]
        height_m = self.height_m - self.normal_last @ last_from_cam[:3, 3]
        below_horizon = pinhole.rays(intrinsics) @ normal_cam
        ground = below_horizon / height_m if height_m > 0 else np.nan
        return np.where(below_horizon > 0, ground, 0.0)
