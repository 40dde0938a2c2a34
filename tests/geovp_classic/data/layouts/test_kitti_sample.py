"""Facts about real KITTI frames, poses and calibration."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic.data.doctor import Doctor
from geovp_classic.data.layouts.kitti import Kitti
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@pytest.fixture(scope="module")
def root() -> Path:
    folder = os.environ.get("GEOVP_TEST_DATA")
    if not folder:
        pytest.skip("GEOVP_TEST_DATA is not set: needs the folder that holds kitti/")
    return Path(folder) / "kitti"


def test_the_sample_is_sound_and_serves_its_splits(root: Path) -> None:
    examination = Doctor().examine(root)
    assert examination.findings == ()
    usable = "test test-colour train train-2026-10 val"
    assert examination.usable_splits == tuple(usable.split())
    columns = ("frames", "size_px", "poses")
    assert {
        row["sequence"]: tuple(row[column] for column in columns) for row in examination.rows
    } == {
        "00": ("image_2: 1018", "416x128", "1018"),
        "02": ("image_0: 300", "845x256", "300"),
        "03": ("image_0: 360", "1242x375", "360"),
        "06": ("image_0: 51, image_1: 51", "1226x370", "51"),
        "raw0009": ("image_2: 400", "848x256", "400"),
        "raw0095": ("image_2: 268", "848x256", "268"),
    }


def test_clips_of_the_test_split(root: Path) -> None:
    data = Kitti(root, split="test")
    # 03: 180 frames, starts 180 to 330 by 10; 06: 51 frames, starts 0, 10, 20
    assert len(data) == 16 + 3
    clip = data[len(data) - 1]
    assert clip.name == "06/000020"
    assert clip.frames.shape == (30, 256, 256, 3)
    # 1226x370: columns 428 to 797; 707.0912 * 256 / 370, (601.8873 - 428 + 0.5) * 256 / 370 - 0.5
    assert clip.intrinsics.fx_px == pytest.approx(489.23067)
    assert clip.intrinsics.cx_px == pytest.approx(120.15716)


def matches(left: np.ndarray, right: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Return the pixels [N, 2] of corners in both images, tracked there and back."""
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (left, right)]
    corners = cv2.goodFeaturesToTrack(grey[0], 400, 0.01, 8)[:, 0]
    there, _, _ = cv2.calcOpticalFlowPyrLK(*grey, corners, None, maxLevel=5)
    back, _, _ = cv2.calcOpticalFlowPyrLK(*grey[::-1], there, None, maxLevel=5)
    good = np.linalg.norm(back - corners, axis=1) < 0.3
    return corners[good].astype(np.float64), there[good].astype(np.float64)


def epipolar_distance_px(
    here: FloatArray, there: FloatArray, there_from_here: FloatArray, matrix: FloatArray
) -> float:
    """Return the median distance of pixels from their epipolar lines."""
    essential = se3.cross_matrix(there_from_here[:3, 3]) @ there_from_here[:3, :3]
    fundamental = np.linalg.inv(matrix).T @ essential @ np.linalg.inv(matrix)
    lines = cv2.computeCorrespondEpilines(here[:, None], 1, fundamental)[:, 0]
    return float(np.median(np.abs((lines[:, :2] * there).sum(axis=1) + lines[:, 2])))


@pytest.mark.parametrize(
    "frames", ["03[80:82)", "raw0095[200:202)", "00[110:112)", "raw0009[220:222)"]
)
def test_poses_intrinsics_and_pixels_of_the_crop_agree_in_a_turn(root: Path, frames: str) -> None:
    clip = Kitti(root, sequences=(frames,), num_frames=2)[0]
    here, there = matches(*clip.frames)
    assert len(here) > 100
    first, second = clip.trajectory.world_from_cam
    second_from_first = se3.inverse(second) @ first
    matrix = clip.intrinsics.matrix
    off_px = epipolar_distance_px(here, there, second_from_first, matrix)
    assert off_px < 0.4
    inverse_off_px = epipolar_distance_px(here, there, se3.inverse(second_from_first), matrix)
    assert inverse_off_px > 10 * off_px


def test_right_frames_see_points_further_left(root: Path) -> None:
    clip = Kitti(root, sequences=("06[0:2)",), num_frames=2, with_full=True, with_right=True)[0]
    right = clip.right
    np.testing.assert_allclose(right.view_from_cam[:3, 3], [-0.5371507, 0, 0], atol=1e-6)
    here, there = matches(clip.full.frames[0], right.frames[0])
    disparity_px = here[:, 0] - there[:, 0]
    assert disparity_px.min() > 0
    assert disparity_px.max() < 707.0912 * 0.5371507 / 4  # nothing nearer than 4 m
    assert epipolar_distance_px(here, there, right.view_from_cam, right.intrinsics.matrix) < 0.6
