"""Backward sampling: for every pixel of a new view, find where a source image shows it, and read the colour there.

Reading the source with one interpolation keeps it sharp where a splat of colours would blur or tear it.
"""

from __future__ import annotations

import cv2
import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

IN_FRONT = 1e-6  # the smallest z, relative to the ray, of a point that the source camera sees
OUTSIDE_PX = -1e4  # stands for "the source does not show it"


def source_pixels(
    source_from_view: FloatArray,  # [4, 4]
    inverse_depth: FloatArray,  # [H, W] in the view; 0 = infinitely far, NaN = nothing there
    view_camera: Intrinsics,
    source_camera: Intrinsics,
) -> FloatArray:
    """Pixels [H, W, 2] of the source that show what the view's pixels show; far outside for what it cannot see."""
    directions = pinhole.rays(view_camera) @ source_from_view[:3, :3].T
    points = directions + inverse_depth[..., None] * source_from_view[:3, 3]  # true for points at infinity as well
    in_front = points[..., 2] > IN_FRONT
    pixels, _ = pinhole.project(np.where(in_front[..., None], points, [0.0, 0.0, 1.0]), source_camera)
    return np.where(in_front[..., None], pixels, OUTSIDE_PX)


def inside(
    pixels: FloatArray,  # [H, W, 2]
    camera: Intrinsics,
) -> BoolArray:
    """Which pixels [H, W] lie on the image, borders of the outermost pixels included."""
    u, v = pixels[..., 0], pixels[..., 1]
    return (u >= -0.5) & (u <= camera.width_px - 0.5) & (v >= -0.5) & (v <= camera.height_px - 0.5)


def sample(
    frame: ByteArray,  # [H', W', 3]
    pixels: FloatArray,  # [H, W, 2]
) -> ByteArray:
    """Bicubic colours [H, W, 3] at the pixels; outside, the colour of the border."""
    u, v = np.moveaxis(pixels.astype(np.float32), -1, 0)
    return np.asarray(cv2.remap(frame, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))
