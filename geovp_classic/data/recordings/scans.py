"""Scanned sequences: what a layout finds in the files of one, matched by number or by time."""

import itertools
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from geovp_classic import files
from geovp_classic.data.findings import Findings, parse_numbers, words
from geovp_classic.data.frames import image_frames
from geovp_classic.data.frames.image_frames import FrameFiles, FrameReader, Load, Size
from geovp_classic.data.frames.undistortion import (
    DistortedCamera,
    UndistortedFrames,
    common_pinhole,
)
from geovp_classic.data.recordings.windows import Recording, SelectedFrames
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray, IntArray, Trajectory


@dataclass(frozen=True)
class Scan:
    """A sequence of N images, whose times, poses and depths were matched to them."""

    images: tuple[Path, ...]  # N, files, or the names of frames of `reader`
    times_s: FloatArray  # [N], increasing; NaN where a line is bad
    cameras: tuple[DistortedCamera, ...] = ()  # N; empty without a calibration
    # [N, 4, 4], NaN for an image without a pose; None if no poses are recorded
    world_from_cam: FloatArray | None = None
    depths: tuple[Path | None, ...] | None = None  # N
    is_metric: bool = True
    # of one of several cameras
    rig_from_cam: FloatArray = field(default_factory=lambda: np.eye(4))
    camera_height_m: float | None = None  # by the calibration
    reader: FrameReader | None = None  # N, of images that are not files

    def mounted(
        self,
        camera: DistortedCamera,
        rig_from_cam: FloatArray,  # [4, 4]
        world_from_rig: FloatArray | None = None,  # [N, 4, 4]
    ) -> "Scan":
        """Return the scan of a camera on a rig, whose poses may be known."""
        poses = world_from_rig
        if poses is not None:
            poses = poses @ rig_from_cam
        return replace(
            self,
            cameras=(camera,) * len(self.images),
            rig_from_cam=rig_from_cam,
            world_from_cam=poses,
        )

    @property
    def posed(self) -> IntArray:
        """Return the numbers of the images with a pose, or of all if no poses are recorded."""
        if self.world_from_cam is None:
            return np.arange(len(self.images))
        return np.flatnonzero(np.isfinite(self.world_from_cam).all(axis=(1, 2)))

    @property
    def breaks(self) -> tuple[int, ...]:
        """Return the places among `posed` that do not follow the one before.

        An image lacks its pose there, or lies in another folder.
        """
        posed = [(number, self.images[number].parent) for number in self.posed]
        pairs = enumerate(itertools.pairwise(posed), 1)
        return tuple(
            place
            for place, ((before, folder), following) in pairs
            if following != (before + 1, folder)
        )

    @property
    def depth_maps(self) -> FrameFiles:
        """Return the depths [N], 0 where an image is missing; none without a camera."""
        return FrameFiles(self.depths or (), self._sizes_px, image_frames.read_depth)

    @property
    def _sizes_px(self) -> tuple[Size, ...]:
        return tuple(camera.size_px for camera in self.cameras)

    def recording(self, name: str, folder: Path, load: Load, is_upright: bool) -> Recording:
        """Return the images with a pose as a recording of clips, which loads them later.

        BadData without a camera, or without an image with a pose.
        """
        numbers = self.posed
        if not self.cameras:
            raise BadData(f"{folder} has no known camera: give intrinsics = [fx, fy, cx, cy]")
        if not len(numbers):
            raise BadData(
                f"{folder}: none of {len(self.images)} images has a pose: give images and poses "
                "that match"
            )

        # All images are shown as one pinhole camera sees them; depths are not interpolated
        view = common_pinhole([self.cameras[number] for number in numbers], folder)
        frames = self.reader or FrameFiles(self.images, self._sizes_px, load)
        if not is_upright:
            frames = UndistortedFrames(frames, self.cameras, view)
        depths = None
        if self.depths is not None:
            shown = UndistortedFrames(self.depth_maps, self.cameras, view, cv2.INTER_NEAREST)
            depths = SelectedFrames(shown, numbers)

        # Images without a pose are left out
        times_s = self.times_s[numbers]
        trajectory = None
        if self.world_from_cam is not None:
            poses = self.world_from_cam[numbers]
            trajectory = Trajectory(poses, times_s, self.is_metric)
        return Recording(
            name,
            SelectedFrames(frames, numbers),
            times_s,
            view,
            trajectory,
            self.camera_height_m,
            depths=depths,
            breaks=self.breaks,
        )


def sequence_folders(
    root: Path, is_sequence: Callable[[Path], bool], expected: str
) -> dict[str, Path]:
    """Return the sequences of a root by name: the root itself, else those in it.

    BadData if there is none. Folders that cannot be read are ignored, as lost+found of a disk.
    """
    if is_sequence(root):
        return {root.resolve().name: root}
    paths = [path for path in sorted(root.glob("*")) if path.is_file() or os.access(path, os.R_OK)]
    folders = {path.name: path for path in paths if is_sequence(path)}
    if not folders:
        raise BadData(
            f"{root} does not exist or holds no sequence: give {expected}, or a folder of several"
        )
    return folders


def per_frame(
    read: Callable[[Path, Findings], FloatArray],
    path: Path,
    images: tuple[Path, ...],
    findings: Findings,
) -> FloatArray:
    """Read the values [N, ...] of a file, which should be one for each of N frames.

    If there are fewer or more, the difference is reported and all values are NaN.
    """
    values = read(path, findings)
    count = len(images)
    if len(values) == count:
        return values
    if len(values):
        findings.add(path, f"{len(values)} rows for {count} frames, expected one each")
    return np.full((count, *values.shape[1:]), np.nan)


def nearest(
    times_s: FloatArray,  # [N]
    others_s: FloatArray,  # [M], increasing
    max_difference_s: float,
) -> IntArray:
    """Return the number [N] of the other time nearest to each, -1 beyond the difference."""
    if not len(others_s):
        return np.full(len(times_s), -1)
    closest = np.searchsorted((others_s[1:] + others_s[:-1]) / 2, times_s)
    is_near = np.abs(others_s[closest] - times_s) <= max_difference_s
    return np.where(is_near, closest, -1)


def nearest_poses(
    times_s: FloatArray,  # [N]
    pose_times_s: FloatArray,  # [M], increasing; NaN where a line is bad
    poses: FloatArray,  # [M, 4, 4]
    max_difference_s: float,
) -> FloatArray:
    """Return the pose [N, 4, 4] nearest in time, NaN beyond the difference."""
    good = np.isfinite(pose_times_s)
    numbers = nearest(times_s, pose_times_s[good], max_difference_s)
    with_missing = np.append(poses[good], np.full((1, 4, 4), np.nan), axis=0)
    return with_missing[numbers]


def read_list(
    path: Path, folder: Path, findings: Findings, unit: str = "s"
) -> tuple[FloatArray, tuple[Path, ...]]:
    """Read a list of times [N] in a unit and images in a folder, without its bad lines."""

    def parse_line(text: str) -> tuple[float, Path]:
        time, *rest = words(text, 1)
        name = "".join(rest)
        numbers = parse_numbers(time, 1)
        if not files.leads_inside(name) or not os.path.isfile(folder / name):
            raise BadData(
                f"there is no file {name[:200]!r} in the folder, expected 'time file': restore it "
                "or remove the line"
            )
        return numbers[0], folder / name

    stamps, images = findings.parse(path, parse_line)
    times = np.array(stamps, np.float64)
    findings.check_steps(path, times, unit)
    return times, tuple(images)
