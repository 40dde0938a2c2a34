"""Points that can be found again in the next image: tracked corners, or described features, behind one interface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import cv2
import numba
import numpy as np
from scipy.spatial import cKDTree

from geovp_classic.errors import MissingExtra
from geovp_classic.types import BoolArray, ByteArray, FloatArray

FeatureName = Literal["corners", "orb", "sift", "akaze", "brisk", "kaze"]

MIN_CORNER = 0.003  # smallest eigenvalue of a corner worth tracking, for an image of variance 1 (OpenCV's scale)
MIN_SPREAD = 1.5  # grey values; an image with a smaller standard deviation shows nothing
EXPOSURE_CHANGE = 0.08  # beyond this relative change of brightness, it is undone before tracking
UNLIKE, LIKE_GREY = 3.0, 4.0  # a patch may differ by so many times the usual difference, and this many grey values
MIN_NEAR_GUESS = 0.3  # share of the points found near their guess, to trust it
HALF_FROM_WIDTH_PX = 640  # wider images are searched for corners at half their size
ORB_LEVELS = 4  # points of higher levels are placed too coarsely
NOISE_PX = {"orb": 0.6, "sift": 0.25, "akaze": 0.3, "brisk": 0.5, "kaze": 0.25}


@dataclass(frozen=True)
class Look:
    """What a front end keeps of one image."""

    grey: ByteArray  # [H, W]
    keypoints: FloatArray  # [K, 2]; empty for tracked corners
    descriptors: Any = None  # [K, D]


class FrontEnd(Protocol):
    """Finds points and finds them again."""

    @property
    def noise_px(self) -> float:
        """Standard deviation of a coordinate of a point that was found again."""
        ...

    def look(self, grey: ByteArray) -> Look:
        """What is needed of a grey image [H, W]."""
        ...

    def follow(self, before: Look, now: Look, pixels: FloatArray, guess: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Where the points at `pixels` [N, 2] of `before` are `now` [N, 2], near `guess` [N, 2]; which were found [N].

        Places that were not found are finite but meaningless.
        """
        ...

    def fresh(self, look: Look, taken: FloatArray) -> FloatArray:
        """New points [K, 2], spread over the image and away from those `taken` [M, 2]."""
        ...


