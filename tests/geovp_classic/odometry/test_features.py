"""Corners: detected, spread over the image, and tracked."""

import cv2
import numpy as np
import pytest

from geovp_classic.odometry.features import CornerTracker
from geovp_classic.types import ByteArray, FloatArray


def speckle(size: tuple[int, int] = (180, 240)) -> ByteArray:
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.random(size, dtype=np.float32), (0, 0), 2.0)
    return cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def shifted(image: ByteArray, u_px: float, v_px: float) -> ByteArray:
    height_px, width_px = image.shape
    move = np.array([[1, 0, u_px], [0, 1, v_px]], dtype=np.float64)
    return np.asarray(cv2.warpAffine(image, move, (width_px, height_px), flags=cv2.INTER_CUBIC))


NO_POINTS: FloatArray = np.zeros((0, 2))
TRACKER = CornerTracker()


def corners(image: ByteArray, tracker: CornerTracker = TRACKER) -> FloatArray:
    return tracker.select(tracker.detect(image), NO_POINTS, image)


def test_corners_are_tracked_to_a_tenth_of_a_pixel() -> None:
    before, now = speckle(), shifted(speckle(), 2.3, 1.6)
    pixels = corners(before)
    tracked, found = TRACKER.track(before, now, pixels, pixels)
    assert found.mean() > 0.9
    assert np.percentile(np.abs(tracked - pixels - [2.3, 1.6])[found], 90) < 0.1


def test_a_wrong_prediction_falls_back_to_the_whole_pyramid() -> None:
    before, now = speckle(), shifted(speckle(), 8.0, 0.0)
    pixels = corners(before)
    tracked, found = TRACKER.track(before, now, pixels, pixels - [20, 0])
    assert (np.abs(tracked - pixels - [8, 0]).max(axis=1)[found] < 0.5).mean() > 0.9
    assert found.mean() > 0.75


@pytest.mark.parametrize("gain", [0.4, 0.7, 1.3])
def test_exposure_jumps_do_not_lose_corners(gain: float) -> None:
    dim = (speckle() * 0.6).astype(np.uint8)
    before, now = dim, cv2.convertScaleAbs(shifted(dim, 3.0, 0.0), alpha=gain)
    pixels = corners(before)
    tracked, found = TRACKER.track(before, now, pixels, pixels)
    assert found.mean() > 0.8
    assert np.median(np.abs(tracked - pixels - [3, 0])[found]) < 0.1


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_blank_image_has_no_corners_and_loses_all(grey: int) -> None:
    blank = np.full((180, 240), grey, dtype=np.uint8)
    assert len(corners(blank)) == 0
    before = speckle()
    pixels = corners(before)
    assert not TRACKER.track(before, blank, pixels, pixels)[1].any()
    assert TRACKER.track(before, blank, NO_POINTS, NO_POINTS)[1].shape == (0,)


def test_corners_are_spread_over_free_cells() -> None:
    grey = speckle(size=(200, 200))
    tracker = CornerTracker(100)
    first = corners(grey, tracker)  # cells of 20 px
    cells = {tuple(cell) for cell in np.floor(first / 20).astype(int)}
    assert len(cells) == len(first) > 70
    others = tracker.select(tracker.detect(grey), first, grey)
    assert not cells & {tuple(cell) for cell in np.floor(others / 20).astype(int)}


def test_low_contrast_keeps_its_corners() -> None:
    faint = np.clip(speckle() * 0.06 + 120, 0, 255).astype(np.uint8)
    assert len(corners(faint)) > 100


def test_corners_come_in_order_of_strength() -> None:
    grey = speckle()
    detected = TRACKER.detect(grey)
    strength = cv2.cornerMinEigenVal(grey, 3)
    columns, rows = detected.astype(int).T
    assert (np.diff(strength[rows, columns]) <= 0).all()


def test_wide_images_are_searched_at_half_size_with_the_same_pixel_convention() -> None:
    wide = np.zeros((200, 800), dtype=np.uint8)
    wide[80:120, 300:340] = 255  # its corners lie at 299.5 and 339.5
    distance_px = np.linalg.norm(corners(wide) - (299.5, 79.5), axis=1)
    assert distance_px.min() < 2.5


def test_corners_may_lie_at_the_border() -> None:
    image = np.zeros((64, 64), dtype=np.uint8)
    image[:20, :20] = 255  # its corner lies at (19.5, 19.5)
    at_border, inside = (CornerTracker(border_px=border_px).detect(image) for border_px in (0, 24))
    assert np.linalg.norm(at_border - 19.5, axis=1).min() < 1.5
    assert len(inside) == 0
