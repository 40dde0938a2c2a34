"""Sprites (billboards) of dynamic objects: masked out of the static scene and composited where they
have moved to.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.interfaces import Scene
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics, Views

# a sprite up to this factor farther than the static scene is in front: it stands on the road
NEARER = 1.02
NEAR_SHARE = 0.1  # of its observed depth: nearer objects are not rendered
RIM_PX = 2  # around the window of a sprite

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
    """A part of an image at one depth, facing the camera that took it, that moves at a constant
    velocity.
    """

    frame: ByteArray  # [H, W, 3]
    mask: BoolArray  # [H, W], which pixels belong to it; at least one
    camera: Intrinsics
    world_from_source: FloatArray  # [4, 4]
    depth: float  # z in the source's frame when the image was taken
    velocity: FloatArray  # [3] in the source's frame, per second

    def render(
        self, world_from_cam: FloatArray, camera: Intrinsics, seconds: float
    ) -> SpriteLayer | None:
        """The sprite `seconds` after the image was taken; None where it is out of view or
        too near.
        """
        cam_from_source = se3.inverse(world_from_cam) @ self.world_from_source
        rotation = cam_from_source[:3, :3]
        shift = rotation @ (seconds * self.velocity) + cam_from_source[:3, 3]
        facing = rotation + np.outer(
            shift / self.depth, [0, 0, 1]
        )  # Hartley & Zisserman 2004, eq. 13.1
        view_from_source = camera.matrix @ facing @ np.linalg.inv(self.camera.matrix)
        window = self._window(view_from_source, camera)
        if window is None:
            return None
        rows, columns = window
        window_from_source = (
            np.array([[1, 0, -columns.start], [0, 1, -rows.start], [0, 0, 1]]) @ view_from_source
        )
        size = (columns.stop - columns.start, rows.stop - rows.start)
        colours = cv2.warpPerspective(
            self.frame,
            window_from_source,
            size,
            flags=cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
        opacity = cv2.warpPerspective(
            self.mask.astype(np.float32), window_from_source, size, flags=cv2.INTER_LINEAR
        )
        inverse_depth = (
            pinhole.rays(camera)[window] @ rotation[:, 2] / (self.depth + rotation[:, 2] @ shift)
        )
        return SpriteLayer(
            window, np.asarray(colours, np.uint8), np.asarray(opacity), inverse_depth
        )

    def _window(self, view_from_source: FloatArray, camera: Intrinsics) -> Window | None:
        """The window of the view that holds the mask; None when out of view or nearer than
        NEAR_SHARE.
        """
        rows, columns = np.flatnonzero(self.mask.any(axis=1)), np.flatnonzero(self.mask.any(axis=0))
        u, v = np.meshgrid(columns[[0, -1]] + [-1, 1], rows[[0, -1]] + [-1, 1])
        corners = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3) @ view_from_source.T
        if corners[:, 2].min() < NEAR_SHARE:
            return None
        pixels = corners[:, :2] / corners[:, 2:]
        size = np.array([camera.width_px, camera.height_px])
        first = np.clip(np.floor(pixels.min(axis=0)) - RIM_PX, 0, size).astype(int)
        end = np.clip(np.ceil(pixels.max(axis=0)) + RIM_PX + 1, 0, size).astype(int)
        if (first >= end).any():
            return None
        return slice(int(first[1]), int(end[1])), slice(int(first[0]), int(end[0]))


def mask_out(
    sprites: tuple[Sprite, ...],
    inverse_depths: FloatArray,  # [P, H, W]
    confidence: FloatArray,  # [P, H, W]
    world_from_cam: FloatArray,  # [P, 4, 4]
    seconds: FloatArray,  # [P] since the sprites' image, negative before it
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Depths with the objects where they were, confidence 0 there, and their masks [P, H, W].

    Objects stay in the depths, because they occlude; a confidence of 0 keeps them out of the static
    scene.
    """
    mask = np.zeros(inverse_depths.shape, dtype=bool)
    if not sprites:
        return inverse_depths, confidence, mask
    depths = inverse_depths.copy()
    for sprite in sprites:
        for step, pose in enumerate(world_from_cam):
            layer = sprite.render(pose, sprite.camera, float(seconds[step]))
            if layer is not None:
                opaque = layer.opacity > 0
                depths[step][layer.window] = np.where(
                    opaque, layer.inverse_depth, depths[step][layer.window]
                )
                mask[step][layer.window] |= opaque
    return depths, np.where(mask, 0, confidence), mask


@dataclass(frozen=True)
class DynamicScene:
    """A static scene with sprites that move through it."""

    static: Scene
    sprites: tuple[Sprite, ...]
    last_s: float  # the time of the sprites' frame, the last observed one

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The scene from the poses [F, 4, 4]; sprites in front are composited and count as
        covered.
        """
        views = self.static.view(world_from_cam, times_s, intrinsics)
        frames, covered, depths = views.frames.copy(), views.covered.copy(), views.depths.copy()
        for k, since_s in enumerate(times_s - self.last_s):
            for sprite in self.sprites:
                layer = sprite.render(world_from_cam[k], intrinsics, float(since_s))
                if layer is not None:
                    place = (k, *layer.window)
                    frames[place], covered[place], depths[place] = _composite_over(
                        frames[place], covered[place], depths[place], layer
                    )
        return Views(frames, covered, depths)


def _composite_over(
    frame: ByteArray,  # [h, w, 3]
    covered: BoolArray,  # [h, w]
    depth: FloatArray,  # [h, w], 0 = unknown
    layer: SpriteLayer,
) -> tuple[ByteArray, BoolArray, FloatArray]:
    """The layer composited over farther and over invented pixels."""
    own = 1 / layer.inverse_depth
    alpha = np.where(~covered | (depth <= 0) | (own < NEARER * depth), layer.opacity, 0)
    mixed = frame + alpha[..., None] * (layer.colours.astype(np.float32) - frame)
    opaque = alpha > 0.5
    return (
        (mixed + 0.5).astype(np.uint8),
        covered | opaque,
        np.where(opaque, own, depth).astype(np.float32),
    )
