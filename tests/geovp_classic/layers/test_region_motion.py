"""Motion of a region: what most of its pixels agree on, aligned with the images."""

import cv2
import numpy as np
import pytest

from geovp_classic.layers.region_motion import (
    EarlierFrame,
    RegionMotion,
    aligned,
    common_motion,
    pixels_of,
)

MASK = np.zeros((96, 96), bool)
MASK[30:60, 20:70] = True
MIDDLE = np.array([44.5, 44.5])


@pytest.mark.parametrize(("share", "is_found"), [(0.6, True), (0.4, False)])
def test_half_of_the_pixels_must_agree(share: float, is_found: bool) -> None:
    """The others have any motion, as where the flow is wrong."""
    rng = np.random.default_rng(0)
    motion_px_s = RegionMotion(MIDDLE, np.array([-12.0, 4.0]), 0.1).at(pixels_of(MASK))
    is_wrong = rng.random(MASK.shape) > share
    motion_px_s[is_wrong] = rng.uniform(-100, 100, (is_wrong.sum(), 2))
    found = common_motion(MASK, motion_px_s.astype(np.float32), 0.6, max_misfit_px=0.5)
    assert (found is not None) == is_found
    if found is not None:
        np.testing.assert_allclose(found.middle, MIDDLE, atol=1e-4)
        np.testing.assert_allclose(found.shift_px_s, [-12, 4], atol=1e-3)
        assert found.growth_per_s == pytest.approx(0.1, abs=1e-3)


def test_a_region_without_texture_keeps_the_given_motion() -> None:
    """The grain of the frames must not make it grow or move."""
    grain = np.random.default_rng(2).normal(128, 1.5, (4, *MASK.shape)).round().astype(np.uint8)
    in_front, at_rest = np.ones(MASK.shape, bool), pixels_of(MASK)
    earlier = [
        EarlierFrame(image, elapsed_s, np.eye(3), at_rest, in_front)
        for image, elapsed_s in zip(grain[1:], (0.1, 0.3, 0.6), strict=True)
    ]
    corner = np.zeros_like(MASK)
    corner[40:47, 40:47] = True
    given = RegionMotion(np.array([43.0, 43.0]), np.array([2.0, 1.0]), 0.05)
    found = aligned(given, corner, grain[0], earlier)
    np.testing.assert_allclose(0.6 * found.shift_px_s, 0.6 * given.shift_px_s, atol=0.3)
    assert 0.6 * found.growth_per_s == pytest.approx(0.03, abs=0.05)


def test_an_alignment_finds_shift_and_growth_to_a_hundredth_of_a_pixel() -> None:
    noise = np.random.default_rng(1).normal(0, 1, MASK.shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    last = (128 + 40 * smooth / smooth.std()).clip(0, 255).astype(np.uint8)
    truth = RegionMotion(MIDDLE, np.array([6.0, -4.0]), -0.2)
    earlier = []
    for elapsed_s in (0.1, 0.3, 0.6):
        # The pixel that is at x now was at x + elapsed_s * truth(x): a similarity.
        size = 1 + elapsed_s * truth.growth_per_s
        shift = (1 - size) * MIDDLE + elapsed_s * truth.shift_px_s
        similarity = np.array([[size, 0, shift[0]], [0, size, shift[1]]])
        image = cv2.warpAffine(last, similarity, MASK.shape[::-1], flags=cv2.INTER_CUBIC)
        in_front = np.ones(MASK.shape, bool)
        earlier.append(EarlierFrame(image, elapsed_s, np.eye(3), pixels_of(last), in_front))
    start = RegionMotion(MIDDLE, np.array([3.0, -2.0]), 0.0)
    found = aligned(start, MASK, last, earlier)
    np.testing.assert_allclose(0.6 * found.shift_px_s, 0.6 * truth.shift_px_s, atol=0.01)
    assert found.growth_per_s == pytest.approx(truth.growth_per_s, abs=0.005)
