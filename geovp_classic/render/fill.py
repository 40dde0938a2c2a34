"""Fills: invent the pixels that a scene does not cover; covered pixels are never touched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Views

IndexArray = npt.NDArray[np.intp]
FillOne = Callable[[ByteArray, BoolArray, FloatArray], ByteArray]  # frame [H, W, 3], coverage and depth [H, W]


@dataclass(frozen=True)
class Blank:
    """Uncovered pixels stay black."""

    def fill(self, views: Views) -> ByteArray:
        """Frames [F, H, W, 3], black where nothing is known."""
        return np.where(views.covered[..., None], views.frames, np.uint8(0))


@dataclass(frozen=True)
class NearestBackground:
    """An uncovered pixel takes the colour of the farther one of the covered pixels left and right of it in its row.

    What a moving camera uncovers lies behind what hid it. Equally far ones: the nearer pixel. Rows without any covered
    pixel take the row above or below in the same manner; a frame without any repeats the one before (the first: black).
    """

    def fill(self, views: Views) -> ByteArray:
        """Frames [F, H, W, 3]."""
        return _fill_each(views, self._fill_one)

    def _fill_one(self, frame: ByteArray, covered: BoolArray, depth: FloatArray) -> ByteArray:
        far = np.where(covered & (depth > 0), depth, np.float32(0))
        rows, columns = _pull_from_background(covered, far)
        filled, far = frame[rows, columns], far[rows, columns]
        known = np.broadcast_to(covered.any(axis=1, keepdims=True), covered.shape)
        columns, rows = _pull_from_background(known.T, far.T)
        return filled[rows.T, columns.T]


@dataclass(frozen=True)
class Telea:
    """Fast marching inpainting (Telea 2004); `radius_px` is the neighbourhood it averages."""

    radius_px: float = 3.0

    def __post_init__(self) -> None:
        """Raise BadData unless the radius is positive."""
        _check_radius(self.radius_px)

    def fill(self, views: Views) -> ByteArray:
        """Frames [F, H, W, 3]; a frame without any covered pixel repeats the one before, the first is black."""
        return _fill_each(views, _inpainting(self.radius_px, cv2.INPAINT_TELEA))


@dataclass(frozen=True)
class NavierStokes:
    """Inpainting along isophotes (Bertalmio, Bertozzi, Sapiro 2001); `radius_px` is the neighbourhood it uses."""

    radius_px: float = 3.0

    def __post_init__(self) -> None:
        """Raise BadData unless the radius is positive."""
        _check_radius(self.radius_px)

    def fill(self, views: Views) -> ByteArray:
        """Frames [F, H, W, 3]; a frame without any covered pixel repeats the one before, the first is black."""
        return _fill_each(views, _inpainting(self.radius_px, cv2.INPAINT_NS))


def _fill_each(views: Views, fill_one: FillOne) -> ByteArray:
    """Fill view by view; covered pixels stay as they are, whatever `fill_one` does to them."""
    filled = np.where(views.covered[..., None], views.frames, np.uint8(0))
    for step, (covered, depth) in enumerate(zip(views.covered, views.depths, strict=True)):
        if covered.any() and not covered.all():
            filled[step] = np.where(covered[..., None], filled[step], fill_one(filled[step], covered, depth))
        elif step > 0 and not covered.any():
            filled[step] = filled[step - 1]
    return filled


def _pull_from_background(known: BoolArray, far: FloatArray) -> tuple[IndexArray, IndexArray]:
    """For every pixel [H, W] the (row, column) in its row to take: itself if known, else the farther known side."""
    height, width = known.shape
    column = np.broadcast_to(np.arange(width), known.shape)
    left = np.maximum.accumulate(np.where(known, column, -1), axis=1)
    right = np.minimum.accumulate(np.where(known, column, width)[:, ::-1], axis=1)[:, ::-1]
    row = np.arange(height)[:, None]
    far_left = np.where(left >= 0, far[row, np.maximum(left, 0)], np.float32(-1))
    far_right = np.where(right < width, far[row, np.minimum(right, width - 1)], np.float32(-1))
    left_is_nearer = column - left <= right - column
    take_left = (far_left > far_right) | ((far_left == far_right) & left_is_nearer)
    chosen = np.clip(np.where(take_left, left, right), 0, width - 1)
    return np.broadcast_to(row, known.shape), np.where((far_left < 0) & (far_right < 0), column, chosen)


def _inpainting(radius_px: float, method: int) -> FillOne:
    def fill_one(frame: ByteArray, covered: BoolArray, depth: FloatArray) -> ByteArray:
        return np.asarray(cv2.inpaint(frame, (~covered).astype(np.uint8), radius_px, method))

    return fill_one


def _check_radius(radius_px: float) -> None:
    if not radius_px > 0:
        raise BadData(f"radius_px is {radius_px}, expected a positive number of pixels")
