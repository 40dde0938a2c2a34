"""Drawings in images: the planned path, inpainted pixels and warnings."""

import textwrap

import cv2
import numpy as np
from PIL import Image, ImageDraw

from geovp.drawing.video import outlined
from geovp_classic.streaming import LiveView
from geovp_classic.types import ByteArray, FloatArray


def draw_view(view: LiveView, is_dimming: bool, is_marking: bool = False) -> ByteArray:
    """Return the frame of a view [H, W, 3] with its path.

    On request, inpainted pixels are darker, and what moves on its own has an outline.
    """
    brightness = np.where(view.covered, 1.0, 0.4)[..., None] if is_dimming else 1.0
    frame = (view.frame * brightness).astype(np.uint8)
    frame = draw_path(frame, view.path_px, view.path_sides_px)
    if is_marking and view.moving is not None:
        frame = outlined(frame, view.moving)
    return frame


def draw_path(
    frame: ByteArray,  # [H, W, 3]
    path_px: FloatArray,  # [M, 2], NaN behind the camera
    sides_px: FloatArray,  # [2, M, 2], left and right edge of its uncertainty
    opacity: float = 0.35,
    rgb: tuple[int, int, int] = (64, 220, 120),
) -> ByteArray:
    """Return the frame with a line along the path, and its uncertainty as a translucent area."""
    lines_px = np.stack([sides_px[0], path_px, sides_px[1]])
    is_ahead = np.isfinite(lines_px).all(axis=(0, 2))
    if is_ahead.sum() < 2:
        return frame
    limit_px = 10 * max(frame.shape)  # OpenCV's coordinates are 16 bits here
    lines_px = np.clip(lines_px[:, is_ahead], -limit_px, limit_px)
    left, path, right = np.rint(lines_px).astype(np.int32, order="C")
    outline = np.concatenate([left, right[::-1]])
    area = cv2.fillPoly(frame.copy(), [outline], rgb, cv2.LINE_AA)
    drawn = cv2.addWeighted(area, opacity, frame, 1 - opacity, 0)
    return cv2.polylines(drawn, [path], False, rgb, 2, cv2.LINE_AA)


def draw_border(frame: ByteArray, rgb: tuple[int, int, int] = (255, 140, 0)) -> ByteArray:
    """Return the frame [H, W, 3] with a border, which asks for caution."""
    height_px, width_px = frame.shape[:2]
    return cv2.rectangle(frame.copy(), (0, 0), (width_px - 1, height_px - 1), rgb, 2)


def draw_warning(frame: ByteArray, warning: str) -> ByteArray:
    """Return the frame [H, W, 3] with a red border and a red banner that states the warning."""
    image = Image.fromarray(frame)
    letter_px = max(10, image.height // 16)
    text = textwrap.fill(f"WARNING: {warning}", max(1, 2 * image.width // letter_px))
    pen = ImageDraw.Draw(image)
    _, _, _, bottom_px = pen.textbbox((8, 8), text, font_size=letter_px)
    pen.rectangle((0, 0, image.width, bottom_px + 8), fill="firebrick")
    pen.rectangle((0, 0, image.width - 1, image.height - 1), outline="firebrick", width=4)
    pen.text((8, 8), text, font_size=letter_px)
    return np.asarray(image)
