"""Wide blurs on smaller images equal those at full size."""

import cv2
import numpy as np
import pytest

from geovp_classic.rendering.detail_transfer import wide_blur


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


@pytest.mark.parametrize(("number", "sigma_px"), enumerate([1.0, 4.0, 6.0, 8.0, 20.0]))
def test_nearly_equals_the_blur_at_full_size(number: int, sigma_px: float) -> None:
    noise = rng().uniform(0, 255, (5, 96, 128, 3))[number].astype(np.float32)
    image = cv2.GaussianBlur(noise, (0, 0), 1.0)
    exact = np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px))
    off = np.abs(wide_blur(image, sigma_px) - exact)  # grey levels of 255
    assert off[8:-8, 8:-8].max() < 1.5
    assert off.mean() < 0.3 * exact.std() + 0.1


def test_keeps_what_is_even_and_how_wide_a_dot_becomes() -> None:
    assert (wide_blur(np.full((50, 70), 7.0, np.float32), 9.0) == pytest.approx(7.0)) is True
    dot = np.zeros((129, 129), np.float32)
    dot[64, 64] = 1.0
    blurred = wide_blur(dot, 8.0)
    assert blurred.sum() == pytest.approx(1.0, abs=0.01)
    away = np.arange(129) - 64
    assert np.sqrt((blurred * away**2).sum()) == pytest.approx(8.0, rel=0.03)


def test_tiny_images_are_no_trouble() -> None:
    assert wide_blur(np.ones((1, 3), np.float32), 8.0).shape == (1, 3)
