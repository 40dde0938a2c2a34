"""The ego vehicle's parts in the image, such as the hood before a camera behind the windscreen.

They stay in place while the road moves below them: a surface that drives along, to any reconstruction. So
they are cut off before anything is estimated, and every view shows them as the last frame did.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry.vehicle_mask import top_row, vehicle_mask
from geovp_classic.interfaces import Scene
from geovp_classic.types import BoolArray, ByteArray, Context, ExtraView, FloatArray, Intrinsics, Views


@dataclass(frozen=True)
class EgoVehicleScene:
    """A scene behind the vehicle's own parts."""

    scene: Scene
    frame: ByteArray  # [H, W, 3], the last observed one
    camera: Intrinsics
    mask: BoolArray  # [H, W], the vehicle

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The scene from the poses [F, 4, 4] at the times [F]; other cameras than that of the frames show it alone."""
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        if intrinsics != self.camera:
            return views
        frames = np.where(self.mask[..., None], self.frame, views.frames)
        return Views(frames, views.covered | self.mask, views.depths)


def without_vehicle(context: Context) -> Context:
    """The context with its frames, uncropped ones and depths cut off above the vehicle; as it is with right frames."""
    if context.right is not None:
        return context
    wide, top = context.wide, top_row(vehicle_mask(context.frames))
    if wide is not None:
        rows = top_row(vehicle_mask(wide.frames))
        camera = wide.intrinsics.cropped(0, 0, wide.intrinsics.width_px, rows)
        wide = (
            wide if rows == wide.intrinsics.height_px else ExtraView(wide.frames[:, :rows], camera, wide.view_from_cam)
        )
    if top == context.intrinsics.height_px:
        return replace(context, wide=wide)
    depths = None if context.past_depths is None else context.past_depths[:, :top]
    camera = context.intrinsics.cropped(0, 0, context.intrinsics.width_px, top)
    return replace(context, frames=context.frames[:, :top], intrinsics=camera, past_depths=depths, wide=wide)


def with_vehicle(scene: Scene, context: Context) -> Scene:
    """The scene behind what of the vehicle the frames show; the scene itself where they show nothing."""
    mask = vehicle_mask(context.frames) if context.right is None else np.zeros((1, 1), bool)
    return EgoVehicleScene(scene, context.frames[-1], context.intrinsics, mask) if mask.any() else scene
