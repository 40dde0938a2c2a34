"""Corners: found where they moved to, spread over the image, and none in a blank one."""

import cv2
import numpy as np
import pytest

from geovp_classic.odometry import features
from geovp_classic.types import ByteArray, FloatArray


def speckle(seed: int = 0, size: tuple[int, int] = (180, 240)) -> ByteArray:
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(rng.random(size, dtype=np.float32), (0, 0), 2.0)
    return cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def shifted(image: ByteArray, u_px: float, v_px: float) -> ByteArray:
    height_px, width_px = image.shape
    move = np.array([[1, 0, u_px], [0, 1, v_px]], dtype=np.float64)
    return np.asarray(cv2.warpAffine(image, move, (width_px, height_px), flags=cv2.INTER_CUBIC))


NO_POINTS: FloatArray = np.zeros((0, 2))


def test_corners_are_found_to_a_tenth_of_a_pixel() -> None:
    tracker = features.CornerTracker()
    before, now = speckle(), shifted(speckle(), 2.3, 1.6)
    pixels = tracker.detect(before, NO_POINTS)
    tracked, found = tracker.track(before, now, pixels, pixels)
    assert found.mean() > 0.9
    assert np.percentile(np.abs(tracked - pixels - [2.3, 1.6])[found], 90) < 0.1


def test_a_wrong_prediction_falls_back_on_the_whole_pyramid() -> None:
    tracker = features.CornerTracker()
    before, now = speckle(), shifted(speckle(), 8.0, 0.0)
    pixels = tracker.detect(before, NO_POINTS)
    tracked, found = tracker.track(before, now, pixels, pixels - [20, 0])
    assert (np.abs(tracked - pixels - [8, 0]).max(axis=1)[found] < 0.5).mean() > 0.9
    assert found.mean() > 0.8


@pytest.mark.parametrize("gain", [0.4, 0.7, 1.3])
def test_exposure_jumps_do_not_lose_corners(gain: float) -> None:
    tracker, dim = features.CornerTracker(), (speckle() * 0.6).astype(np.uint8)
    before, now = dim, cv2.convertScaleAbs(shifted(dim, 3.0, 0.0), alpha=gain)
    pixels = tracker.detect(before, NO_POINTS)
    tracked, found = tracker.track(before, now, pixels, pixels)
    assert found.mean() > 0.8
    assert np.median(np.abs(tracked - pixels - [3, 0])[found]) < 0.1


def test_points_that_leave_the_image_are_not_found() -> None:
    tracker = features.CornerTracker()
    before, now = speckle(), shifted(speckle(), 60.0, 0.0)
    pixels = np.array([[230.0, 90.0]])
    assert not tracker.track(before, now, pixels, pixels + 60.0)[1].any()


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_blank_image_has_no_points_and_loses_all(grey: int) -> None:
    tracker, blank = features.CornerTracker(200), np.full((180, 240), grey, dtype=np.uint8)
    assert len(tracker.detect(blank, NO_POINTS)) == 0
    before = speckle()
    pixels = tracker.detect(before, NO_POINTS)
    assert not tracker.track(before, blank, pixels, pixels)[1].any()
    assert tracker.track(before, blank, NO_POINTS, NO_POINTS)[1].shape == (0,)


def test_corners_are_spread_one_a_cell_and_keep_away_from_those_taken() -> None:
    grey = speckle(size=(200, 200))
    found = features.CornerTracker(100).detect(grey, NO_POINTS)  # cells of 20 px
    cells = {tuple(cell) for cell in np.floor(found / 20).astype(int)}
    assert len(cells) == len(found) > 70
    again = features.CornerTracker(100).detect(grey, found)
    assert not cells & {tuple(cell) for cell in np.floor(again / 20).astype(int)}


def slow_corners(grey: ByteArray, occupied: FloatArray, count: int) -> FloatArray:
    """Of each free cell the first of the strongest peaks, peak by peak."""
    shrink = 2 if grey.shape[1] >= features.HALF_FROM_WIDTH_PX else 1
    small = (
        grey
        if shrink == 1
        else cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    )
    strength = cv2.cornerMinEigenVal(small, 3) * (255 / float(np.std(grey[::4, ::4]))) ** 2
    border, side_px, strongest = 8 // shrink, np.sqrt(grey.size / count), {}
    strength[:border], strength[-border:], strength[:, :border], strength[:, -border:] = 0, 0, 0, 0
    taken = {(int(v // side_px), int(u // side_px)) for u, v in occupied}
    for row in range(border, small.shape[0] - border):
        for column in range(border, small.shape[1] - border):
            peak = strength[row, column]
            u, v = (column + 0.5) * shrink - 0.5, (row + 0.5) * shrink - 0.5
            cell = (int(v // side_px), int(u // side_px))
            near = strength[max(0, row - 2) : row + 3, max(0, column - 2) : column + 3]
            if peak > features.MIN_CORNER and peak == near.max() and cell not in taken:
                strongest[cell] = max(strongest.get(cell, (0.0,)), (peak, -row, -column, u, v))
    return np.array([strongest[cell][3:] for cell in sorted(strongest)])


@pytest.mark.parametrize("size", [(180, 240), (181, 243), (301, 700)])
def test_corners_are_those_of_the_loop_over_all_pixels(size: tuple[int, int]) -> None:
    grey = speckle(4, size) // 16 * 16  # few grey values: some corners are alike
    occupied = np.random.default_rng(1).uniform(0, size[::-1], (60, 2))
    expected = slow_corners(grey, occupied, 300)
    assert len(expected) > 100
    np.testing.assert_array_equal(features.CornerTracker(300).detect(grey, occupied), expected)


def test_wide_images_are_searched_at_half_size_with_the_same_pixel_convention() -> None:
    wide = np.zeros((200, 800), dtype=np.uint8)
    wide[80:120, 300:340] = 255  # its corners lie at 299.5 and 339.5
    found = features.CornerTracker(500).detect(wide, NO_POINTS)
    corner = np.array([299.5, 79.5])
    assert np.linalg.norm(found - corner, axis=1).min() < 2.5


def test_low_contrast_keeps_its_corners() -> None:
    faint = np.clip(speckle() * 0.06 + 120, 0, 255).astype(np.uint8)
    assert len(features.CornerTracker(200).detect(faint, NO_POINTS)) > 100


def test_exposure_is_left_alone_when_it_is_the_same() -> None:
    assert features.match_exposure(speckle(), speckle(1)) is not None
    image = speckle()
    assert features.match_exposure(image, image) is image
    matched = features.match_exposure((image * 0.5).astype(np.uint8), image)
    assert abs(matched.astype(float).mean() - image.mean()) < 2
