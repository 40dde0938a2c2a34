"""What of the image shows no scene: black bars, the ego vehicle's parts, such as a hood, and a
vehicle it follows.

It stays in place while the road moves: a surface that drives along, to any reconstruction. So it is
cut off, or painted over, before anything is estimated, and every view shows it as the last frame
did, or where it has gone.
"""

import functools
from dataclasses import dataclass, replace

import cv2
import numpy as np

from geovp_classic.interfaces import Scene
from geovp_classic.observation.followed_vehicle import FollowedVehicle, followed_vehicle
from geovp_classic.observation.static_regions import scene_window, static_mask
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    ExtraView,
    FloatArray,
    Intrinsics,
    Views,
)

INPAINT_PX = 3.0


@dataclass(frozen=True)
class MaskedScene:
    """A scene behind a mask of static regions and a followed vehicle."""

    scene: Scene
    frame: ByteArray  # [H, W, 3], the last observed one
    camera: Intrinsics
    mask: BoolArray  # [H, W], the static regions
    vehicle: FollowedVehicle | None  # in the window of the mask that shows the scene
    observed_s: tuple[float, float]  # the times of the first and the last frame

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """The scene from the poses [F, 4, 4] at the times [F]; other cameras than that of the
        frames show it alone.
        """
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        if intrinsics != self.camera:
            return views
        frames, covered = (
            np.where(self.mask[..., None], self.frame, views.frames),
            views.covered | self.mask,
        )
        if self.vehicle is not None:
            rows, columns = scene_window(self.mask)
            seen, outline = (
                np.ascontiguousarray(self.frame[rows, columns]),
                self.vehicle.mask.astype(np.uint8),
            )
            for index, share in enumerate(_shares(times_s, self.observed_s)):
                shown = self.vehicle.moved(outline, share) > 0
                frames[index, rows, columns][shown] = self.vehicle.moved(seen, share)[shown]
                covered[index, rows, columns] |= shown
        return Views(frames, covered, views.depths)


def hidden_mask(context: Context) -> BoolArray:
    """The pixels [H, W] of the last observed frame that show no scene."""
    found, vehicle, _ = _regions(context)
    mask = found.copy()
    if vehicle is not None:
        mask[scene_window(mask)] |= vehicle.mask
    return mask


def without_static_regions(context: Context) -> Context:
    """The context with its frames, uncropped ones and depths cut down to the scene; as it is with
    right frames.

    A followed vehicle is painted over in the colours around it.
    """
    if context.right is not None:
        return context
    wide = context.full
    mask, vehicle, wide_mask = _regions(context)
    if wide is not None and wide_mask is not None:
        rows, columns = scene_window(wide_mask)
        wide = ExtraView(
            wide.frames[:, rows, columns], _cut(wide.intrinsics, rows, columns), wide.view_from_cam
        )
    rows, columns = scene_window(mask)
    frames, camera = context.frames[:, rows, columns], _cut(context.intrinsics, rows, columns)
    if vehicle is not None:
        past_s, outline = context.times_s[: context.num_past], vehicle.mask.astype(np.uint8)
        masks = [
            vehicle.moved(outline, share) for share in _shares(past_s, (past_s[0], past_s[-1]))
        ]
        frames = _inpainted(frames, masks)
        if wide is not None:
            masks = [_seen_by(wide, one, camera) for one in masks]
            wide = replace(wide, frames=_inpainted(wide.frames, masks))
    return replace(
        context,
        frames=frames,
        intrinsics=camera,
        past_depths=None if context.past_depths is None else context.past_depths[:, rows, columns],
        full=wide,
    )


def behind_static_regions(scene: Scene, context: Context) -> Scene:
    """The scene behind the static regions of the frames; the scene itself where there are none."""
    if context.right is not None:
        return scene
    mask, vehicle, _ = _regions(context)
    if vehicle is None and not mask.any():
        return scene
    observed_s = float(context.times_s[0]), float(context.times_s[context.num_past - 1])
    return MaskedScene(scene, context.frames[-1], context.intrinsics, mask, vehicle, observed_s)


def _regions(context: Context) -> tuple[BoolArray, FollowedVehicle | None, BoolArray | None]:
    """The static mask [H, W], a followed vehicle in the window that it leaves, and the mask of
    uncropped frames.

    What only the uncropped frames show to be static is so in the crop as well.
    """
    pixels, shape, camera, wide = (
        context.frames.tobytes(),
        context.frames.shape,
        context.intrinsics,
        context.full,
    )
    mask, wide_mask = _static(pixels, shape), None if wide is None else static_mask(wide.frames)
    if wide is not None and wide_mask is not None and not mask.any():
        crop_from_wide = camera.matrix @ np.linalg.inv(wide.intrinsics.matrix)
        size_px = camera.width_px, camera.height_px
        mask = (
            cv2.warpAffine(
                wide_mask.astype(np.uint8), crop_from_wide[:2], size_px, flags=cv2.INTER_NEAREST
            )
            > 0
        )
    rows, columns = scene_window(mask)
    return (
        mask,
        _followed(pixels, shape, rows.start, rows.stop, columns.start, columns.stop),
        wide_mask,
    )


@functools.lru_cache(
    maxsize=2
)  # pose source and renderer are shown the same frames, and so is what views are behind
def _static(pixels: bytes, shape: tuple[int, ...]) -> BoolArray:
    mask = static_mask(np.frombuffer(pixels, np.uint8).reshape(shape))
    mask.flags.writeable = False
    return mask


@functools.lru_cache(maxsize=2)
def _followed(
    pixels: bytes, shape: tuple[int, ...], top: int, bottom: int, left: int, right: int
) -> FollowedVehicle | None:
    return followed_vehicle(
        np.frombuffer(pixels, np.uint8).reshape(shape)[:, top:bottom, left:right]
    )


def _shares(times_s: FloatArray, observed_s: tuple[float, float]) -> FloatArray:
    """Shares [F] of the way from the last observed time back to the first."""
    first_s, last_s = observed_s
    return (last_s - times_s) / (last_s - first_s)


def _cut(camera: Intrinsics, rows: slice, columns: slice) -> Intrinsics:
    return camera.cropped(
        columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start
    )


def _inpainted(frames: ByteArray, masks: list[ByteArray]) -> ByteArray:
    """Frames [P, H, W, 3] with the pixels of their masks [H, W] filled from around them (Telea
    2004).
    """
    pairs = zip(frames, masks, strict=True)
    return np.stack(
        [cv2.inpaint(np.array(one), mask, INPAINT_PX, cv2.INPAINT_TELEA) for one, mask in pairs]
    )


def _seen_by(wide: ExtraView, mask: ByteArray, camera: Intrinsics) -> ByteArray:
    """A camera's mask [H, W] in the uncropped image [H', W']."""
    wide_from_crop = wide.intrinsics.matrix @ np.linalg.inv(camera.matrix)
    size_px = wide.intrinsics.width_px, wide.intrinsics.height_px
    return np.asarray(
        cv2.warpAffine(mask, wide_from_crop[:2], size_px, flags=cv2.INTER_NEAREST), np.uint8
    )
