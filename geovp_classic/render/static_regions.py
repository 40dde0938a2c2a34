"""What of the image shows no scene: black bars, and the ego vehicle's parts, such as a hood behind the windscreen.

It stays in place while the road moves: a surface that drives along, to any reconstruction. So it is cut off before
anything is estimated, and every view shows it as the last frame did.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.geometry.static_regions import scene_window, static_mask
from geovp_classic.interfaces import Scene
from geovp_classic.types import BoolArray, ByteArray, Context, ExtraView, FloatArray, Intrinsics, Views


@dataclass(frozen=True)
class MaskedScene:
    """A scene behind a mask of static regions."""

    scene: Scene
    frame: ByteArray  # [H, W, 3], the last observed one
    camera: Intrinsics
    mask: BoolArray  # [H, W], the static regions

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The scene from the poses [F, 4, 4] at the times [F]; other cameras than that of the frames show it alone."""
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        if intrinsics != self.camera:
            return views
        frames = np.where(self.mask[..., None], self.frame, views.frames)
        return Views(frames, views.covered | self.mask, views.depths)


def without_static_regions(context: Context) -> Context:
    """The context with its frames, uncropped ones and depths cut down to the scene; as it is with right frames."""
    if context.right is not None:
        return context
    wide = context.wide
    if wide is not None:
        rows, columns = scene_window(static_mask(wide.frames))
        wide = ExtraView(wide.frames[:, rows, columns], _cut(wide.intrinsics, rows, columns), wide.view_from_cam)
    rows, columns = scene_window(static_mask(context.frames))
    return replace(
        context,
        frames=context.frames[:, rows, columns],
        intrinsics=_cut(context.intrinsics, rows, columns),
        past_depths=None if context.past_depths is None else context.past_depths[:, rows, columns],
        wide=wide,
    )


def behind_static_regions(scene: Scene, context: Context) -> Scene:
    """The scene behind the static regions of the frames; the scene itself where there are none."""
    mask = static_mask(context.frames) if context.right is None else np.zeros((1, 1), bool)
    return MaskedScene(scene, context.frames[-1], context.intrinsics, mask) if mask.any() else scene


def _cut(camera: Intrinsics, rows: slice, columns: slice) -> Intrinsics:
    return camera.cropped(columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start)
