"""Clips of a folder of images, of several below one root, or of a video, with a camera that the
user gives.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from geovp_classic.data import pose_files
from geovp_classic.data.frames import FrameFiles, FrameReader, VideoFrames, image_files, read_image
from geovp_classic.data.sequences import Load, SequenceDataset
from geovp_classic.data.windows import FrameRange, Recording
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Trajectory

LEAST_RATE_HZ = 0.02  # a frame in 50 s
FOLDER_RATE_HZ = 10.0  # as KITTI; images don't say when they were taken


@dataclass(frozen=True)
class Folder(SequenceDataset):
    """The images of a folder in the order of their names (2 before 10), or the frames of a video.

    A folder without images of its own is a root: each folder of images in it is a sequence,
    `sequences` names some of them ("city", "city[100:400)"), and `times` and `trajectory` are files
    in each.

    `intrinsics` are (fx, fy, cx, cy) in pixels of the images as they are stored, (0, 0) the
    top-left one's centre. Times come from the file `times` (one number a line) or from
    `frame_rate_hz`; with neither, from a TUM trajectory if there is one, else from the video's own
    rate, else 10 Hz is taken. `trajectory` is a KITTI or TUM file with one pose a frame;
    `is_metric` says whether its unit is the metre. `frames` limits the clips of one sequence to
    [first, last). `image_bits` says how many bits of 16-bit images are used.
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
    with_full: bool = False
    sequences: tuple[str, ...] | None = None
    image_bits: int | None = None

    def __post_init__(self) -> None:
        for name in ("path", "times", "trajectory"):  # scripts give text
            given = getattr(self, name)
            object.__setattr__(self, name, None if given is None else Path(given))
        if self.frame_rate_hz is not None and not LEAST_RATE_HZ <= self.frame_rate_hz < np.inf:
            raise BadData(
                f"frame_rate_hz is {self.frame_rate_hz}, expected a number of at least "
                f"{LEAST_RATE_HZ}"
            )
        if self.frame_rate_hz is not None and self.times is not None:
            raise BadData("both frame_rate_hz and times are given: keep one of them")
        self._check()

    @property
    def name(self) -> str:
        """The data set's name in results: that of the folder or the video."""
        path = self.path.resolve()
        return path.name if path.is_dir() else path.stem

    @property
    def split_hash(self) -> str:
        """The hash of `ranges` of several sequences; "" for one, which the settings determine."""
        return super().split_hash if self._is_root else ""

    @property
    def recording(self) -> Recording:
        """All frames of the first sequence with their times, camera and poses."""
        return next(iter(self.recordings.values()))

    @cached_property
    def _wanted(self) -> tuple[FrameRange, ...]:
        if self.frames is None:
            return super()._wanted
        first, last = self.frames
        if not 0 <= first < last:
            raise BadData(
                f"frames is [{first}, {last}], expected first < last, both from 0, the last one "
                "exclusive"
            )
        if self._is_root or self.sequences is not None:
            raise BadData(
                f'frames is of one sequence: give sequences = ["NAME[{first}:{last})"] in its place'
            )
        return (FrameRange(self.name, first, last),)

    @cached_property
    def _paths(self) -> dict[str, Path]:
        if not self.path.exists():
            raise BadData(f"{self.path} does not exist: give a folder of images or a video file")
        found = {self.name: self.path} if self.path.is_file() else paths_below(self.path)
        if not found:
            raise BadData(
                f"{self.path} holds no images (png, jpg, webp, bmp, tif, ppm, jp2), nor do its "
                "folders"
            )
        return found

    @property
    def _is_root(self) -> bool:
        return self.path not in self._paths.values()

    def _names(self) -> list[str]:
        return list(self._paths)

    def _load(self, path: Path) -> ByteArray:
        return read_image(path, self.image_bits)

    def _read(self, name: str, load: Load) -> Recording:
        if name not in self._paths:
            raise BadData(
                f"sequence {name!r} is not in {self.path}, which holds {', '.join(self._paths)}"
            )
        reader, size_px, rate_hz = _open(self._paths[name], load)
        trajectory, times_s = self._timed(self._paths[name], len(reader), rate_hz)
        return Recording(
            name, reader, times_s, self._camera(size_px), trajectory, self.camera_height_m
        )

    def _camera(self, size_px: tuple[int, int]) -> Intrinsics:
        camera = Intrinsics(*self.intrinsics, *size_px)
        if not (0 <= camera.cx_px < size_px[0] and 0 <= camera.cy_px < size_px[1]):
            raise BadData(
                f"intrinsics {list(self.intrinsics)} put the principal point outside the images of "
                f"{size_px[0]}x{size_px[1]}: give (fx, fy, cx, cy) in pixels of the images as "
                "they are stored"
            )
        return camera

    def _timed(
        self, path: Path, num_frames: int, rate_hz: float | None
    ) -> tuple[Trajectory | None, FloatArray]:
        """The trajectory, if there is one, and the times of all frames of a sequence."""
        own = path if self._is_root else Path()
        times, poses = (
            None if file is None else own / file for file in (self.times, self.trajectory)
        )
        times_s = None if times is None else pose_files.read_times(times)
        if times_s is not None and len(times_s) != num_frames:
            raise BadData(
                f"{times}: {len(times_s)} times for {num_frames} frames, expected one each"
            )
        has_own_times = poses is not None and pose_files.has_times(poses)
        if times_s is None and (self.frame_rate_hz is not None or not has_own_times):
            rate_hz = self.frame_rate_hz or rate_hz
            if rate_hz is None:
                raise BadData(
                    f"{path} does not say how many frames a second it has: give frame_rate_hz"
                )
            times_s = np.arange(num_frames) / rate_hz
        if poses is None:
            assert times_s is not None
            return None, times_s
        trajectory = pose_files.read_trajectory(poses, times_s, is_metric=self.is_metric)
        if len(trajectory) != num_frames:
            raise BadData(
                f"{poses}: {len(trajectory)} poses for {num_frames} frames, expected one each"
            )
        if times_s is not None:
            trajectory = Trajectory(trajectory.world_from_cam, times_s, self.is_metric)
        return trajectory, trajectory.times_s


def paths_below(root: Path) -> dict[str, Path]:
    """The folders of images by name: the root, or where it holds none itself, those in it."""
    if image_files(root):
        return {root.resolve().name: root}
    inside = sorted(
        path for path in root.iterdir() if path.is_dir() and not path.name.startswith(".")
    )
    return {path.name: path for path in inside if image_files(path)}


def _open(path: Path, load: Load) -> tuple[FrameReader, tuple[int, int], float | None]:
    """The frames of a sequence, their size, and their rate in Hz where it is known."""
    if path.is_file():
        video = VideoFrames.open(path)
        return video, video.size_px, video.rate_hz
    paths = tuple(image_files(path))
    height_px, width_px = load(paths[0]).shape[:2]
    return FrameFiles(paths, (width_px, height_px), load), (width_px, height_px), FOLDER_RATE_HZ
