"""Pinhole camera model: projection, rays, and cropped, resized and grey images."""

import functools

import cv2
import numpy as np

from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics


def project(
    points_cam: FloatArray,  # [..., 3], z > 0 for points in front
    camera: Intrinsics,
) -> tuple[FloatArray, FloatArray]:
    """Return pixels [..., 2] as (u, v) and depth [...]; pixels are NaN where z <= 0."""
    depth = points_cam[..., 2]
    safe = np.where(depth > 0, depth, np.nan)
    u = camera.fx_px * points_cam[..., 0] / safe + camera.cx_px
    v = camera.fy_px * points_cam[..., 1] / safe + camera.cy_px
    return np.stack([u, v], axis=-1), depth


def unproject(
    pixels: FloatArray,  # [..., 2]
    depth: FloatArray | float,  # [...]
    camera: Intrinsics,
) -> FloatArray:
    """Return points [..., 3] in the camera frame at the given z-depth."""
    x = (pixels[..., 0] - camera.cx_px) / camera.fx_px * depth
    y = (pixels[..., 1] - camera.cy_px) / camera.fy_px * depth
    return np.stack([x, y, np.broadcast_to(depth, x.shape)], axis=-1)


def normalised(pixels: FloatArray, camera: Intrinsics) -> FloatArray:
    """Return the normalised coordinates [..., 2] of pixels [..., 2]: their rays at z = 1."""
    return unproject(pixels, 1.0, camera)[..., :2]


def pixel_grid(camera: Intrinsics) -> FloatArray:
    """Return all pixels [H, W, 2] as (u, v)."""
    v, u = np.indices((camera.height_px, camera.width_px), np.float64)
    return np.stack([u, v], axis=-1)


@functools.lru_cache(maxsize=8)
def rays(camera: Intrinsics) -> FloatArray:
    """Return the rays [H, W, 3] of all pixels with z = 1; cached, hence read-only."""
    directions = unproject(pixel_grid(camera), 1.0, camera)
    directions.setflags(write=False)
    return directions


def centre_crop(
    camera: Intrinsics, size_px: tuple[int, int]
) -> tuple[tuple[slice, slice], Intrinsics]:
    """Return the largest centred window of an aspect ratio, and its camera at `size_px`.

    The window is (rows, columns), `size_px` is (width, height).
    """
    scale = min(camera.width_px / size_px[0], camera.height_px / size_px[1])
    width_px = max(1, round(size_px[0] * scale))
    height_px = max(1, round(size_px[1] * scale))
    left_px = (camera.width_px - width_px) // 2
    top_px = (camera.height_px - height_px) // 2
    window = (
        slice(top_px, top_px + height_px),
        slice(left_px, left_px + width_px),
    )
    cropped = camera.cropped(left_px, top_px, width_px, height_px)
    return window, cropped.resized(*size_px)


def resize(image: ByteArray, size_px: tuple[int, int]) -> ByteArray:
    """Resize an image [H, W, 3] to (width, height): area average if smaller, bicubic if larger."""
    height_px, width_px = image.shape[:2]
    if (width_px, height_px) == tuple(size_px):
        return image
    shrinking = size_px[0] < width_px or size_px[1] < height_px
    interpolation = cv2.INTER_AREA if shrinking else cv2.INTER_CUBIC
    return cv2.resize(image, size_px, interpolation=interpolation)


def resize_mask(mask: BoolArray, size_px: tuple[int, int]) -> BoolArray:
    """Resize a mask [H, W] to (width, height), with the values of the nearest pixels."""
    return cv2.resize(mask.view(np.uint8), size_px, interpolation=cv2.INTER_NEAREST_EXACT) > 0


def gradient(image: ByteArray | FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives [H, W] of an image along its rows and its columns (Sobel)."""
    x = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=1 / 8)
    y = cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=1 / 8)
    return x, y


def grey(frame: ByteArray) -> FloatArray:
    """Convert an image [H, W, 3] to grey, float32 0..255."""
    return grey8(frame).astype(np.float32)


def grey8(frame: ByteArray) -> ByteArray:
    """Convert an image [H, W, 3] or [H, W] to grey, uint8."""
    if frame.ndim == 2:
        return frame
    return cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_RGB2GRAY)
