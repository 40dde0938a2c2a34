"""Clips of a folder of images, of several below one root, or of a video, with a camera that the
user gives.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from geovp_classic.data import pose_files
from geovp_classic.data.findings import Findings
from geovp_classic.data.frames import (
    FrameFiles,
    FrameReader,
    Load,
    VideoFrames,
    image_files,
)
from geovp_classic.data.scan import Scan, sequence_folders
from geovp_classic.data.sequences import SequenceDataset
from geovp_classic.data.windows import FrameRange, Recording
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray, Intrinsics, Trajectory

DEFAULT_RATE_HZ = 10.0  # as KITTI; images do not state when they were taken


@dataclass(frozen=True)
class Folder(SequenceDataset):
    """The images of a folder in the order of their names (2 before 10), or the frames of a video.

    A folder without images of its own is a root: each folder of images in it is a sequence,
    `sequences` names some of them ("city", "city[100:400)"), and `times` and `trajectory` are files
    in each.

    `intrinsics` are (fx, fy, cx, cy) in pixels of the images as they are stored; (0, 0) is the
    centre of the top-left one. Times come from the file `times` (one number a line) or from
    `frame_rate_hz`; with neither, from a TUM trajectory if there is one, else from the video's own
    rate, else 10 Hz are assumed. `trajectory` is a KITTI or TUM file with one pose a frame;
    `is_metric` says whether its unit is the metre. `frames` limits the clips of one sequence to
    [first, last). Other settings are `SequenceDataset`'s.
    """

    path: Path
    intrinsics: tuple[float, float, float, float]
    frame_rate_hz: float | None = None
    times: Path | None = None
    trajectory: Path | None = None
    is_metric: bool = True
    frames: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        for name in ("path", "times", "trajectory"):  # scripts give text
            given = getattr(self, name)
            object.__setattr__(
                self, name, None if given is None else Path(given)
            )
        if (
            self.frame_rate_hz is not None
            and not 0.02 <= self.frame_rate_hz < np.inf
        ):
            raise BadData(
                f"frame_rate_hz is {self.frame_rate_hz}, expected a number of at least 0.02"
            )
        if self.frame_rate_hz is not None and self.times is not None:
            raise BadData(
                "both frame_rate_hz and times are given: keep one of them"
            )
        self._check()

    @property
    def name(self) -> str:
        """Return the data set's name in results: that of the folder or the video."""
        path = self.path.resolve()
        return path.name if path.is_dir() else path.stem

    @property
    def split_hash(self) -> str:
        """Return the hash of `ranges` of several sequences; "" for one."""
        return super().split_hash if self._is_root else ""

    @property
    def recording(self) -> Recording:
        """Return all frames of the first sequence with their times, camera and poses."""
        return next(iter(self.recordings.values()))

    @cached_property
    def _wanted(self) -> tuple[FrameRange, ...]:
        if self.frames is None:
            return super()._wanted
        first, last = self.frames
        if not 0 <= first < last:
            raise BadData(
                f"frames is [{first}, {last}], expected 0 <= first < last"
            )
        if self._is_root or self.sequences is not None:
            raise BadData(
                f'frames is of one sequence: give sequences = ["NAME[{first}:{last})"] in its place'
            )
        return (FrameRange(self.name, first, last),)

    @cached_property
    def _folders(self) -> dict[str, Path]:
        if self.path.is_file():
            return {self.name: self.path}
        return self.folders(self.path)

    @property
    def _is_root(self) -> bool:
        return self.path not in self._folders.values()

    def _read(self, name: str, load: Load) -> Recording:
        path = self._folder(name)
        reader: FrameReader
        if path.is_file():
            reader = VideoFrames.open(path)
            size_px = reader.size_px
            rate_hz = reader.rate_hz
        else:
            images = tuple(image_files(path))
            size_px = load(images[0]).shape[1::-1]
            reader = FrameFiles(images, (size_px,) * len(images), load)
            rate_hz = DEFAULT_RATE_HZ
        rate_hz = self.frame_rate_hz or rate_hz
        folder = path if self._is_root else Path()
        trajectory, times_s = self._timed(folder, name, len(reader), rate_hz)
        camera = Intrinsics(*self.intrinsics, *size_px)
        return Recording(
            name, reader, times_s, camera, trajectory, self.camera_height_m
        )

    def _timed(
        self, folder: Path, name: str, num_frames: int, rate_hz: float | None
    ) -> tuple[Trajectory | None, FloatArray]:
        """Return the trajectory of a sequence, if there is one, and the times of its frames."""
        poses = None if self.trajectory is None else folder / self.trajectory
        times_s = None
        if self.times is not None:
            times_s = pose_files.read_times(folder / self.times)
        elif (
            self.frame_rate_hz is not None
            or poses is None
            or not pose_files.has_times(poses)
        ):
            if rate_hz is None:
                raise BadData(
                    f"{name} does not state its frame rate: give frame_rate_hz"
                )
            times_s = np.arange(num_frames) / rate_hz
        trajectory = None
        if poses is not None:
            trajectory = pose_files.read_trajectory(
                poses, times_s, is_metric=self.is_metric
            )
            if times_s is None:
                times_s = trajectory.times_s
            if len(trajectory) == len(times_s):
                trajectory = Trajectory(
                    trajectory.world_from_cam, times_s, self.is_metric
                )
        assert times_s is not None
        return trajectory, times_s

    @staticmethod
    def folders(root: Path) -> dict[str, Path]:
        """Return the folders of images by name: the root, or those in it if it has no images."""
        expected = "a folder of images (png, jpg, webp, bmp, tif, ppm, jp2)"
        return sequence_folders(
            root, lambda path: bool(image_files(path)), expected
        )

    @staticmethod
    def scans(folder: Path) -> dict[str, Scan]:
        """Scan a folder of images, which has neither calibration nor poses."""
        images = tuple(image_files(folder))
        times_s = np.arange(len(images)) / DEFAULT_RATE_HZ
        return {"": Scan(images, times_s, (), Findings())}
