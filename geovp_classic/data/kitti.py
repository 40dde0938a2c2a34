"""Clips of KITTI odometry, or of anything laid out like it (Geiger et al. 2012).

A root holds `sequences/NN/{image_K/000000.png, calib.txt, times.txt}` and `poses/NN.txt`; any image
type, any name NN. P_k of calib.txt is K_k [I | t] with cam_k_from_cam0 = (I, t): all cameras are
rectified to look the same way, and poses are camera 0's, so world_from_camk = world_from_cam0 @
cam0_from_camk.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from geovp_classic.data import pose_files, splits
from geovp_classic.data.findings import Findings
from geovp_classic.data.frames import Load, scan_numbered
from geovp_classic.data.scan import Scan, first_size
from geovp_classic.data.sequences import PosedSequences
from geovp_classic.data.undistortion import DistortedCamera
from geovp_classic.data.windows import FrameRange, Recording, SideCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics

PREFERRED_CAMERAS = (2, 0, 1, 3)  # left colour, left grey, then the others
RIGHT_OF = {0: 1, 2: 3}
Projection = tuple[tuple[float, float, float, float], FloatArray]


@dataclass(frozen=True)
class Kitti(PosedSequences):
    """KITTI odometry; one clip every `stride` frames of each range.

    Either `split` (a name, or a .toml file) or `sequences` ("06", "03[180:360)") says which frames;
    with neither, all sequences are used. Without `camera`, each sequence shows image_2 if it has
    it, else image_0, else what it has. Poses are those of the camera shown, or None for a sequence
    without a pose file. `with_right` adds the frames of the right camera where there is one. Other
    settings are `SequenceDataset`'s.
    """

    name: ClassVar[str] = "kitti"  # in results
    prefix: ClassVar[str] = "image_"  # of the folders of images

    split: str | None = None
    camera: int | None = None
    camera_height_m: float = field(default=1.65, kw_only=True)
    with_right: bool = False

    def __post_init__(self) -> None:
        if self.split is not None and self.sequences is not None:
            raise BadData(
                f"both split {self.split!r} and sequences {list(self.sequences)} are given: "
                "keep one of them"
            )
        super().__post_init__()

    @cached_property
    def _wanted(self) -> tuple[FrameRange, ...]:
        return (
            super()._wanted if self.split is None else splits.load(self.split)
        )

    @staticmethod
    def folders(root: Path) -> dict[str, Path]:
        """Return the sequences of a root by name; BadData if it is not KITTI odometry."""
        if not (root / "sequences").is_dir():
            raise BadData(
                f"{root} holds no folder 'sequences': give KITTI odometry's 'dataset'"
            )
        paths = sorted((root / "sequences").iterdir())
        return {
            path.name: path
            for path in paths
            if path.is_dir() and path.name[0] != "."
        }

    @staticmethod
    def scan(folder: Path, camera: int) -> Scan:
        """Scan a sequence with one of its cameras.

        `folder` is root/sequences/NN; the poses are root/poses/NN.txt, if there are any.
        """
        findings = Findings()
        images = scan_numbered(folder / f"image_{camera}", findings)
        projection = scan_projection(
            folder / "calib.txt", f"P{camera}", findings
        )
        times = folder / "times.txt"
        times_s = pose_files.scan_times(times, findings)
        times_s = one_per_frame(times, times_s, len(images), findings)
        poses = folder.parents[1] / "poses" / f"{folder.name}.txt"
        world_from_cam0 = None
        if poses.exists():
            world_from_cam0 = _scan_poses(poses, len(images), findings)
        return rectified(images, times_s, projection, world_from_cam0, findings)

    @classmethod
    def scans(cls, folder: Path) -> dict[str, Scan]:
        """Scan a sequence with each of its cameras."""
        return {
            f"image_{camera}": cls.scan(folder, camera)
            for camera in cls._cameras(folder)
        }

    @classmethod
    def _cameras(cls, folder: Path) -> list[int]:
        """Return the cameras of a sequence that have a folder, the preferred one first."""
        cameras = PREFERRED_CAMERAS
        present = [
            camera
            for camera in cameras
            if (folder / f"{cls.prefix}{camera}").is_dir()
        ]
        return present or [cameras[0]]

    def _camera(self, folder: Path) -> int:
        """Return the camera that a sequence shows."""
        cameras = self._cameras(folder)
        camera = cameras[0] if self.camera is None else self.camera
        if camera not in cameras:
            present = ", ".join(f"{self.prefix}{number}" for number in cameras)
            raise BadData(
                f"{folder} has no {self.prefix}{camera}: it has {present}"
            )
        return camera

    def _scan(self, folder: Path) -> Scan:
        return self.scan(folder, self._camera(folder))

    def _read(self, name: str, load: Load) -> Recording:
        recording = super()._read(name, load)
        folder = self._folder(name)
        right_camera = RIGHT_OF.get(self._camera(folder))
        if not self.with_right or right_camera not in self._cameras(folder):
            return recording
        right = self.scan(folder, right_camera)
        side = right.recording(name, folder, load, self.camera_height_m)
        right_from_left = right.cam_from_rig @ se3.inverse(
            self._scan(folder).cam_from_rig
        )
        return replace(
            recording,
            right=SideCamera(side.frames, side.intrinsics, right_from_left),
        )


def one_per_frame(
    path: Path, rows: FloatArray, num_frames: int, findings: Findings
) -> FloatArray:
    """Return the rows [N, ...] of a file, which should be one for each of N frames.

    If there are fewer or more, the difference is reported and all rows are NaN.
    """
    if len(rows) == num_frames:
        return rows
    if len(rows):
        findings.error(
            path, f"{len(rows)} rows for {num_frames} frames, expected one each"
        )
    return np.full((num_frames, *rows.shape[1:]), np.nan)


def _scan_poses(path: Path, num_frames: int, findings: Findings) -> FloatArray:
    """Scan world_from_cam0 [N, 4, 4], one pose per frame."""
    indices, world_from_cam0 = pose_files.scan_kitti(path, findings)
    if indices is not None:
        missing = np.setdiff1d(np.arange(num_frames), indices)
        if len(missing):
            findings.error(
                path,
                f"expected a pose of every frame, frames {missing} have none",
            )
    return one_per_frame(path, world_from_cam0, num_frames, findings)


def scan_entry(
    path: Path, name: str, count: int, findings: Findings
) -> FloatArray | None:
    """Scan the numbers of the line `name: ...` of a calibration file.

    Return None with a finding if the line is missing or holds anything else.
    """
    for line, text in pose_files.read_lines(path, findings):
        key, _, numbers = text.partition(":")
        if key == name:
            return pose_files.parse_numbers(
                path, line, numbers.split(), (count,), findings
            )
    findings.error(path, f"has no line '{name}:'")
    return None


def scan_projection(
    path: Path, name: str, findings: Findings
) -> Projection | None:
    """Scan the projection K [I | t] of a camera.

    Return fx, fy, cx, cy in pixels, and cam_from_cam0 [4, 4]; None with a finding if it is not the
    projection of a rectified camera.
    """
    numbers = scan_entry(path, name, 12, findings)
    if numbers is None:
        return None
    projection = numbers.reshape(3, 4)
    (fx, _, cx, _), (_, fy, cy, _), _ = projection.tolist()
    camera_matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if min(fx, fy) <= 0 or not np.allclose(projection[:, :3], camera_matrix):
        message = "expected positive focal lengths, zeros beside them, and 0 0 1 below"
        findings.error(
            path, f"{name} is not K [I | t] of a rectified camera: {message}"
        )
        return None
    translation = np.linalg.solve(camera_matrix, projection[:, 3])
    return (fx, fy, cx, cy), se3.compose(np.eye(3), translation)


def rectified(
    images: tuple[Path, ...],  # N
    times_s: FloatArray,  # [N]
    projection: Projection | None,
    world_from_cam0: FloatArray | None,  # [N, 4, 4]
    findings: Findings,
) -> Scan:
    """Return the scan of a rectified camera from its projection and the poses of camera 0."""
    size_px = first_size(images, findings)
    if projection is None or size_px is None:
        return Scan(images, times_s, (), findings)
    numbers, cam_from_cam0 = projection
    lens = DistortedCamera(Intrinsics(*numbers, *size_px))
    world_from_cam = None
    if world_from_cam0 is not None:
        world_from_cam = world_from_cam0 @ se3.inverse(cam_from_cam0)
    cameras = (lens,) * len(images)
    return Scan(
        images,
        times_s,
        cameras,
        findings,
        world_from_cam,
        cam_from_rig=cam_from_cam0,
    )
