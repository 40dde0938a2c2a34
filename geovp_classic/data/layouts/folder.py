"""Clips of a folder of images, of several below one root, or of a video, with a camera that the
user gives.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geovp_classic.data.findings import Findings
from geovp_classic.data.formats import pose_files
from geovp_classic.data.frames.image_names import frame_numbers, image_files, image_series
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.data.frames.video_frames import VideoFrames
from geovp_classic.data.recordings.scans import Scan, per_frame, sequence_folders
from geovp_classic.data.recordings.sequences import SequenceDataset
from geovp_classic.data.recordings.windows import Rate
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray, Intrinsics

JSON_ADVICE = (
    "is not read: of the transforms.json of NeRF and nerfstudio, give the COLMAP model, or its "
    "images and their poses in KITTI's format (docs/guide/colmap.md)"
)
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
    intrinsics: tuple[float, float, float, float] | None = None  # the doctor needs none
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
        super().__post_init__()

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
        if self.path.suffix == ".json":
            raise BadData(f"{self.path} {JSON_ADVICE}")
        if self.path.is_file():
            return {self.name: self.path}
        expected = "a folder of images (png, jpg, webp, bmp, tif, ppm, jp2)"
        return sequence_folders(
            self.path,
            lambda path: not path.is_file() and bool(image_files(path)),
            expected,
        )

    def scan(self, folder: Path, findings: Findings) -> Scan:
        """Scan a folder of images or a video; without `intrinsics`, it has no camera."""
        reader = poses = None
        if not folder.is_file():
            images = tuple(image_series(folder, self.name_pattern))
        elif self.name_pattern or self.image_bits:
            raise BadData(f"{folder} is a video: leave out name_pattern and image_bits")
        else:
            reader = VideoFrames(folder)
            images = reader.names
        times_s = self._times(folder, images, reader, findings)
        if self.trajectory is not None:
            path = self._file(folder, self.trajectory)
            trajectory = pose_files.read_trajectory(path, times_s)
            poses = trajectory.world_from_cam
            if self.frame_rate_hz is None and self.times is None:
                times_s = trajectory.times_s
        cameras: tuple[DistortedCamera, ...] = ()
        if self.intrinsics is not None:
            size_px = reader.size_px if reader else self._load(images[0]).shape[1::-1]
            cameras = (DistortedCamera(Intrinsics(*self.intrinsics, *size_px)),) * len(images)
        return Scan(images, times_s, cameras, poses, is_metric=self.is_metric, reader=reader)

    def _times(
        self, folder: Path, images: tuple[Path, ...], reader: VideoFrames | None, findings: Findings
    ) -> FloatArray:
        """Return the times [N] of a file, of the video, or at a rate."""
        rate_hz = self.frame_rate_hz
        if self.times is not None:
            path = self._file(folder, self.times)
            return per_frame(pose_files.read_times, path, images, findings)
        if reader is None:
            return frame_numbers(images) / (rate_hz or DEFAULT_RATE_HZ)
        if reader.times_s is None and rate_hz is None and self.intrinsics is None:  # the doctor's
            rate_hz = DEFAULT_RATE_HZ
            message = f"does not state its rate: {rate_hz:g} Hz are assumed here"
            findings.add(folder, message, severity="warning")
        return reader.times_at(rate_hz)

    def _file(self, recording: Path, name: Path) -> Path:
        """Return a file beside the frames, or, of a single recording, one elsewhere."""
        folder = recording.parent if recording.is_file() else recording
        path = folder / name
        if not path.exists() and not self._is_root and Path(name).exists():
            return Path(name)
        return path

    @property
    def _is_root(self) -> bool:
        return self.path not in self._folders.values()
