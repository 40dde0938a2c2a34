"""A stationary camera behind moving objects and noise, and moving ones that look similar."""

from collections.abc import Iterable

import cv2
import numpy as np
import pytest

from geovp_classic.odometry.monocular import Monocular
from geovp_classic.odometry.stationarity import Stationarity
from geovp_classic.odometry.unit_scale import UnitSpeed
from geovp_classic.types import ByteArray, Context, Intrinsics

CHECK = Stationarity()


def texture(seed: int) -> ByteArray:
    """Return a random image of 128 x 128 pixels."""
    noise = np.random.default_rng(seed).random((128, 128)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 2)
    return cv2.normalize(blurred, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


STREET = texture(1)
VEHICLE = texture(2)


def crossed(street: ByteArray, left: int, size: int) -> ByteArray:
    """Return the street behind a vehicle that covers `size` of its columns from `left` on."""
    image = street.copy()
    image[35:115, left : left + size] = VEHICLE[35:115, left : left + size]
    return image


def noisy(images: Iterable[ByteArray], sigma: float = 1.5) -> ByteArray:
    """Return ten images [10, H, W] with noise."""
    stack = np.stack(list(images)).astype(np.float64)
    noise = np.random.default_rng(2).normal(0, sigma, stack.shape)
    return np.clip(stack + noise, 0, 255).astype(np.uint8)


def test_behind_a_bus_that_crosses_the_camera_is_stationary() -> None:
    images = noisy(crossed(STREET, 6 * step, 100) for step in range(10))
    assert CHECK.is_stationary(images)
    camera = Intrinsics(150.0, 150.0, 63.5, 63.5, 128, 128)
    clip = Context(np.repeat(images[..., None], 3, axis=-1), 0.1 * np.arange(11), camera)
    trajectory, tracked = Monocular(scale=UnitSpeed()).track(clip)
    np.testing.assert_array_equal(trajectory.world_from_cam, np.tile(np.eye(4), (10, 1, 1)))
    assert tracked.all()


def test_behind_a_truck_that_is_followed_the_camera_moves() -> None:
    streets = (np.roll(STREET, 6 * step, axis=1) for step in range(10))
    assert not CHECK.is_stationary(noisy(crossed(street, 32, 60) for street in streets))


@pytest.mark.parametrize("step_px", [0.1, 0.3, 3.0])
def test_a_creeping_camera_moves(step_px: float) -> None:
    images = []
    for step in range(10):
        shift = np.array([[1, 0, step_px * step], [0, 1, 0]], np.float32)
        images.append(cv2.warpAffine(STREET, shift, (128, 128), borderMode=cv2.BORDER_WRAP))
    assert not CHECK.is_stationary(noisy(images))


def test_a_camera_without_corners_is_not_stationary() -> None:
    assert not CHECK.is_stationary(noisy([np.full((128, 128), 90, np.uint8)] * 10))


@pytest.mark.parametrize("sigma", [10.0, 60.0])
def test_noise_hides_no_motion(sigma: float) -> None:
    wide = cv2.GaussianBlur(
        np.random.default_rng(0).uniform(0, 255, (120, 300)).astype(np.float32), (0, 0), 2.0
    )
    wide = 128 + 4 * (wide - wide.mean())

    def images(step_px: float) -> ByteArray:
        return noisy((wide[:, round(step_px * n) :][:, :160] for n in range(10)), sigma)

    assert CHECK.is_white_noise(images(0.0))
    assert CHECK.is_stationary(images(0.0))
    assert not CHECK.is_white_noise(images(0.5))
    assert not CHECK.is_white_noise(images(10.0))
    assert not CHECK.is_white_noise(np.repeat(images(0.0)[:1], 10, axis=0))