@dataclass(frozen=True)
class Corners:
    """Shi-Tomasi corners, tracked by pyramidal Lucas-Kanade with a forward-backward check."""

    num_features: int = 600
    window_px: int = 11
    num_levels: int = 4
    max_return_px: float = 0.5  # how far from its start a point may end after tracking there and back
    noise_px: float = 0.25

    def look(self, grey: ByteArray) -> Look:
        """The image itself."""
        return Look(grey, np.zeros((0, 2)))

    def follow(self, before: Look, now: Look, pixels: FloatArray, guess: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Lucas-Kanade near the guess; points lost that way are sought in the whole pyramid, from where they were."""
        grey = same_exposure(before.grey, now.grey)
        places, found = self._track(grey, now.grey, pixels, guess, num_levels=2)
        if len(pixels) == 0 or found.all():
            return places, found
        if found.mean() < MIN_NEAR_GUESS:  # the guess is wrong for all, and the few found are chance
            return self._track(grey, now.grey, pixels, pixels, self.num_levels)
        places[~found], found[~found] = self._track(grey, now.grey, pixels[~found], pixels[~found], self.num_levels)
        return places, found

    def fresh(self, look: Look, taken: FloatArray) -> FloatArray:
        """The strongest corner of every cell that holds no point yet."""
        return strongest_corners(look.grey, taken, self.num_features)

    def _track(
        self, grey: ByteArray, grey_now: ByteArray, pixels: FloatArray, guess: FloatArray, num_levels: int
    ) -> tuple[FloatArray, BoolArray]:
        if len(pixels) == 0:
            return np.zeros((0, 2)), np.zeros(0, dtype=bool)
        settings: dict[str, Any] = {
            "winSize": (self.window_px, self.window_px),
            "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.02),
            "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
        }
        start, near = np.asarray(pixels, dtype=np.float32), np.array(guess, dtype=np.float32)
        ahead, forward, difference = cv2.calcOpticalFlowPyrLK(
            grey, grey_now, start, near, maxLevel=num_levels - 1, **settings
        )
        back, backward, _ = cv2.calcOpticalFlowPyrLK(grey_now, grey, ahead, start.copy(), maxLevel=0, **settings)
        places = np.nan_to_num(np.asarray(ahead, dtype=np.float64))
        found = (forward.ravel() > 0) & (backward.ravel() > 0) & inside(places, grey_now)
        found &= np.linalg.norm(back - start, axis=1) < self.max_return_px
        if found.any():  # patches that look much less alike than the others do
            found &= difference.ravel() < UNLIKE * np.median(difference.ravel()[found]) + LIKE_GREY
        return places, found


@dataclass(frozen=True)
class Described:
    """Keypoints with descriptors, matched mutually with a ratio test; `make` builds the OpenCV detector."""

    make: Callable[[], Any]
    noise_px: float
    num_features: int = 600
    max_ratio: float = 0.85
    max_jump: float = 0.1  # from the guess, as a share of the image's width

    def look(self, grey: ByteArray) -> Look:
        """Keypoints and descriptors of the image."""
        keypoints, descriptors = self.make().detectAndCompute(grey, None)
        if descriptors is None or len(keypoints) == 0:
            return Look(grey, np.zeros((0, 2)))
        return Look(grey, np.array([keypoint.pt for keypoint in keypoints], dtype=np.float64), descriptors)

    def follow(self, before: Look, now: Look, pixels: FloatArray, guess: FloatArray) -> tuple[FloatArray, BoolArray]:
        """The best match of each point's descriptor that is clear, mutual and near the guess."""
        places, found = np.array(guess, dtype=np.float64), np.zeros(len(pixels), dtype=bool)
        if len(pixels) == 0 or len(before.keypoints) == 0 or len(now.keypoints) < 2:
            return places, found
        own = cKDTree(before.keypoints).query(pixels)[1]  # tracks sit exactly on keypoints
        offset = now.keypoints[None] - guess[:, None]
        near = ((offset**2).sum(axis=-1) < (self.max_jump * now.grey.shape[1]) ** 2).astype(np.uint8)
        matcher = cv2.BFMatcher(self.make().defaultNorm())
        there = matcher.knnMatch(before.descriptors[own], now.descriptors, k=2, mask=near)
        back = matcher.match(now.descriptors, before.descriptors[own], mask=np.ascontiguousarray(near.T))
        origin = {match.queryIdx: own[match.trainIdx] for match in back}
        for best, *others in (matches for matches in there if matches):
            clear = not others or best.distance < self.max_ratio * others[0].distance
            if clear and origin.get(best.trainIdx) == own[best.queryIdx]:
                places[best.queryIdx], found[best.queryIdx] = now.keypoints[best.trainIdx], True
        return places, found

    def fresh(self, look: Look, taken: FloatArray) -> FloatArray:
        """The keypoints that no point sits on, up to the number wanted."""
        free = look.keypoints
        if len(free) and len(taken):
            free = free[cKDTree(taken).query(free)[0] > 1.0]
        return free[: max(0, self.num_features - len(taken))]


def front_end(name: FeatureName, num_features: int) -> FrontEnd:
    """The front end of a name; MissingExtra when this build of OpenCV lacks it."""
    if name == "corners":
        return Corners(num_features)
    home = cv2 if hasattr(cv2, f"{name.upper()}_create") else getattr(cv2, "xfeatures2d", None)
    create = getattr(home, f"{name.upper()}_create", None)
    if create is None:
        raise MissingExtra(f"features {name!r} are not in this OpenCV: pip install opencv-contrib-python-headless")
    makers: dict[str, Callable[[], Any]] = {
        "orb": lambda: create(num_features, 1.2, ORB_LEVELS),
        "sift": lambda: create(num_features),
    }
    make = makers.get(name, create)
    return Described(make, NOISE_PX[name], num_features)


def same_exposure(grey: ByteArray, like: ByteArray) -> ByteArray:
    """The image as bright as another, when their exposures differ noticeably.

    The gain is the median over cells of the images, so that new things in a part of them don't pass for exposure.
    """
    thumbs = [cv2.resize(image, (16, 8), interpolation=cv2.INTER_AREA).astype(np.float32) for image in (grey, like)]
    usable = (thumbs[0] > 4) & (thumbs[0] < 251) & (thumbs[1] > 4) & (thumbs[1] < 251)  # neither black nor burnt
    if usable.mean() < 0.25:
        return grey
    gain = float(np.median(thumbs[1][usable] / thumbs[0][usable]))
    if abs(gain - 1) < EXPOSURE_CHANGE:
        return grey
    return np.asarray(cv2.convertScaleAbs(grey, alpha=gain), dtype=np.uint8)


def strongest_corners(grey: ByteArray, taken: FloatArray, count: int) -> FloatArray:
    """Corners [K, 2], at most one in each of about `count` square cells and none in cells with a point of `taken`."""
    shrink = 2 if grey.shape[1] >= HALF_FROM_WIDTH_PX else 1
    small = grey if shrink == 1 else cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    spread = _spread(grey)
    if spread < MIN_SPREAD:
        return np.zeros((0, 2))
    strength = cv2.cornerMinEigenVal(small, 3) * (255 / spread) ** 2
    border = 8 // shrink
    strength[:border], strength[-border:], strength[:, :border], strength[:, -border:] = 0, 0, 0, 0
    highest = np.asarray(cv2.dilate(strength, np.ones((5, 5), np.uint8)), dtype=np.float32)
    side_px = np.sqrt(grey.size / max(count, 1))
    per_row, per_column = int(grey.shape[1] // side_px) + 1, int(grey.shape[0] // side_px) + 1
    corners = _strongest(strength, highest, shrink, float(side_px), (per_column, per_row))
    cells = np.flatnonzero(np.isfinite(corners[:, 0]))
    return corners[cells[~np.isin(cells, _cell(taken, side_px, per_row))]]


def inside(pixels: FloatArray, grey: ByteArray, margin_px: float = 2.0) -> BoolArray:
    """Which points [N] lie in the image, `margin_px` from its edges."""
    height_px, width_px = grey.shape[:2]
    u, v = pixels[:, 0], pixels[:, 1]
    return (u >= margin_px) & (u < width_px - margin_px) & (v >= margin_px) & (v < height_px - margin_px)


def _spread(grey: ByteArray) -> float:
    """Standard deviation, of every fourth pixel each way."""
    return float(np.std(grey[::4, ::4]))


def _cell(pixels: FloatArray, side_px: float, per_row: int) -> FloatArray:
    column, row = np.floor(np.reshape(pixels, (-1, 2)) / side_px).astype(np.int64).T
    return row * per_row + column


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _strongest(
    strength: FloatArray,  # [H, W] float32
    highest: FloatArray,  # [H, W] float32, of the neighbours
    shrink: int,
    side_px: float,
    num_cells: tuple[int, int],  # rows, columns
) -> FloatArray:
    """The strongest corner of every cell, the first of those alike [C, 2]; NaN where there is none."""
    corners = np.full((num_cells[0] * num_cells[1], 2), np.nan)
    best = np.full(len(corners), np.float32(MIN_CORNER))
    for row in range(strength.shape[0]):
        for column in range(strength.shape[1]):
            here = strength[row, column]
            if here > np.float32(MIN_CORNER) and here >= highest[row, column]:
                u, v = (column + 0.5) * shrink - 0.5, (row + 0.5) * shrink - 0.5
                cell = int(v / side_px) * num_cells[1] + int(u / side_px)
                if here > best[cell]:
                    best[cell], corners[cell, 0], corners[cell, 1] = here, u, v
    return corners
