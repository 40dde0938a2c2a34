"""Drawings in images: the planned path, inpainted pixels and warnings."""

import textwrap

import cv2
import numpy as np

from geovp_classic.streaming import LiveView
from geovp_classic.types import ByteArray, FloatArray, IntArray

PATH_RGB = (64, 220, 120)
WARNING_RGB = (200, 30, 30)


def draw_view(view: LiveView, is_dimming: bool) -> ByteArray:
    """Return the frame of a view [H, W, 3] with its path, and darker inpainted pixels if asked."""
    brightness = np.where(view.covered, 1.0, 0.4)[..., None] if is_dimming else 1.0
    frame = (view.frame * brightness).astype(np.uint8)
    return draw_path(frame, view.path_px, view.path_sides_px)


def draw_path(
    frame: ByteArray,  # [H, W, 3]
    path_px: FloatArray,  # [M, 2], NaN behind the camera
    sides_px: FloatArray,  # [2, M, 2], left and right edge of its uncertainty
    opacity: float = 0.35,
) -> ByteArray:
    """Return the frame with a line along the path, and its uncertainty as a translucent area."""
    is_ahead = np.isfinite(path_px).all(axis=-1) & np.isfinite(sides_px).all(axis=(0, 2))
    if is_ahead.sum() < 2:
        return frame
    limit_px = 10.0 * max(frame.shape)  # OpenCV's coordinates are 16 bits here
    left, right = np.clip(sides_px[:, is_ahead], -limit_px, limit_px)
    outline = np.concatenate([left, right[::-1]])
    area = frame.copy()
    cv2.fillPoly(area, [_pixels(outline)], PATH_RGB, cv2.LINE_AA)
    drawn = cv2.addWeighted(area, opacity, frame, 1 - opacity, 0)
    line = np.clip(path_px[is_ahead], -limit_px, limit_px)
    return cv2.polylines(drawn, [_pixels(line)], False, PATH_RGB, 2, cv2.LINE_AA)


def draw_warning(frame: ByteArray, warning: str) -> ByteArray:
    """Return the frame [H, W, 3] with a red border and a red banner that states the warning."""
    drawn = np.ascontiguousarray(frame).copy()
    height_px, width_px = drawn.shape[:2]
    scale = max(0.35, min(1.0, height_px / 400))
    lines = textwrap.wrap(f"WARNING: {warning}", int(width_px / (20 * scale)))  # 20 px a letter
    step_px = int(28 * scale)
    bottom_px = step_px * len(lines) + 4
    cv2.rectangle(drawn, (0, 0), (width_px - 1, bottom_px), WARNING_RGB, cv2.FILLED)
    cv2.rectangle(drawn, (0, 0), (width_px - 1, height_px - 1), WARNING_RGB, 4)
    for number, line in enumerate(lines, 1):
        corner_px, font = (6, step_px * number - 2), cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(drawn, line, corner_px, font, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return drawn


def _pixels(points_px: FloatArray) -> IntArray:
    """Return points [M, 2] as OpenCV draws them, rounded to whole pixels."""
    return np.rint(points_px).astype(np.int32)[:, None]
