"""Sequences whose images, poses and depths are matched by time or name, and whose cameras have lens
distortion.

`Scanned` is a sequence as its files describe it, with findings about them: a data set raises the
first error, the doctor lists all. Frames without a pose are left out where others have one, and no
clip spans them.
"""

import itertools
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_classic.data import pose_files
from geovp_classic.data.findings import Finding, error, raise_first
from geovp_classic.data.frames import read_image
from geovp_classic.data.sequences import Load, SequenceDataset
from geovp_classic.data.undistortion import (
    DistortedCamera,
    UndistortedDepths,
    UndistortedFrames,
    common_pinhole,
)
from geovp_classic.data.windows import Fit, Recording
from geovp_classic.errors import BadData
from geovp_classic.files import is_file, leads_inside
from geovp_classic.types import ByteArray, FloatArray, IntArray, Trajectory


@dataclass(frozen=True)
class Scanned:
    """A sequence of N images."""

    images: tuple[Path, ...]  # N
    times_s: FloatArray  # [N], increasing
    cameras: tuple[DistortedCamera, ...]  # N; empty where the calibration is not known
    findings: tuple[Finding, ...]
    world_from_cam: FloatArray | None = (
        None  # [N, 4, 4], NaN for an image without a pose; None where none is recorded
    )
    depths: tuple[Path | None, ...] | None = None  # N
    values_per_m: float = 1.0  # of the depth images
    is_metric: bool = True
    starts: frozenset[int] = frozenset()  # images that do not follow the one before

    @property
    def posed(self) -> IntArray:
        """The numbers of the images that serve: those with a pose, or all where no pose is
        recorded.
        """
        if self.world_from_cam is None:
            return np.arange(len(self.images))
        return np.flatnonzero(np.isfinite(self.world_from_cam).all(axis=(1, 2)))

    @property
    def breaks(self) -> tuple[int, ...]:
        """Places among `posed` that do not follow the one before."""
        numbers = self.posed.tolist()
        follows = (b == a + 1 and b not in self.starts for a, b in itertools.pairwise(numbers))
        return tuple(at for at, whole in enumerate(follows, 1) if not whole)

    def recording(
        self, name: str, source: Path, load: Load, camera_height_m: float | None
    ) -> Recording:
        """The sequence for clips; BadData for the first error among the findings."""
        raise_first(self.findings)
        numbers, trajectory = self.posed, None
        if not len(numbers):
            raise BadData(
                f"{source}: none of {len(self.images)} images has a pose: give images and poses "
                "that match"
            )
        times_s = self.times_s[numbers]
        if self.world_from_cam is not None:
            trajectory = Trajectory(self.world_from_cam[numbers], times_s, self.is_metric)
        cameras = tuple(self.cameras[i] for i in numbers)
        view = common_pinhole(cameras, source)
        frames, depths = (
            UndistortedFrames(tuple(self.images[i] for i in numbers), cameras, view, load),
            None,
        )
        if self.depths is not None:
            depths = UndistortedDepths(
                tuple(self.depths[i] for i in numbers), cameras, view, self.values_per_m
            )
        return Recording(
            name,
            frames,
            times_s,
            view,
            trajectory,
            camera_height_m,
            depths=depths,
            breaks=self.breaks,
        )


