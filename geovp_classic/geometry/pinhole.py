"""Points to pixels and back, and the cameras of cropped and resized images."""

import functools

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, FloatArray, Intrinsics


def project(
    points_cam: FloatArray,  # [..., 3], z > 0 for points in front
    camera: Intrinsics,
) -> tuple[FloatArray, FloatArray]:
    """Pixels [..., 2] as (u, v) and depth [...]; pixels of points with z <= 0 are NaN."""
    depth = points_cam[..., 2]
    safe = np.where(depth > 0, depth, np.nan)
    u = camera.fx_px * points_cam[..., 0] / safe + camera.cx_px
    v = camera.fy_px * points_cam[..., 1] / safe + camera.cy_px
    return np.stack([u, v], axis=-1), depth


def unproject(
    pixels: FloatArray,  # [..., 2]
    depth: FloatArray,  # [...]
    camera: Intrinsics,
) -> FloatArray:
    """Points [..., 3] in the camera's frame, at the given z-depth."""
    x = (pixels[..., 0] - camera.cx_px) / camera.fx_px
    y = (pixels[..., 1] - camera.cy_px) / camera.fy_px
    return np.stack([x * depth, y * depth, np.broadcast_to(depth, x.shape)], axis=-1)


def pixel_grid(camera: Intrinsics) -> FloatArray:
    """All pixels [H, W, 2] as (u, v), row by row."""
    u, v = np.meshgrid(
        np.arange(camera.width_px, dtype=np.float64), np.arange(camera.height_px, dtype=np.float64)
    )
    return np.stack([u, v], axis=-1)


@functools.lru_cache(maxsize=8)
def rays(camera: Intrinsics) -> FloatArray:
    """The directions [H, W, 3] of all pixels in the camera's frame, with z = 1; cached, hence
    read-only.
    """
    grid = pixel_grid(camera)
    directions = unproject(grid, np.ones(grid.shape[:2]), camera)
    directions.setflags(write=False)
    return directions


def centre_crop(
    camera: Intrinsics, size_px: tuple[int, int]
) -> tuple[tuple[slice, slice], Intrinsics]:
    """The largest centred window (rows, columns) of an aspect, and its camera resized to size_px =
    (width, height).
    """
    scale = min(camera.width_px / size_px[0], camera.height_px / size_px[1])
    wide_px, high_px = max(1, round(size_px[0] * scale)), max(1, round(size_px[1] * scale))
    left_px, top_px = (camera.width_px - wide_px) // 2, (camera.height_px - high_px) // 2
    window = (slice(top_px, top_px + high_px), slice(left_px, left_px + wide_px))
    return window, camera.cropped(left_px, top_px, wide_px, high_px).resized(*size_px)


def resize(image: ByteArray, size_px: tuple[int, int]) -> ByteArray:
    """The image [H, W, 3] at size_px = (width, height): area average when shrinking, bicubic when
    growing.
    """
    height_px, width_px = image.shape[:2]
    if (width_px, height_px) == tuple(size_px):
        return image
    if min(*size_px, width_px, height_px) < 1:
        raise BadData(
            f"cannot resize an image of {width_px}x{height_px} to {size_px}: sizes must be positive"
        )
    shrinking = size_px[0] < width_px or size_px[1] < height_px
    return np.asarray(
        cv2.resize(image, size_px, interpolation=cv2.INTER_AREA if shrinking else cv2.INTER_CUBIC)
    )


def grey(frame: ByteArray) -> FloatArray:
    """The image [H, W, 3] in grey, float32 0..255."""
    return grey8(frame).astype(np.float32)


def grey8(frame: ByteArray) -> ByteArray:
    """The image [H, W, 3] or [H, W] in grey, in 8 bits."""
    if frame.ndim == 2:
        return frame
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_RGB2GRAY), dtype=np.uint8)
