"""Poses that no vehicle drove through are found; driving is not."""

from collections.abc import Iterable

import cv2
import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.odometry.consistency import (
    changes_by_noise_alone,
    driven,
    is_sideways,
    is_standing,
    measured,
)
from geovp_classic.odometry.monocular import Monocular
from geovp_classic.odometry.unit_scale import UnitSpeed
from geovp_classic.types import ByteArray, Context, FloatArray, Intrinsics

TIMES_S = 0.1 * np.arange(10)


def path(progress: FloatArray) -> FloatArray:
    """Poses [P, 4, 4] along a bend of 20 m radius."""
    return np.asarray(se3.exp(progress[:, None] * np.array([0, 0, 1.0, 0, 0.05, 0])))


@pytest.mark.parametrize("swap", [(4, 5), (7, 8), (8, 9)])
def test_swapped_frames(swap: tuple[int, int]) -> None:
    progress = 8.0 * TIMES_S
    progress[list(swap)] = progress[list(swap[::-1])]
    assert np.flatnonzero(~driven(path(progress), TIMES_S)).tolist() == list(swap)


@pytest.mark.parametrize("acceleration", [-8.0, 0.0, 5.0])
def test_braking_standing_and_reversing_are_driven(acceleration: float) -> None:
    noise = np.random.default_rng(0).normal(0, 0.01, 10)
    assert driven(path(8 * TIMES_S + acceleration / 2 * TIMES_S**2 + noise), TIMES_S).all()
    assert driven(path(-3 * TIMES_S), TIMES_S).all()
    assert driven(path(0.01 * noise), TIMES_S).all()
    assert driven(path(TIMES_S[:1]), TIMES_S[:1]).all()


def test_where_nothing_agrees_nothing_is_said() -> None:
    progress = np.random.default_rng(1).uniform(-5, 5, 10)
    assert driven(path(progress), TIMES_S).all()


def test_a_camera_goes_sideways_where_it_does() -> None:
    assert not is_sideways(path(8.0 * TIMES_S))
    assert not is_sideways(path(-3.0 * TIMES_S))
    assert is_sideways(se3.exp(TIMES_S[:, None] * np.array([-5.0, 0, 2.0, 0, 1.3, 0])))
    assert not is_sideways(path(TIMES_S[:1]))


@pytest.mark.parametrize(
    ("tracked", "known"),
    [
        ("1111111111", "1111111111"),
        ("1000010000", "1000010000"),  # found again in the same map: measured relative to the first
        (
            "1000001111",
            "0000011111",
        ),  # started anew from the sixth; the first has nothing to do with it
        ("1111000000", "1111000000"),
        ("1110000011", "1110000000"),  # started anew as well, but with fewer
        ("1100000111", "0000001111"),
        ("1110011000", "1110011000"),
        ("1000000000", "1000000000"),
        ("1", "1"),
    ],
)
def test_what_was_measured_of_a_path_with_gaps(tracked: str, known: str) -> None:
    marks = np.array([mark == "1" for mark in tracked])
    assert "".join("1" if found else "0" for found in measured(marks, most_bridged=4)) == known


def crossed(street: ByteArray, vehicle: ByteArray, left: int, size: int) -> ByteArray:
    """The street behind a part of another image, which covers `size` of its 128 columns from `left`
    on.
    """
    image = street.copy()
    columns = slice(left, min(left + size, 128))
    image[35:115, columns] = vehicle[35:115, : columns.stop - left]
    return image


@pytest.fixture
def textures() -> tuple[ByteArray, ByteArray]:
    noise = np.random.default_rng(1).random((2, 128, 128)).astype(np.float32)
    street, vehicle = (cv2.GaussianBlur(each, (0, 0), 2) for each in noise)
    return tuple(
        cv2.normalize(each, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
        for each in (street, vehicle)
    )


class TestStands:
    """Streets of 128 x 128 pixels behind a vehicle, seen ten times with noise."""

    @staticmethod
    def noisy(images: Iterable[ByteArray]) -> list[ByteArray]:
        rng = np.random.default_rng(2)
        return [
            np.clip(image + rng.normal(0, 1.5, image.shape), 0, 255).astype(np.uint8)
            for image in images
        ]

    def test_behind_a_bus_that_crosses(self, textures: tuple[ByteArray, ByteArray]) -> None:
        street, vehicle = textures
        images = self.noisy(crossed(street, vehicle, 6 * k, 100) for k in range(10))
        assert is_standing(images)
        camera = Intrinsics(150.0, 150.0, 63.5, 63.5, 128, 128)
        clip = Context(
            np.repeat(np.stack(images)[..., None], 3, axis=-1), 0.1 * np.arange(11), camera
        )
        trajectory, tracked = Monocular(scale=UnitSpeed()).track(clip)
        np.testing.assert_array_equal(trajectory.world_from_cam, np.tile(np.eye(4), (10, 1, 1)))
        assert tracked.all()

    def test_not_behind_a_truck_that_is_followed(
        self, textures: tuple[ByteArray, ByteArray]
    ) -> None:
        street, vehicle = textures
        assert not is_standing(
            self.noisy(crossed(np.roll(street, 6 * k, axis=1), vehicle, 32, 60) for k in range(10))
        )

    @pytest.mark.parametrize("step_px", [0.1, 0.3, 3.0])
    def test_not_where_the_camera_creeps_or_turns(
        self, textures: tuple[ByteArray, ByteArray], step_px: float
    ) -> None:
        moved = (np.array([[1, 0, step_px * k], [0, 1, 0]], np.float32) for k in range(10))
        street = textures[0]
        assert not is_standing(
            self.noisy(
                cv2.warpAffine(street, each, (128, 128), borderMode=cv2.BORDER_WRAP)
                for each in moved
            )
        )

    def test_not_without_corners(self) -> None:
        assert not is_standing(self.noisy([np.full((128, 128), 90, np.uint8)] * 10))


@pytest.mark.parametrize("sigma", [10.0, 60.0])
def test_a_camera_stands_behind_noise_and_drives_behind_noise(sigma: float) -> None:
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (120, 300)).astype(np.float32), (0, 0), 2.0)
    texture = 128 + 4 * (texture - texture.mean())

    def images(step_px: float) -> list[ByteArray]:
        shown = [texture[:, round(step_px * n) :][:, :160] for n in range(10)]
        return [
            (one + rng.normal(0, sigma, one.shape)).clip(0, 255).astype(np.uint8) for one in shown
        ]

    assert changes_by_noise_alone(images(0.0))
    assert is_standing(images(0.0))
    assert not changes_by_noise_alone(images(0.5))
    assert not changes_by_noise_alone(images(10.0))
    assert not changes_by_noise_alone(
        [images(0.0)[0]] * 10
    )  # nothing changes at all: corners say so
