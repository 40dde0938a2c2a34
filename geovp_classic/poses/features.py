"""Points that can be found again in the next picture: tracked corners, or described features, behind one interface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import cv2
import numpy as np
from scipy.spatial import cKDTree

from geovp_classic.errors import MissingExtra
from geovp_classic.types import BoolArray, ByteArray, FloatArray

FeatureName = Literal["corners", "orb", "sift", "akaze", "brisk", "kaze"]

MIN_CORNER = 0.003  # smallest eigenvalue of a corner worth tracking, for a picture of variance 1 (OpenCV's scale)
MIN_SPREAD = 1.5  # grey values; a picture with a smaller standard deviation shows nothing
EXPOSURE_CHANGE = 0.05  # beyond this relative change of brightness or contrast, it is undone before tracking
HALF_FROM_WIDTH_PX = 640  # wider pictures are searched for corners at half their size


@dataclass(frozen=True)
class Look:
    """What a front end keeps of one picture."""

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
        """What is needed of a grey picture [H, W]."""
        ...

    def follow(self, before: Look, now: Look, pixels: FloatArray, guess: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Where the points at `pixels` [N, 2] of `before` are `now` [N, 2], near `guess` [N, 2]; which were found [N].

        Places that were not found are finite but meaningless.
        """
        ...

    def fresh(self, look: Look, taken: FloatArray) -> FloatArray:
        """New points [K, 2], spread over the picture and away from those `taken` [M, 2]."""
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
        """The picture itself."""
        return Look(grey, np.zeros((0, 2)))

    def follow(self, before: Look, now: Look, pixels: FloatArray, guess: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Lucas-Kanade near the guess; points lost that way are sought in the whole pyramid, from where they were."""
        grey = same_exposure(before.grey, now.grey)
        places, found = self._track(grey, now.grey, pixels, guess, num_levels=2)
        if found.all():
            return places, found
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
        ahead, forward, _ = cv2.calcOpticalFlowPyrLK(grey, grey_now, start, near, maxLevel=num_levels - 1, **settings)
        back, backward, _ = cv2.calcOpticalFlowPyrLK(grey_now, grey, ahead, start.copy(), maxLevel=0, **settings)
        places = np.nan_to_num(np.asarray(ahead, dtype=np.float64))
        found = (forward.ravel() > 0) & (backward.ravel() > 0) & inside(places, grey_now)
        found &= np.linalg.norm(back - start, axis=1) < self.max_return_px
        return places, found


@dataclass(frozen=True)
class Described:
    """Keypoints with descriptors, matched mutually with a ratio test; `make` builds the OpenCV detector."""

    make: Callable[[], Any]
    max_ratio: float = 0.8
    max_jump: float = 0.15  # from the guess, as a share of the picture's width
    num_features: int = 600
    noise_px: float = 0.6

    def look(self, grey: ByteArray) -> Look:
        """Keypoints and descriptors of the picture."""
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
        matcher = cv2.BFMatcher(self.make().defaultNorm())
        there = matcher.knnMatch(before.descriptors[own], now.descriptors, k=2)
        back = matcher.match(now.descriptors, before.descriptors[own])
        origin = {match.queryIdx: match.trainIdx for match in back}
        for best, second in there:
            clear = best.distance < self.max_ratio * second.distance
            if clear and own[origin[best.trainIdx]] == own[best.queryIdx]:
                places[best.queryIdx], found[best.queryIdx] = now.keypoints[best.trainIdx], True
        found &= np.linalg.norm(places - guess, axis=1) < self.max_jump * now.grey.shape[1]
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
    if name in ("orb", "sift"):
        return Described(lambda: create(num_features), num_features=num_features)
    return Described(create, num_features=num_features)


def same_exposure(grey: ByteArray, like: ByteArray) -> ByteArray:
    """The picture with the brightness and contrast of another, when they differ noticeably."""
    (mean, spread), (mean_like, spread_like) = _exposure(grey), _exposure(like)
    if spread < 1 or spread_like < 1:  # a black or blank picture has nothing to match
        return grey
    gain = spread_like / spread
    if abs(gain - 1) < EXPOSURE_CHANGE and abs(mean_like / max(mean, 1.0) - 1) < EXPOSURE_CHANGE:
        return grey
    return cv2.convertScaleAbs(np.maximum(gain * grey.astype(np.float32) + (mean_like - gain * mean), 0))


def strongest_corners(grey: ByteArray, taken: FloatArray, count: int) -> FloatArray:
    """Corners [K, 2], at most one in each of about `count` square cells and none in cells with a point of `taken`."""
    shrink = 2 if grey.shape[1] >= HALF_FROM_WIDTH_PX else 1
    small = grey if shrink == 1 else cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    spread = _exposure(grey)[1]
    if spread < MIN_SPREAD:
        return np.zeros((0, 2))
    strength = cv2.cornerMinEigenVal(small, 3) * (255 / spread) ** 2
    border = 8 // shrink
    strength[:border], strength[-border:], strength[:, :border], strength[:, -border:] = 0, 0, 0, 0
    peaks = (strength >= cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > MIN_CORNER)
    rows, columns = np.nonzero(peaks)
    pixels = (np.stack([columns, rows], axis=1) + 0.5) * shrink - 0.5
    side_px = np.sqrt(grey.size / max(count, 1))
    per_row = int(grey.shape[1] // side_px) + 1
    order = np.argsort(-strength[rows, columns], kind="stable")
    cells, first = np.unique(_cell(pixels[order], side_px, per_row), return_index=True)
    free = ~np.isin(cells, _cell(taken, side_px, per_row))
    return pixels[order][first[free]]


def inside(pixels: FloatArray, grey: ByteArray, margin_px: float = 2.0) -> BoolArray:
    """Which points [N] lie in the picture, `margin_px` from its edges."""
    height_px, width_px = grey.shape[:2]
    u, v = pixels[:, 0], pixels[:, 1]
    return (u >= margin_px) & (u < width_px - margin_px) & (v >= margin_px) & (v < height_px - margin_px)


def _exposure(grey: ByteArray) -> tuple[float, float]:
    """Mean and standard deviation, of every fourth pixel each way."""
    mean, spread = cv2.meanStdDev(np.ascontiguousarray(grey[::4, ::4]))
    return float(np.ravel(mean)[0]), float(np.ravel(spread)[0])


def _cell(pixels: FloatArray, side_px: float, per_row: int) -> FloatArray:
    column, row = np.floor(np.reshape(pixels, (-1, 2)) / side_px).astype(np.int64).T
    return row * per_row + column