@dataclass(frozen=True)
class PosedSequences(SequenceDataset):
    """Sequences below one root, or a root that is one itself; one clip every `stride` frames of
    each.

    `sequences` names them ("office", "office[100:400)"; frames are counted among those with a
    pose). Frames are undistorted, then cropped to their central square at `size_px`, or with `fit =
    "stretch"` resized whole. `image_bits` says how many bits of 16-bit images are used. Everything
    but the images is checked on construction.
    """

    root: Path
    sequences: tuple[str, ...] | None = None
    num_frames: int = 30
    stride: int = 10
    size_px: tuple[int, int] = (256, 256)
    fit: Fit = "crop"
    camera_height_m: float | None = None
    image_bits: int | None = None
    with_full: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "root", Path(self.root))  # scripts give text
        self._check()

    @abstractmethod
    def _folders(self) -> dict[str, Path]:
        """The sequences of the root by name."""

    @abstractmethod
    def _scan(self, folder: Path) -> Scanned:
        """One of them."""

    def _names(self) -> list[str]:
        return list(self._folders())

    def _read(self, name: str, load: Load) -> Recording:
        found = self._folders()
        if name not in found:
            raise BadData(
                f"sequence {name!r} is not in {self.root}, which holds {', '.join(found)}: name "
                "one of these"
            )
        return self._scan(found[name]).recording(name, found[name], load, self.camera_height_m)

    def _load(self, path: Path) -> ByteArray:
        return read_image(path, self.image_bits)


def folders(root: Path, is_sequence: Callable[[Path], bool], expected: str) -> dict[str, Path]:
    """The sequences of a root by name: the root itself, else its sub-folders; BadData says what it
    must hold.
    """
    if not root.is_dir():
        raise BadData(f"{root} does not exist: give {expected}, or a folder of such folders")
    if is_sequence(root):
        return {root.resolve().name: root}
    found = {
        path.name: path for path in sorted(root.iterdir()) if path.is_dir() and is_sequence(path)
    }
    if not found:
        raise BadData(f"{root} holds no sequence: give {expected}, or a folder of such folders")
    return found


def nearest(
    times_s: FloatArray,  # [N]
    others_s: FloatArray,  # [M], increasing
    max_difference_s: float,
) -> IntArray:
    """For each time the number [N] of the nearest other one, -1 where none is within the
    difference.
    """
    if not len(others_s):
        return np.full(len(times_s), -1)
    closest = np.searchsorted(
        (others_s[1:] + others_s[:-1]) / 2, times_s
    )  # between two midpoints lies one time
    return np.where(np.abs(others_s[closest] - times_s) <= max_difference_s, closest, -1)


def matched(
    times_s: FloatArray,  # [N]
    others_s: FloatArray,  # [M], increasing
    world_from_cam: FloatArray,  # [M, 4, 4]
    max_difference_s: float,
) -> FloatArray:
    """The pose [N, 4, 4] nearest in time, NaN where none is within the difference."""
    found = nearest(times_s, others_s, max_difference_s)
    poses = world_from_cam[found] if len(world_from_cam) else np.full((len(times_s), 4, 4), np.nan)
    return np.where((found >= 0)[:, None, None], poses, np.nan)


def scan_list(
    path: Path, folder: Path, separator: str = " "
) -> tuple[FloatArray, tuple[Path, ...], list[Finding]]:
    """Times [N] and files of a list of images in a folder, and the errors of its bad lines and
    missing files.
    """
    lines, findings = pose_files.read_lines(path)
    times_s: list[float] = []
    files: list[Path] = []
    for number, text in lines:
        time, _, file = text.partition(separator)
        row = pose_files.parse_row(path, number, time)
        if isinstance(row, Finding):
            findings.append(row)
        elif not leads_inside(file.strip()):
            findings.append(
                error(
                    path, number, f"{file.strip()!r} leads out of the folder: give a path inside it"
                )
            )
        elif not is_file(folder / file.strip()):
            expected = f"expected 'time{separator}file': restore it or remove the line"
            message = f"there is no file {file.strip()[:200]!r}, {expected}"
            findings.append(error(path, number, message))
        elif times_s and row.numbers[0] <= times_s[-1]:
            findings.append(
                error(
                    path, number, f"time {row.numbers[0]!r} is not after {times_s[-1]!r} before it"
                )
            )
        else:
            times_s.append(row.numbers[0])
            files.append(folder / file.strip())
    if not lines and not findings:
        findings.append(error(path, None, "lists no images"))
    return np.array(times_s), tuple(files), findings
