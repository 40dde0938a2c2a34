"""Front ends: points found again where they went, spread over the image, and never in a blank one."""

import cv2
import numpy as np
import pytest

from geovp_classic.errors import MissingExtra
from geovp_classic.odometry import features
from geovp_classic.types import ByteArray, FloatArray

NAMES = ("corners", "orb", "sift", "akaze", "brisk", "kaze")


def speckle(seed: int = 0, size: tuple[int, int] = (180, 240)) -> ByteArray:
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(rng.random(size, dtype=np.float32), (0, 0), 2.0)
    return cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def shifted(image: ByteArray, u_px: float, v_px: float) -> ByteArray:
    height_px, width_px = image.shape
    move = np.array([[1, 0, u_px], [0, 1, v_px]], dtype=np.float64)
    return np.asarray(cv2.warpAffine(image, move, (width_px, height_px), flags=cv2.INTER_CUBIC))


NOWHERE: FloatArray = np.zeros((0, 2))


@pytest.mark.parametrize("name", NAMES)
def test_every_front_end_finds_a_shift_again(name: features.FeatureName) -> None:
    front = features.front_end(name, 200)
    before, now = front.look(speckle()), front.look(shifted(speckle(), 5.0, -3.0))
    pixels = front.fresh(before, NOWHERE)
    places, found = front.follow(before, now, pixels, pixels)
    assert found.sum() > 20
    error = np.abs(places - pixels - [5, -3])[found]
    assert np.median(error) < front.noise_px
    assert np.isfinite(places).all()


def test_corners_are_found_to_a_tenth_of_a_pixel() -> None:
    front = features.Corners()
    before, now = front.look(speckle()), front.look(shifted(speckle(), 2.3, 1.6))
    pixels = front.fresh(before, NOWHERE)
    places, found = front.follow(before, now, pixels, pixels)
    assert found.mean() > 0.9
    assert np.percentile(np.abs(places - pixels - [2.3, 1.6])[found], 90) < 0.1


def test_a_wrong_guess_is_mended_by_the_whole_pyramid() -> None:
    front = features.Corners()
    before, now = front.look(speckle()), front.look(shifted(speckle(), 8.0, 0.0))
    pixels = front.fresh(before, NOWHERE)
    places, found = front.follow(before, now, pixels, pixels - [20, 0])
    assert (np.abs(places - pixels - [8, 0]).max(axis=1)[found] < 0.5).mean() > 0.9
    assert found.mean() > 0.8


@pytest.mark.parametrize("gain", [0.4, 0.7, 1.3])
def test_exposure_jumps_do_not_lose_corners(gain: float) -> None:
    front, dim = features.Corners(), (speckle() * 0.6).astype(np.uint8)
    before, now = front.look(dim), front.look(cv2.convertScaleAbs(shifted(dim, 3.0, 0.0), alpha=gain))
    pixels = front.fresh(before, NOWHERE)
    places, found = front.follow(before, now, pixels, pixels)
    assert found.mean() > 0.8
    assert np.median(np.abs(places - pixels - [3, 0])[found]) < 0.1


def test_points_that_leave_the_image_are_not_found() -> None:
    front = features.Corners()
    before, now = front.look(speckle()), front.look(shifted(speckle(), 60.0, 0.0))
    pixels = np.array([[230.0, 90.0]])
    assert not front.follow(before, now, pixels, pixels + 60.0)[1].any()


@pytest.mark.parametrize("grey", [0, 128, 255])
@pytest.mark.parametrize("name", ["corners", "orb", "sift"])
def test_a_blank_image_has_no_points_and_loses_all(name: features.FeatureName, grey: int) -> None:
    front, blank = features.front_end(name, 200), np.full((180, 240), grey, dtype=np.uint8)
    assert len(front.fresh(front.look(blank), NOWHERE)) == 0
    before = front.look(speckle())
    pixels = front.fresh(before, NOWHERE)
    assert not front.follow(before, front.look(blank), pixels, pixels)[1].any()
    assert front.follow(before, front.look(blank), NOWHERE, NOWHERE)[1].shape == (0,)


def test_corners_are_spread_one_a_cell_and_keep_away_from_those_taken() -> None:
    grey = speckle(size=(200, 200))
    found = features.strongest_corners(grey, NOWHERE, 100)  # cells of 20 px
    cells = {tuple(cell) for cell in np.floor(found / 20).astype(int)}
    assert len(cells) == len(found) > 70
    again = features.strongest_corners(grey, found, 100)
    assert not cells & {tuple(cell) for cell in np.floor(again / 20).astype(int)}


def slow_corners(grey: ByteArray, taken: FloatArray, count: int) -> FloatArray:
    """All peaks, the strongest first; of each cell the first."""
    shrink = 2 if grey.shape[1] >= features.HALF_FROM_WIDTH_PX else 1
    small = grey if shrink == 1 else cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    strength = cv2.cornerMinEigenVal(small, 3) * (255 / float(np.std(grey[::4, ::4]))) ** 2
    border = 8 // shrink
    strength[:border], strength[-border:], strength[:, :border], strength[:, -border:] = 0, 0, 0, 0
    peaks = (strength >= cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > features.MIN_CORNER)
    rows, columns = np.nonzero(peaks)
    pixels = (np.stack([columns, rows], axis=1) + 0.5) * shrink - 0.5
    side_px = np.sqrt(grey.size / count)
    order = np.argsort(-strength[rows, columns], kind="stable")
    cell_of = (pixels[order] // side_px) @ [1, grey.shape[1] // side_px + 1]
    cells, first = np.unique(cell_of, return_index=True)
    free = ~np.isin(cells, (taken // side_px) @ [1, grey.shape[1] // side_px + 1])
    return pixels[order][first[free]]


@pytest.mark.parametrize("size", [(180, 240), (181, 243), (301, 700)])
def test_corners_are_those_of_the_slow_twin(size: tuple[int, int]) -> None:
    grey = speckle(4, size) // 16 * 16  # few grey values: some corners are alike
    taken = np.random.default_rng(1).uniform(0, size[::-1], (60, 2))
    expected = slow_corners(grey, taken, 300)
    assert len(expected) > 100
    np.testing.assert_array_equal(features.strongest_corners(grey, taken, 300), expected)


def test_wide_images_are_searched_at_half_size_with_the_same_pixel_convention() -> None:
    wide = np.zeros((200, 800), dtype=np.uint8)
    wide[80:120, 300:340] = 255  # its corners lie at 299.5 and 339.5
    found = features.strongest_corners(wide, NOWHERE, 500)
    corner = np.array([299.5, 79.5])
    assert np.linalg.norm(found - corner, axis=1).min() < 2.5


def test_low_contrast_keeps_its_corners() -> None:
    faint = np.clip(speckle() * 0.06 + 120, 0, 255).astype(np.uint8)
    assert len(features.strongest_corners(faint, NOWHERE, 200)) > 100


def test_exposure_is_left_alone_when_it_is_the_same() -> None:
    assert features.same_exposure(speckle(), speckle(1)) is not None
    image = speckle()
    assert features.same_exposure(image, image) is image
    matched = features.same_exposure((image * 0.5).astype(np.uint8), image)
    assert abs(matched.astype(float).mean() - image.mean()) < 2


def test_features_that_this_opencv_lacks_are_a_missing_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "xfeatures2d", raising=False)
    monkeypatch.delattr(cv2, "BRISK_create", raising=False)
    with pytest.raises(MissingExtra, match="opencv-contrib"):
        features.front_end("brisk", 100)
