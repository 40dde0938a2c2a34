"""Focal length from a turning camera, and none from an uninformative motion."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import street

from geovp_classic.data.frames.image_frames import read_image
from geovp_classic.data.frames.image_names import image_files
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.geometry import se3
from geovp_classic.geometry.pinhole import grey8
from geovp_classic.odometry.focal_length import FocalLengthEstimator
from geovp_classic.types import ByteArray

ESTIMATOR = FocalLengthEstimator()
LEFT_TURN, RIGHT_TURN = 1, 4


@pytest.fixture(scope="module")
def turns() -> list[list[ByteArray]]:
    """Return two drives round a corner with a focal length of 183 px, 318 px wide."""
    world = Synthetic(num_clips=8, num_frames=20, size_px=(96, 96), with_full=True)
    wide = [world[index].full for index in (LEFT_TURN, RIGHT_TURN)]
    assert all(each.intrinsics.fx_px == pytest.approx(183.375) for each in wide)
    return [[grey8(frame) for frame in each.frames] for each in wide]


def straight(step_m: float) -> list[ByteArray]:
    """Return a drive without any rotation."""
    twist = np.array([0.0, 0.0, step_m, 0.0, 0.0, 0.0])
    camera = street.clip().full.intrinsics
    frames, _ = street.render(se3.exp(np.outer(np.arange(20), twist)), camera)
    return [grey8(frame) for frame in frames]


def test_a_turn_determines_the_focal_length_also_above_a_hood(turns: list[list[ByteArray]]) -> None:
    found = ESTIMATOR.estimate(turns)
    assert found.num_windows == 2
    assert found.focal_px == pytest.approx(183.375, rel=0.05)
    assert found.low_px < 183.375 < found.high_px
    assert found.is_sure

    # A patterned hood is ignored.
    height_px, width_px = turns[0][0].shape
    noise = np.random.default_rng(0).normal(size=(height_px, width_px))
    pattern = np.clip(60 + 120 * cv2.GaussianBlur(noise, (0, 0), 1.5), 0, 255).astype(np.uint8)
    top = round(0.7 * height_px)
    hooded = [[np.concatenate([grey[:top], pattern[top:]]) for grey in drive] for drive in turns]
    found = ESTIMATOR.estimate(hooded)
    assert found.focal_px == pytest.approx(183.375, rel=0.05)


@pytest.mark.parametrize("step_m", [0.3, 0.0])
def test_motion_without_a_turn_is_uninformative(step_m: float) -> None:
    found = ESTIMATOR.estimate([straight(step_m)])
    assert found is None or not found.is_sure


@pytest.mark.parametrize(
    ("images", "starts", "focal_px"),
    [
        ("03/image_0", (60, 120), 721.5),  # a turn, and a gentle curve
        ("06/image_0", (0, 20), 707.1),  # straight: the car's pitching is all there is
        ("00/image_2", (0, 190), 242.8),  # resized: the mean of 241.0 and 244.7
        ("raw0095/image_2", (0, 180), 492.6),
    ],
)
def test_calibrated_cars_of_kitti_within_a_tenth(
    images: str, starts: tuple[int, ...], focal_px: float
) -> None:
    root = os.environ.get("GEOVP_TEST_DATA")
    if root is None:
        pytest.skip(f"GEOVP_TEST_DATA is not set: needs kitti/sequences/{images}")
    files = image_files(Path(root) / "kitti" / "sequences" / images)
    found = ESTIMATOR.estimate(
        [grey8(read_image(file)) for file in files[start : start + 30]] for start in starts
    )
    assert found.is_sure
    assert found.focal_px == pytest.approx(focal_px, rel=0.1)
    assert found.low_px < focal_px < found.high_px
