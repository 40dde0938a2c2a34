"""Clips of a folder of images or a video file, with a camera that the user gives."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from geovp_classic.data import pose_files, windows
from geovp_classic.data.frames import FrameCache, FrameFiles, FrameReader, VideoFrames, image_files, read_image
from geovp_classic.data.windows import FrameRange, Recording
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, FloatArray, Intrinsics, Trajectory

FOLDER_RATE_HZ = 10.0  # as KITTI; images don't say when they were taken


@dataclass(frozen=True)
class Folder:
    """The images of a folder in the order of their names (2 before 10), or the frames of a video.

    `intrinsics` are (fx, fy, cx, cy) in pixels of the images as they are stored, (0, 0) the top-left one's centre.
    Times come from the file `times` (one number a line) or from `frame_rate_hz`; with neither, from a TUM trajectory if
    there is one, else from the video's own rate, else 10 Hz is taken. `trajectory` is a KITTI or TUM file with one pose
    a frame; `is_metric` says whether its unit is the metre. `frames` limits the clips to [first, last).
    """

    path: Path
    intrinsics: tuple[float, float, float, float]
    frame_rate_hz: float | None = None
    times: Path | None = None
    trajectory: Path | None = None
    is_metric: bool = True
    camera_height_m: float | None = None
    frames: tuple[int, int] | None = None
    num_frames: int = 30
    stride: int = 10
    size_px: tuple[int, int] = (256, 256)
    with_wide: bool = False

    def __post_init__(self) -> None:
        """Raise BadData unless the images, times and poses fit together and give at least one clip."""
        for name in ("path", "times", "trajectory"):  # scripts give text
            given = getattr(self, name)
            object.__setattr__(self, name, None if given is None else Path(given))
        windows.check_protocol(self.num_frames, self.stride, self.size_px)
        if self.frame_rate_hz is not None and not 0 < self.frame_rate_hz < np.inf:
            raise BadData(f"frame_rate_hz is {self.frame_rate_hz}, expected a positive number")
        if self.frame_rate_hz is not None and self.times is not None:
            raise BadData("both frame_rate_hz and times are given: keep one of them")
        len(self)

    def __getstate__(self) -> dict[str, Any]:
        """The settings alone, so that a copy in another process opens its own files."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}

    @property
    def name(self) -> str:
        """The data set's name in results: that of the folder or the video."""
        path = self.path.resolve()
        return path.name if path.is_dir() else path.stem

    @property
    def ranges(self) -> tuple[FrameRange, ...]:
        """The frames that clips are cut from."""
        first, last = self.frames if self.frames is not None else (0, len(self.recording.frames))
        if not 0 <= first < last:
            raise BadData(f"frames is [{first}, {last}], expected first < last, both from 0, the last one exclusive")
        return (FrameRange(self.name, first, last).within(len(self.recording.frames)),)

    @property
    def clip_names(self) -> tuple[str, ...]:
        """The clips' names in order, without reading the clips."""
        return tuple(windows.clip_name(self.name, first) for first in self._starts)

    @cached_property
    def recording(self) -> Recording:
        """All frames with their times, camera and poses."""
        reader, size_px, rate_hz = self._open()
        trajectory, times_s = self._timed(len(reader), rate_hz)
        return Recording(self.name, reader, times_s, self._camera(size_px), trajectory, self.camera_height_m)

    def __len__(self) -> int:
        """The number of clips."""
        return len(self._starts)

    def __getitem__(self, index: int) -> Clip:
        """One clip; BadData names the image that is wrong."""
        first = self._starts[index]
        return windows.cut(self.recording, first, self.num_frames, self.size_px, with_wide=self.with_wide)

    @cached_property
    def _starts(self) -> range:
        return windows.starts(self.ranges[0], self.num_frames, self.stride)

    def _open(self) -> tuple[FrameReader, tuple[int, int], float | None]:
        """The frames, their size, and their rate in Hz where it is known."""
        if self.path.is_file():
            video = VideoFrames.open(self.path)
            return video, video.size_px, video.rate_hz
        if not self.path.is_dir():
            raise BadData(f"{self.path} does not exist: give a folder of images or a video file")
        paths = tuple(image_files(self.path))
        if not paths:
            raise BadData(f"{self.path} holds no images (png, jpg, webp, bmp, tif, ppm, jp2)")
        load = FrameCache(read_image)
        height_px, width_px = load(paths[0]).shape[:2]
        return FrameFiles(paths, (width_px, height_px), load), (width_px, height_px), FOLDER_RATE_HZ

    def _camera(self, size_px: tuple[int, int]) -> Intrinsics:
        camera = Intrinsics(*self.intrinsics, *size_px)
        if not (0 <= camera.cx_px < size_px[0] and 0 <= camera.cy_px < size_px[1]):
            raise BadData(
                f"intrinsics {list(self.intrinsics)} put the principal point outside the images of "
                f"{size_px[0]}x{size_px[1]}: give (fx, fy, cx, cy) in pixels of the images as they are stored"
            )
        return camera

    def _timed(self, num_frames: int, rate_hz: float | None) -> tuple[Trajectory | None, FloatArray]:
        """The trajectory, if there is one, and the times of all frames."""
        times_s = None if self.times is None else pose_files.read_times(self.times)
        if times_s is not None and len(times_s) != num_frames:
            raise BadData(f"{self.times}: {len(times_s)} times for {num_frames} frames, expected one each")
        has_own_times = self.trajectory is not None and pose_files.has_times(self.trajectory)
        if times_s is None and (self.frame_rate_hz is not None or not has_own_times):
            rate_hz = self.frame_rate_hz or rate_hz
            if rate_hz is None:
                raise BadData(f"{self.path} does not say how many frames a second it has: give frame_rate_hz")
            times_s = np.arange(num_frames) / rate_hz
        if self.trajectory is None:
            assert times_s is not None
            return None, times_s
        trajectory = pose_files.read_trajectory(self.trajectory, times_s, is_metric=self.is_metric)
        if len(trajectory) != num_frames:
            raise BadData(f"{self.trajectory}: {len(trajectory)} poses for {num_frames} frames, expected one each")
        if times_s is not None:
            trajectory = Trajectory(trajectory.world_from_cam, times_s, self.is_metric)
        return trajectory, trajectory.times_s
