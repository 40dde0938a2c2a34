"""Clips of a folder of images, of several below one root, or of a video, with a camera that the
user gives.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from geovp_classic.data.findings import Findings
from geovp_classic.data.formats import pose_files
from geovp_classic.data.frames.image_frames import (
    FrameFiles,
    FrameReader,
    image_files,
    image_series,
)
from geovp_classic.data.frames.video_frames import VideoFrames
from geovp_classic.data.recordings.sequences import Scan, SequenceDataset, sequence_folders
from geovp_classic.data.recordings.windows import Rate, Recording
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray, Intrinsics

DEFAULT_RATE_HZ = 10.0  # as KITTI; images do not state when they were taken


@dataclass(frozen=True)
class Folder(SequenceDataset):
    """The images of a folder in the order of their names (2 before 10), or the frames of a video.

    A folder without images of its own is a root: each folder of images in it is a sequence,
    `times` and `trajectory` are files in each. `sequences` names some of them, or frames of them
    ("city", "city[100:400)").

    Images are shown upright, as their EXIF data say, and a video with square pixels, too;
    `intrinsics` are (fx, fy, cx, cy) in pixels of these, (0, 0) being the centre of the top-left
    one. The times of a video are those of presentation; for images they come from the file `times`
    (one number a line) or from `frame_rate_hz`; with neither, from a TUM trajectory if there is
    one, else 10 Hz are assumed. Of faster recordings, about 10 frames per second are used, or
    `rate_hz`. `trajectory` is a KITTI or TUM file with one pose a frame; `is_metric` says whether
    its unit is the metre. Other settings are `SequenceDataset`'s.
    """

    is_upright = True

    path: Path
    intrinsics: tuple[float, float, float, float]
    frame_rate_hz: float | None = None
    times: Path | None = None
    trajectory: Path | None = None
    is_metric: bool = True
    name_pattern: str | None = None  # such as "frame*.png", if a folder holds masks, too
    rate_hz: Rate = field(default=DEFAULT_RATE_HZ, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", Path(self.path))  # scripts give text
        rate_hz = self.frame_rate_hz
        if rate_hz is not None and not 0.02 <= rate_hz < np.inf:
            raise BadData(f"frame_rate_hz is {rate_hz}, expected a number of at least 0.02")
        if rate_hz is not None and self.times is not None:
            raise BadData("both frame_rate_hz and times are given: keep one of them")
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

    def folders(self) -> dict[str, Path]:
        """Return the folders of images by name: the path, or those in it if it has no images."""
        if self.path.is_file():
            return {self.name: self.path}
        expected = "a folder of images (png, jpg, webp, bmp, tif, ppm, jp2)"
        return sequence_folders(
            self.path,
            lambda path: not path.is_file() and bool(image_files(path)),
            expected,
        )

    def scans(self, folder: Path, findings: Findings) -> dict[str, Scan]:
        """Scan a folder of images or a video, which has neither calibration nor poses."""
        if folder.is_file():
            scan = Scan((), np.empty(0))
            with findings.catch(folder):
                frames = VideoFrames(folder)
                scan = scan_of_video(frames)
                if frames.times_s is None:
                    message = f"does not state its rate: {DEFAULT_RATE_HZ:g} Hz are assumed here"
                    findings.add(folder, message, severity="warning")
            return {"": scan}
        images: tuple[Path, ...] = ()
        with findings.catch(folder):
            images = tuple(image_series(folder))
        return {"": Scan(images, np.arange(len(images)) / DEFAULT_RATE_HZ, is_upright=True)}

    @property
    def _is_root(self) -> bool:
        return self.path not in self._folders.values()

    def _read(self, name: str, folder: Path) -> Recording:
        reader: FrameReader
        rate_hz = self.frame_rate_hz or DEFAULT_RATE_HZ
        times_s: FloatArray
        if folder.is_file():
            reader = VideoFrames(folder)
            size_px = reader.size_px
            if self.times is None:
                times_s = reader.times_at(self.frame_rate_hz)
        else:
            images = tuple(image_series(folder, self.name_pattern))
            size_px = self._load(images[0]).shape[1::-1]
            reader = FrameFiles(images, (size_px,) * len(images), self._load)
            times_s = np.arange(len(images)) / rate_hz
        camera = Intrinsics(*self.intrinsics, *size_px)
        folder = folder if self._is_root else Path()
        if self.times is not None:
            times_s = pose_files.read_times(folder / self.times)
        trajectory = None
        if self.trajectory is not None:
            trajectory = pose_files.read_trajectory(
                folder / self.trajectory, times_s, is_metric=self.is_metric
            )
            if self.frame_rate_hz is None and self.times is None:
                times_s = trajectory.times_s
            elif len(trajectory) == len(times_s):
                trajectory = replace(trajectory, times_s=times_s)
        return Recording(name, reader, times_s, camera, trajectory, self.camera_height_m)


def scan_of_video(frames: VideoFrames) -> Scan:
    """Return the scan of a video; a raw stream gets the default rate."""
    times_s = frames.times_s
    if times_s is None:
        times_s = np.arange(len(frames)) / DEFAULT_RATE_HZ
    names = tuple(frames.path / f"frame {number}" for number in range(len(frames)))
    return Scan(names, times_s, load=lambda name: frames.read(int(name.name.split()[1])))
