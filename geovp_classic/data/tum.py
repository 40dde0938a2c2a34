"""Clips of TUM RGB-D (Sturm et al. 2012), or of anything laid out like it.

A sequence is a folder with `rgb.txt` and, if they are known, `depth.txt` and `groundtruth.txt`. The
lists hold `time file`, times in seconds; the poses `t x y z qx qy qz qw`. Depth images hold 5000
values a metre, 0 where unknown.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from geovp_classic.data import pose_files, posed_sequences
from geovp_classic.data.findings import Finding, error
from geovp_classic.data.frames import image_size
from geovp_classic.data.posed_sequences import PosedSequences, Scanned, matched, nearest, scan_list
from geovp_classic.data.undistortion import DistortedCamera
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics

VALUES_PER_M = 5000.0
MAX_DIFFERENCE_S = 0.02  # as the data set's own associate.py
Numbers = tuple[float, float, float, float]
Distortion = tuple[float, float, float, float, float]
# The colour cameras by the number after "freiburg" in a sequence's name: fx, fy, cx, cy and k1, k2,
# p1, p2, k3, from
# "Intrinsic Camera Calibration of the Kinect" on the data set's pages
# (vision.in.tum.de/data/datasets/rgbd-dataset).
FREIBURG: dict[str, tuple[Numbers, Distortion]] = {
    "1": ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "2": ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "3": ((535.4, 539.2, 320.1, 247.6), (0.0, 0.0, 0.0, 0.0, 0.0)),
}


@dataclass(frozen=True)
class Tum(PosedSequences):
    """TUM RGB-D; settings as `PosedSequences`'.

    `intrinsics` are (fx, fy, cx, cy) and `distortion` (k1, k2, p1, p2, k3), in pixels of the stored
    images; without them, those of the camera that the sequence's name says (freiburg1, 2 or 3).
    Poses and depths belong to the image whose time is nearest, at most `max_difference_s` away.
    Times are those of rgb.txt.
    """

    name: ClassVar[str] = "tum"

    intrinsics: Numbers | None = None
    distortion: Distortion | None = None
    max_difference_s: float = MAX_DIFFERENCE_S

    def _folders(self) -> dict[str, Path]:
        return folders(self.root)

    def _scan(self, folder: Path) -> Scanned:
        if self.distortion is not None and self.intrinsics is None:
            raise BadData(
                "distortion is given without intrinsics: give both, they are of one calibration"
            )
        lens = (
            None
            if self.intrinsics is None
            else (self.intrinsics, self.distortion or FREIBURG["3"][1])
        )
        scanned = scan(folder, lens, self.max_difference_s)
        if scanned.images and not scanned.cameras:
            raise BadData(
                f"{folder} is not of freiburg1, 2 or 3 by its name: give intrinsics = [fx, fy, "
                "cx, cy]"
            )
        return scanned


def folders(root: Path) -> dict[str, Path]:
    """The sequences of a root by name."""
    return posed_sequences.folders(
        root, lambda path: (path / "rgb.txt").is_file(), "a folder with rgb.txt"
    )


def scan(
    folder: Path,
    lens: tuple[Numbers, Distortion] | None = None,
    max_difference_s: float = MAX_DIFFERENCE_S,
) -> Scanned:
    """A sequence as its files describe it; without a lens, the one that the folder's name says."""
    times_s, images, findings = scan_list(folder / "rgb.txt", folder)
    depths, poses = None, None
    if (folder / "depth.txt").exists():
        depth_times_s, paths, found = scan_list(folder / "depth.txt", folder)
        findings += found
        numbers = nearest(times_s, depth_times_s, max_difference_s)
        depths = tuple(paths[number] if number >= 0 else None for number in numbers)
    if (folder / "groundtruth.txt").exists():
        table, found = pose_files.scan_tum(folder / "groundtruth.txt")
        findings += found
        keys = np.zeros(0) if table.keys is None else table.keys
        poses = matched(times_s, keys, table.world_from_cam, max_difference_s)
    known = re.search(r"freiburg([123])(?!\d)", folder.resolve().name)
    lens = lens or (FREIBURG[known[1]] if known else None)
    cameras, found = _cameras(images, lens)
    return Scanned(images, times_s, cameras, (*findings, *found), poses, depths, VALUES_PER_M)


def _cameras(
    images: tuple[Path, ...], lens: tuple[Numbers, Distortion] | None
) -> tuple[tuple[DistortedCamera, ...], list[Finding]]:
    """The camera of every image, all of the first one's size; none, and why, where it does not fit
    that size.
    """
    if lens is None or not images:
        return (), []
    (numbers, distortion), size_px = lens, (0, 0)
    try:
        size_px = image_size(images[0])
        Intrinsics(*numbers, *size_px)
    except BadData as problem:
        return (), [error(images[0], None, str(problem).removeprefix(f"{images[0]} "))]
    if not (0 <= numbers[2] < size_px[0] and 0 <= numbers[3] < size_px[1]):
        outside = (
            f"is {size_px[0]}x{size_px[1]}, and intrinsics {list(numbers)} put the principal "
            "point outside"
        )
        return (), [
            error(images[0], None, f"{outside}: give those of the images as they are stored")
        ]
    return (
        DistortedCamera.of("FULL_OPENCV", numbers, (*distortion, 0.0, 0.0, 0.0), size_px),
    ) * len(images), []
