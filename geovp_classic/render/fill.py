"""Fills: invent the pixels that a scene does not cover; covered pixels are never touched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numba
import numpy as np
import numpy.typing as npt

from geovp_classic.errors import BadData
from geovp_classic.interfaces import Fill
from geovp_classic.parallel import parallel_map
from geovp_classic.render.blur import broad
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Views

IndexArray = npt.NDArray[np.intp]
FillOne = Callable[[ByteArray, BoolArray, FloatArray], ByteArray]  # frame [H, W, 3], coverage and depth [H, W]


@dataclass(frozen=True)
class Blank:
    """Uncovered pixels stay black."""

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3], black where nothing is known."""
        return np.where(views.covered[..., None], views.frames, np.uint8(0))


@dataclass(frozen=True)
class NearestBackground:
    """An uncovered pixel takes the colour of the farther one of the covered pixels left and right of it in its row.

    What a moving camera uncovers lies behind what hid it. Equally far ones: the nearer pixel. Rows without any covered
    pixel take the row above or below in the same manner; a frame without any is the last observed one.
    """

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3]."""
        return _fill_each(views, last, self._fill_one)

    def _fill_one(self, frame: ByteArray, covered: BoolArray, depth: FloatArray) -> ByteArray:
        far = np.where(covered & (depth > 0), depth, np.float32(0))
        filled, far = _pulled_from_background(frame, covered, far)
        known = covered.any(axis=1, keepdims=True)
        if np.all(known):
            return filled
        known = np.broadcast_to(known, covered.shape)
        filled, _ = _pulled_from_background(filled.transpose(1, 0, 2), known.T, far.T)
        return filled.transpose(1, 0, 2)


@dataclass(frozen=True)
class Telea:
    """Fast marching inpainting (Telea 2004); `radius_px` is the neighbourhood it averages."""

    radius_px: float = 3.0

    def __post_init__(self) -> None:
        """Raise BadData unless the radius is positive."""
        if not self.radius_px > 0:
            raise BadData(f"radius_px is {self.radius_px}, expected a positive number of pixels")

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3]; a frame without any covered pixel is the last observed one."""
        return _fill_each(views, last, self._fill_one)

    def _fill_one(self, frame: ByteArray, covered: BoolArray, depth: FloatArray) -> ByteArray:
        return np.asarray(cv2.inpaint(frame, (~covered).astype(np.uint8), self.radius_px, cv2.INPAINT_TELEA))


@dataclass(frozen=True)
class BorrowedDetail:
    """Another fill's colours with the detail that the last observed frame has at the same place of the image.

    A camera that turns keeps seeing road below, walls and trees beside and the sky above: what is where in the image
    changes less than what it is. So the broad colours go on from the border of what is known (`colours`), and what is
    finer than `coarse_share` of the image's width is borrowed, at `strength` of its contrast.
    """

    colours: Fill = field(default_factory=NearestBackground)
    coarse_share: float = 1 / 32
    strength: float = 0.25

    def __post_init__(self) -> None:
        """Raise BadData for settings that make no sense."""
        if not (0 < self.coarse_share < 1 and self.strength >= 0):
            given = f"coarse_share {self.coarse_share} and strength {self.strength}"
            raise BadData(f"borrowed-detail: {given}, expected a share between 0 and 1 and no negative strength")

    def fill(self, views: Views, last: ByteArray) -> ByteArray:
        """Frames [F, H, W, 3]."""
        filled = self.colours.fill(views, last).copy()
        seen = last.astype(np.float32)
        detail = seen - self._broad(seen)

        def borrow(step: int) -> None:
            colours = self._broad(filled[step].astype(np.float32))
            _borrow(views.covered[step], colours, detail, float(self.strength), filled[step])

        parallel_map(borrow, np.flatnonzero(~views.covered.all(axis=(1, 2))).tolist())
        return filled

    def _broad(self, image: FloatArray) -> FloatArray:
        return broad(image, self.coarse_share * image.shape[1])


def _fill_each(views: Views, last: ByteArray, fill_one: FillOne) -> ByteArray:
    """Fill view by view; covered pixels stay as they are, whatever `fill_one` does to them."""
    filled = views.frames.copy()

    def fill_step(step: int) -> None:
        covered = views.covered[step]
        if covered.all():
            return
        _put(covered, np.zeros_like(filled[step]), filled[step])
        invented = fill_one(filled[step], covered, views.depths[step]) if covered.any() else last
        _put(covered, np.asarray(invented), filled[step])

    parallel_map(fill_step, range(len(filled)))
    return filled


def _pulled_from_background(frame: ByteArray, known: BoolArray, far: FloatArray) -> tuple[ByteArray, FloatArray]:
    """Colours [H, W, 3] and depth [H, W] with those of the farther known side of its row at every unknown pixel."""
    frame, known, far = np.ascontiguousarray(frame), np.ascontiguousarray(known), np.ascontiguousarray(far)
    columns = np.empty(known.shape, np.intp)
    _pull_along_rows(known, far, columns)
    filled, depth = np.empty_like(frame), np.empty_like(far)
    _take_along_rows(columns, frame, far, filled, depth)
    return filled, depth


@numba.njit(nogil=True, cache=True)
def _take_along_rows(
    columns: IndexArray, frame: ByteArray, far: FloatArray, filled: ByteArray, depth: FloatArray
) -> None:
    for row in range(len(columns)):
        for column in range(columns.shape[1]):
            other = columns[row, column]
            depth[row, column] = far[row, other]
            for colour in range(3):
                filled[row, column, colour] = frame[row, other, colour]


@numba.njit(nogil=True, cache=True)
def _put(covered: BoolArray, invented: ByteArray, filled: ByteArray) -> None:
    """Write what is invented where nothing is covered."""
    for row in range(len(covered)):
        for column in range(covered.shape[1]):
            if not covered[row, column]:
                for colour in range(3):
                    filled[row, column, colour] = invented[row, column, colour]


@numba.njit(nogil=True, cache=True)
def _borrow(covered: BoolArray, colours: FloatArray, detail: FloatArray, strength: float, filled: ByteArray) -> None:
    """Write colours and a share of the detail where nothing is covered."""
    for row in range(len(covered)):
        for column in range(covered.shape[1]):
            if not covered[row, column]:
                for colour in range(3):
                    value = colours[row, column, colour] + strength * detail[row, column, colour]
                    filled[row, column, colour] = np.uint8(min(max(value + 0.5, 0.0), 255.0))


@numba.njit(nogil=True, cache=True)
def _pull_along_rows(known: BoolArray, far: FloatArray, columns: IndexArray) -> None:
    """Write the column [H, W] to take into `columns`; a row without any known pixel keeps its own."""
    height, width = known.shape
    for row in range(height):
        left = -1
        for column in range(width):
            left = column if known[row, column] else left
            columns[row, column] = left
        right = -1
        for column in range(width - 1, -1, -1):
            right = column if known[row, column] else right
            left = columns[row, column]
            if left < 0 or right < 0:
                columns[row, column] = max(left, right) if max(left, right) >= 0 else column
                continue
            to_left, to_right = far[row, left], far[row, right]
            is_left = to_left > to_right or (to_left == to_right and column - left <= right - column)
            columns[row, column] = left if is_left else right
