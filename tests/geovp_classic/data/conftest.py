"""A KITTI folder of a few small images, made anew for each test that damages it."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from video_files import grey_levels, write_video

from geovp_classic import api
from geovp_classic.types import Clip

WIDTH_PX, HEIGHT_PX = 64, 24
NUM_FRAMES = 12
# K = [50 0 31.5; 0 50 11.5; 0 0 1]; camera k sits at x_k metres right of camera 0: p4 = K (-x_k, 0,
# 0).
OFFSET_M = {0: 0.0, 1: 0.5, 2: -0.06, 3: 0.44}


def frame_value(camera: int, index: int) -> int:
    """Return the grey value that fills a frame."""
    return 10 * index + 5 * camera


@pytest.fixture
def kitti_root(tmp_path: Path) -> Path:
    """Sequence 00 with image_2 and image_3, sequence 01 with image_0; 12 frames each at 10 Hz, 1 m
    a frame along z.
    """
    root = tmp_path / "kitti"
    for name, cameras in {"00": (2, 3), "01": (0,)}.items():
        folder = root / "sequences" / name
        for camera in cameras:
            (folder / f"image_{camera}").mkdir(parents=True)
            for index in range(NUM_FRAMES):
                image = np.full((HEIGHT_PX, WIDTH_PX), frame_value(camera, index), np.uint8)
                cv2.imwrite(str(folder / f"image_{camera}" / f"{index:06d}.png"), image)
        lines = [f"P{k}: 50 0 31.5 {-50 * x_m} 0 50 11.5 0 0 0 1 0" for k, x_m in OFFSET_M.items()]
        (folder / "calib.txt").write_text("\n".join([*lines, "Tr: 1 0 0 0 0 1 0 0 0 0 1 0"]) + "\n")
        (folder / "times.txt").write_text("".join(f"{index / 10}\n" for index in range(NUM_FRAMES)))
        (root / "poses").mkdir(exist_ok=True)
        poses = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {index}\n" for index in range(NUM_FRAMES))
        (root / "poses" / f"{name}.txt").write_text(poses)
    return root


@pytest.fixture
def edit() -> Callable[[Path, int, str], None]:
    """A function that puts another text on a line of a file, the first line being 1."""

    def replace_line(path: Path, line: int, text: str) -> None:
        lines = path.read_text().splitlines()
        lines[line - 1] = text
        path.write_text("\n".join(lines) + "\n")

    return replace_line


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Twelve frames of 64x24 pixels at 25 Hz, frame k all grey 10 k."""
    images = grey_levels(12, size_px=(64, 24))
    path = tmp_path / "drive.avi"
    return write_video(path, images, codec="mjpeg", rate=25, pixel_format="yuvj420p")


@pytest.fixture(scope="session")
def street() -> Clip:
    """Twelve frames of 64x64 pixels."""
    return api.open_clip({"name": "synthetic", "num_frames": 12, "size_px": [64, 64]})
