"""Clips written as sequences of KITTI odometry."""

from pathlib import Path

import cv2
import numpy as np

from geovp_classic.data.formats import pose_files
from geovp_classic.types import Clip


def write_kitti(root: Path, sequence: str, clip: Clip, camera: int = 0) -> None:
    """Write frames, calibration, times and true poses; all cameras are at one place."""
    folder = root / "sequences" / sequence
    (folder / f"image_{camera}").mkdir(parents=True)
    for step, frame in enumerate(clip.frames):
        cv2.imwrite(str(folder / f"image_{camera}/{step:06d}.png"), frame[..., ::-1])
    projection = np.column_stack([clip.intrinsics.matrix, np.zeros(3)]).ravel()
    numbers = " ".join(f"{number:.9g}" for number in projection)
    (folder / "calib.txt").write_text("".join(f"P{each}: {numbers}\n" for each in range(4)))
    np.savetxt(folder / "times.txt", clip.times_s, fmt="%.6f")
    (root / "poses").mkdir(exist_ok=True)
    pose_files.write_kitti(root / f"poses/{sequence}.txt", clip.trajectory)
