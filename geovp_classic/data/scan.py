"""Sequences as their files describe them.

A layout (`kitti`, `kitti_raw`, `tum`, `euroc`, `colmap`, `folder`) scans a folder into a `Scan`: a
data set raises the first error among its findings, the doctor lists all of them.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geovp_classic.data import pose_files
from geovp_classic.data.findings import Findings
from geovp_classic.data.frames import FrameFiles, Load, image_size
from geovp_classic.data.undistortion import (
    DistortedCamera,
    UndistortedDepths,
    UndistortedFrames,
    common_pinhole,
)
from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.files import is_file, leads_inside
from geovp_classic.types import FloatArray, IntArray, Trajectory


@dataclass(frozen=True)
class Scan:
    """A sequence of N images, whose times, poses and depths were matched to them."""

    images: tuple[Path, ...]  # N
    times_s: FloatArray  # [N], increasing; NaN where a line is bad
    cameras: tuple[DistortedCamera, ...]  # N; empty without a calibration
    findings: Findings
    # [N, 4, 4], NaN for an image without a pose; None if no poses are recorded
    world_from_cam: FloatArray | None = None
    depths: tuple[Path | None, ...] | None = None  # N
    values_per_m: float = 1.0  # of the depth images
    is_metric: bool = True
    starts: frozenset[int] = (
        frozenset()
    )  # images that do not follow the one before
    cam_from_rig: FloatArray = field(
        default_factory=lambda: np.eye(4)
    )  # of one of several cameras

    @property
    def posed(self) -> IntArray:
        """Return the numbers of the images with a pose, or of all if no poses are recorded."""
        if self.world_from_cam is None:
            return np.arange(len(self.images))
        return np.flatnonzero(np.isfinite(self.world_from_cam).all(axis=(1, 2)))

    @property
    def breaks(self) -> tuple[int, ...]:
        """Return the places among `posed` that do not follow the one before."""
        breaks = []
        for place, (before, number) in enumerate(
            itertools.pairwise(self.posed.tolist()), 1
        ):
            if number != before + 1 or number in self.starts:
                breaks.append(place)
        return tuple(breaks)

    def recording(
        self, name: str, source: Path, load: Load, camera_height_m: float | None
    ) -> Recording:
        """Return the sequence for clips, without the images that lack a pose.

        BadData for the first error among the findings.
        """
        self.findings.raise_first()
        numbers = self.posed
        if not len(numbers):
            raise BadData(
                f"{source}: none of {len(self.images)} images has a pose: give images and poses "
                "that match"
            )
        times_s = self.times_s[numbers]
        trajectory = None
        if self.world_from_cam is not None:
            trajectory = Trajectory(
                self.world_from_cam[numbers], times_s, self.is_metric
            )
        images = tuple(self.images[number] for number in numbers)
        cameras = tuple(self.cameras[number] for number in numbers)
        frames = FrameFiles(
            images, tuple(camera.size_px for camera in cameras), load
        )
        view = common_pinhole(cameras, source)
        depths = None
        if self.depths is not None:
            paths = tuple(self.depths[number] for number in numbers)
            depths = UndistortedDepths(paths, cameras, view, self.values_per_m)
        return Recording(
            name,
            UndistortedFrames(frames, cameras, view),
            times_s,
            view,
            trajectory,
            camera_height_m,
            depths=depths,
            breaks=self.breaks,
        )


def sequence_folders(
    root: Path, is_sequence: Callable[[Path], bool], expected: str
) -> dict[str, Path]:
    """Return the sequences of a root by name: the root itself, else its sub-folders.

    BadData if there is none.
    """
    if is_sequence(root):
        return {root.resolve().name: root}
    inside = sorted(path for path in root.glob("*") if path.is_dir())
    sequences = {path.name: path for path in inside if is_sequence(path)}
    if not sequences:
        raise BadData(
            f"{root} does not exist or holds no sequence: give {expected}, or a folder of such "
            "folders"
        )
    return sequences


def first_size(
    images: tuple[Path, ...], findings: Findings
) -> tuple[int, int] | None:
    """Return the size of the first image; None if there is none or it is damaged."""
    try:
        return image_size(images[0]) if images else None
    except BadData as problem:
        findings.add(images[0], problem)
        return None


def nearest(
    times_s: FloatArray,  # [N]
    others_s: FloatArray,  # [M], increasing
    max_difference_s: float,
) -> IntArray:
    """Return the number [N] of the other time nearest to each, -1 beyond the difference."""
    if not len(others_s):
        return np.full(len(times_s), -1)
    midpoints_s = (others_s[1:] + others_s[:-1]) / 2
    closest = np.searchsorted(midpoints_s, times_s)
    is_near = np.abs(others_s[closest] - times_s) <= max_difference_s
    return np.where(is_near, closest, -1)


def matched(
    times_s: FloatArray,  # [N]
    pose_times_s: FloatArray,  # [M], increasing
    poses: FloatArray,  # [M, 4, 4], NaN where a line is bad
    max_difference_s: float,
) -> FloatArray:
    """Return the pose [N, 4, 4] nearest in time, NaN beyond the difference."""
    good = np.isfinite(poses[:, 0, 0])
    numbers = nearest(times_s, pose_times_s[good], max_difference_s)
    is_near = numbers >= 0
    matches = np.full((len(times_s), 4, 4), np.nan)
    matches[is_near] = poses[good][numbers[is_near]]
    return matches


def scan_list(
    path: Path, folder: Path, findings: Findings, separator: str = " "
) -> tuple[FloatArray, tuple[Path, ...]]:
    """Scan a list of times [N] and images in a folder, without its bad lines."""
    times_s: list[float] = []
    images: list[Path] = []
    for number, text in pose_files.read_lines(path, findings):
        time, _, file = (part.strip() for part in text.partition(separator))
        numbers = pose_files.parse_numbers(path, number, [time], (1,), findings)
        if numbers is None:
            continue
        if not leads_inside(file):
            message = f"{file!r} leads out of the folder: give a path inside it"
        elif not is_file(folder / file):
            message = (
                f"there is no file {file[:200]!r}, expected 'time{separator}file': restore it or "
                "remove the line"
            )
        elif times_s and numbers[0] <= times_s[-1]:
            message = f"time {numbers[0]:.15g} is not after {times_s[-1]:.15g} before it"
        else:
            times_s.append(numbers[0])
            images.append(folder / file)
            continue
        findings.error(path, message, number)
    return np.array(times_s), tuple(images)
