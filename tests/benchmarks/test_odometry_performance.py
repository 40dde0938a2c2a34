"""The speed benchmark measures what it says, on images that slide sideways."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.performance import odometry
from geovp_classic.types import ByteArray, Intrinsics

CAMERA = Intrinsics(200.0, 200.0, 119.5, 79.5, 240, 160)


@pytest.fixture(scope="module")
def frames() -> list[ByteArray]:
    """A fronto-parallel wall 10 m away, passed at 0.2 m an image: 4 px each."""
    rng = np.random.default_rng(0)
    wall = cv2.GaussianBlur(rng.random((160, 300), dtype=np.float32), (0, 0), 1.5)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    return [np.ascontiguousarray(wall[:, 4 * i : 4 * i + 240]) for i in range(6)]


def test_every_image_is_timed_and_the_lines_say_so(frames: list[ByteArray]) -> None:
    timing = odometry.measure(frames, CAMERA)
    assert (len(timing.odometry_s), len(timing.plain_s)) == (6, 5)
    assert (timing.odometry_s > 0).all()
    fast, plain, ratio = timing.lines()
    assert fast.startswith("odometry with bundle adjustment")
    assert plain.startswith("plain ORB")
    expected = timing.plain_s.mean() / timing.odometry_s.mean()
    assert f"ratio: {expected:.2f};" in ratio


def test_the_plain_loop_is_a_fair_one(frames: list[ByteArray]) -> None:
    found = odometry.plain_step(frames[0], frames[1], CAMERA)
    np.testing.assert_allclose(found[:, :3] @ found[:, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.norm(found[:, 3]) == pytest.approx(1)


def test_images_and_calibration_are_read(frames: list[ByteArray], tmp_path: Path) -> None:
    for i, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / f"{i:06d}.png"), frame)
    calib = tmp_path.parent / "calib.txt"
    calib.write_text("P0: 200 0 119.5 0 0 200 79.5 0 0 0 1 0\n")
    read, camera = odometry.read(tmp_path, calib, 4)
    assert camera == CAMERA
    np.testing.assert_array_equal(np.stack(read), np.stack(frames[:4]))
