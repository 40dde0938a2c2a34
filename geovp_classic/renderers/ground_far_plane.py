"""The simple predictive-display model: a flat road below the horizon, everything else infinitely
far away.

The road moves by its plane-induced homography, the rest by the infinite homography of a rotating
camera. It holds on open, flat roads; upright objects close by are smeared over the road.
"""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, planar, se3
from geovp_classic.inpainters.detail_transfer import DetailTransfer
from geovp_classic.interfaces import Inpainter
from geovp_classic.observation import recent
from geovp_classic.rendering import patches
from geovp_classic.rendering.image_sampler import resampled, warp
from geovp_classic.rendering.standing import StandingScene
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

MOVED_M = 0.1  # a shorter path does not tell the direction of travel


@dataclass(frozen=True)
class GroundFarPlane:
    """Ground plane and far plane of the last observed frame, from the camera's height and the
    horizon.

    `pitch_deg` says how far the camera looks above the ground, `roll_deg` how far it is rolled
    clockwise. Without `pitch_deg` the pitch is that of the direction of travel, averaged over the
    past, and 0 where the camera did not move: a vehicle travels along its road. A pitch known from
    the mounting is better than one second of noisy heights.
    """

    inpainter: Inpainter = field(default_factory=DetailTransfer)
    pitch_deg: float | None = None
    roll_deg: float = 0.0

    needs = PrivilegedInput.CAMERA_HEIGHT  # the camera's height above the ground

    def reconstruct(self, context: Context, past: Trajectory) -> StandingScene:
        """The two planes; Incompatible without a camera height or without metric poses."""
        context, past = recent(context, past, "crop", len(past))
        if context.camera_height_m is None:
            raise Incompatible(
                "ground-far-plane needs the camera's height, the clip has none: set camera_height_m"
            )
        if not past.is_metric:
            raise Incompatible(
                "the camera's height is in metres, the poses are not: give the odometry a scale"
            )
        roll_rad = float(np.deg2rad(self.roll_deg))
        pitch_rad = (
            _travel_pitch_rad(past, roll_rad)
            if self.pitch_deg is None
            else float(np.deg2rad(self.pitch_deg))
        )
        last = patches.Source(context.frames[-1], context.intrinsics, past.world_from_cam[-1])
        normal_last = planar.level_vehicle_from_cam(pitch_rad, roll_rad)[1, :3]
        scene = GroundFarScene(last, normal_last, context.camera_height_m, self.inpainter)
        largest_inverse_depth = (
            float((pinhole.rays(context.intrinsics) @ normal_last).max()) / context.camera_height_m
        )
        return StandingScene(scene, last, largest_inverse_depth)


@dataclass(frozen=True)
class GroundFarScene:
    """The last observed frame, laid on the ground below the horizon and on infinity above it."""

    last: patches.Source
    normal_last: FloatArray  # [3], unit normal of the ground, downwards, in the last camera's frame
    height_m: float
    inpainter: Inpainter

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The two planes from the poses [F, 4, 4]; uncovered where the last frame shows nothing of
        them.
        """
        views = [self._view_one(pose, intrinsics) for pose in world_from_cam]
        frames, covered, depths = (np.stack(maps) for maps in zip(*views, strict=True))
        return Views(
            self.inpainter.inpaint(
                Views(frames, covered, depths), resampled(self.last, intrinsics)
            ),
            covered,
            depths,
        )

    def _view_one(
        self, world_from_cam: FloatArray, intrinsics: Intrinsics
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """Frame [H, W, 3], coverage and depth [H, W] from one pose."""
        inverse_depth = self._inverse_depth(world_from_cam, intrinsics)
        frame, covered, _, _ = warp(self.last, inverse_depth, world_from_cam, intrinsics)
        return frame, covered, patches.depths(inverse_depth, covered)

    def _inverse_depth(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> FloatArray:
        """[H, W]: of the ground below this view's horizon, 0 above it; NaN when the camera is below
        the ground.
        """
        last_from_cam = se3.inverse(self.last.world_from_source) @ world_from_cam
        normal_cam = self.normal_last @ last_from_cam[:3, :3]
        height_m = self.height_m - self.normal_last @ last_from_cam[:3, 3]
        below_horizon = pinhole.rays(intrinsics) @ normal_cam
        ground = below_horizon / height_m if height_m > 0 else np.full(below_horizon.shape, np.nan)
        return np.where(below_horizon > 0, ground, 0.0)


def _travel_pitch_rad(past: Trajectory, roll_rad: float) -> float:
    """How far the camera looks above its direction of travel, over all past steps; 0 when it stood
    still.
    """
    rotations, positions = past.world_from_cam[:, :3, :3], past.world_from_cam[:, :3, 3]
    steps_cam = np.einsum(
        "nji,nj->ni", rotations[1:], np.diff(positions, axis=0)
    )  # each in its own camera's frame
    unrolled = steps_cam @ planar.level_vehicle_from_cam(0.0, roll_rad)[:3, :3].T
    return planar.travel_pitch_rad(unrolled) if np.abs(unrolled[:, 2]).sum() > MOVED_M else 0.0
