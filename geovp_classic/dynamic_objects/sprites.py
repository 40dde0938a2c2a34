"""Sprites (billboards) of dynamic objects: masked out of the static scene and composited where they
have moved to.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import Scene
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    FloatArray,
    Intrinsics,
    Views,
)

Window = tuple[slice, slice]  # rows and columns of a view


@dataclass(frozen=True)
class SpriteLayer:
    """A rendered sprite, in a window of the view."""

    window: Window
    colours: ByteArray  # [h, w, 3]
    opacity: FloatArray  # [h, w] in [0, 1]
    inverse_depth: FloatArray  # [h, w]


@dataclass(frozen=True)
class Sprite:
    """A part of an image at one depth, facing the camera that took it, at a constant velocity."""

    frame: ByteArray  # [H, W, 3]
    mask: BoolArray  # [H, W], its pixels; at least one
    camera: Intrinsics
    world_from_source: FloatArray  # [4, 4]
    depth: float  # z in the source's frame when the image was taken
    velocity: FloatArray  # [3] in the source's frame, per second
    min_depth_ratio: float = (
        0.1  # over the observed depth; nearer sprites are not rendered
    )

    def render(
        self, world_from_cam: FloatArray, camera: Intrinsics, seconds: float
    ) -> SpriteLayer | None:
        """Render the sprite `seconds` after the image was taken; None out of view or too near.

        A plane that faces the source is seen by a homography (Hartley & Zisserman 2004, eq. 13.1).
        """
        cam_from_source = se3.inverse(world_from_cam) @ self.world_from_source
        rotation = cam_from_source[:3, :3]
        shift = rotation @ (seconds * self.velocity) + cam_from_source[:3, 3]
        motion = rotation + np.outer(shift / self.depth, [0, 0, 1])
        rays_from_source = motion @ np.linalg.inv(self.camera.matrix)
        window = self._window(camera.matrix @ rays_from_source, camera)
        if window is None:
            return None
        left, top, width_px, height_px = window
        part = camera.cropped(left, top, width_px, height_px)
        homography = part.matrix @ rays_from_source
        size_px = (width_px, height_px)
        border = cv2.BORDER_REPLICATE
        colours = cv2.warpPerspective(
            self.frame,
            homography,
            size_px,
            flags=cv2.INTER_CUBIC,
            borderMode=border,
        )
        opacity = cv2.warpPerspective(
            self.mask.astype(np.float32), homography, size_px
        )
        normal = rotation[:, 2]
        inverse_depth = (
            pinhole.rays(part) @ normal / (self.depth + normal @ shift)
        )
        place = (slice(top, top + height_px), slice(left, left + width_px))
        return SpriteLayer(
            place,
            np.asarray(colours, np.uint8),
            np.asarray(opacity),
            inverse_depth,
        )

    def _window(
        self, view_from_source: FloatArray, camera: Intrinsics, rim_px: int = 2
    ) -> tuple[int, int, int, int] | None:
        """Return (left, top, width, height) of the mask in a view; None outside or too near."""
        left, top, width, height = cv2.boundingRect(self.mask.astype(np.uint8))
        right = left + width
        bottom = top + height
        corners = np.array(
            [
                (left - 1, top - 1, 1),
                (right, top - 1, 1),
                (left - 1, bottom, 1),
                (right, bottom, 1),
            ]
        )
        points = corners @ view_from_source.T
        if points[:, 2].min() < self.min_depth_ratio:
            return None
        pixels = points[:, :2] / points[:, 2:]
        size_px = (camera.width_px, camera.height_px)
        first = np.floor(pixels.min(axis=0)) - rim_px
        end = np.ceil(pixels.max(axis=0)) + rim_px + 1
        left, top = np.clip(first, 0, size_px).astype(int).tolist()
        right, bottom = np.clip(end, 0, size_px).astype(int).tolist()
        if left >= right or top >= bottom:
            return None
        return left, top, right - left, bottom - top


def mask_out(
    sprites: Sequence[Sprite],
    inverse_depths: FloatArray,  # [P, H, W]
    world_from_cam: FloatArray,  # [P, 4, 4]
    seconds: FloatArray,  # [P], since the sprites' image, negative before it
) -> tuple[FloatArray, BoolArray]:
    """Return depths with the objects where they were, and the masks of the objects [P, H, W].

    The depths show which surfaces the objects hid; the masks keep them out of the static scene.
    """
    depths = inverse_depths.copy()
    masks = np.zeros(inverse_depths.shape, bool)
    for sprite in sprites:
        for step, pose in enumerate(world_from_cam):
            layer = sprite.render(pose, sprite.camera, float(seconds[step]))
            if layer is not None:
                place = (step, *layer.window)
                is_opaque = layer.opacity > 0
                depths[place] = np.where(
                    is_opaque, layer.inverse_depth, depths[place]
                )
                masks[place] |= is_opaque
    return depths, masks


@dataclass(frozen=True)
class DynamicScene:
    """A static scene with sprites that move through it."""

    static: Scene
    sprites: Sequence[Sprite]
    last_s: float  # the time of the sprites' frame, the last observed one
    # Over the depth of the static scene; such a sprite is in front, because it stands on the road.
    max_depth_ratio: float = 1.02

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4]; visible sprites count as covered."""
        views = self.static.view(world_from_cam, times_s, intrinsics)
        frames = views.frames.copy()
        covered = views.covered.copy()
        depths = views.depths.copy()
        for step, since_s in enumerate(times_s - self.last_s):
            for sprite in self.sprites:
                layer = sprite.render(
                    world_from_cam[step], intrinsics, float(since_s)
                )
                if layer is not None:
                    place = (step, *layer.window)
                    self._composite(
                        layer, frames[place], covered[place], depths[place]
                    )
        return Views(frames, covered, depths)

    def _composite(
        self,
        layer: SpriteLayer,
        frame: ByteArray,  # [h, w, 3], changed like the other two
        covered: BoolArray,  # [h, w]
        depth: FloatArray,  # [h, w], 0 = unknown
    ) -> None:
        """Composite the layer over farther and over inpainted pixels."""
        sprite_depth = 1 / layer.inverse_depth
        is_in_front = (
            ~covered
            | (depth <= 0)
            | (sprite_depth < self.max_depth_ratio * depth)
        )
        alpha = np.where(is_in_front, layer.opacity, 0)
        difference = layer.colours.astype(np.float32) - frame
        mixed = frame + alpha[..., None] * difference
        frame[:] = (mixed + 0.5).astype(np.uint8)
        is_opaque = alpha > 0.5
        covered |= is_opaque
        depth[is_opaque] = sprite_depth[is_opaque]
