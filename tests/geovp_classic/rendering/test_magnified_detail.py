"""Detail is transferred to magnified surfaces, at the contrast of the view."""

import cv2
import numpy as np
import pytest

from geovp_classic.geometry import pinhole
from geovp_classic.rendering.magnified_detail import MagnifiedDetail, wide_blur


def test_detail_is_added_only_where_magnification_removed_it() -> None:
    observed = np.random.default_rng(1).integers(60, 200, (48, 64, 3), dtype=np.uint8)
    magnification = np.ones((1, 48, 64), np.float32)
    detail = MagnifiedDetail()
    same = detail.transfer(observed[None], magnification, observed)
    np.testing.assert_array_equal(same[0], observed)

    magnification[..., 32:] = 3.0
    blurred = pinhole.resize(pinhole.resize(observed, (16, 12)), (64, 48))
    transferred = detail.transfer(blurred[None], magnification, observed)[0]
    before = np.abs(np.diff(blurred.astype(int), axis=1)).mean(axis=(0, 2))
    roughness = np.abs(np.diff(transferred.astype(int), axis=1)).mean(axis=(0, 2))
    assert roughness[36:].mean() > 1.5 * before[36:].mean()
    np.testing.assert_allclose(roughness[:28], before[:28])

    uniform = np.full_like(observed, 128)
    transferred = detail.transfer(uniform[None], magnification, observed)[0]
    assert np.abs(transferred.astype(int) - 128).mean() < 5  # stays uniform


@pytest.mark.parametrize("sigma_px", [4.0, 20.0])
def test_wide_blur_nearly_equals_a_gaussian_blur(sigma_px: float) -> None:
    noise = np.random.default_rng(1).uniform(0, 255, (96, 128, 3)).astype(np.float32)
    image = cv2.GaussianBlur(noise, (0, 0), 1.0)
    difference = wide_blur(image, sigma_px) - cv2.GaussianBlur(image, (0, 0), sigma_px)
    assert np.abs(difference[8:-8, 8:-8]).max() < 2.0  # grey levels of 255
