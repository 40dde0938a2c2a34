"""Clips of EuRoC MAV (Burri et al. 2016), or of anything in the ASL layout.

A sequence is a folder with `mav0/camK/{data.csv, sensor.yaml, data/*.png}` and, if poses are known,
data.csv in `mav0/state_groundtruth_estimate0` or `mav0/mocap0`: time in ns, position and quaternion
(w first) of world_from_body. T_BS of a camera's sensor.yaml is body_from_cam.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from geovp_classic.data import calibration_files, pose_files, posed_sequences
from geovp_classic.data.findings import error
from geovp_classic.data.posed_sequences import PosedSequences, Scanned, matched, scan_list
from geovp_classic.data.undistortion import DistortedCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics

POSES = ("state_groundtruth_estimate0", "mocap0")
MAX_DIFFERENCE_S = 0.005  # poses come at 100 to 200 Hz
MODELS = dict.fromkeys(("radial-tangential", "radtan", "plumb_bob"), "OPENCV") | {
    "equidistant": "OPENCV_FISHEYE"
}


@dataclass(frozen=True)
class Euroc(PosedSequences):
    """EuRoC and other folders in the ASL layout; settings as `PosedSequences`'.

    `camera` is the K of camK. An image has the pose whose time is nearest, at most
    `max_difference_s` away. Times are seconds since the first image. TUM VI's images use 16 bits:
    `image_bits = 16`.
    """

    name: ClassVar[str] = "euroc"

    camera: int = 0
    max_difference_s: float = MAX_DIFFERENCE_S

    def _folders(self) -> dict[str, Path]:
        return folders(self.root)

    def _scan(self, folder: Path) -> Scanned:
        return scan(folder, self.camera, self.max_difference_s)


def folders(root: Path) -> dict[str, Path]:
    """The sequences of a root by name."""
    return posed_sequences.folders(
        root, lambda path: any(path.glob("mav0/cam*/data.csv")), "a folder with mav0/cam0"
    )


def scan(folder: Path, camera: int = 0, max_difference_s: float = MAX_DIFFERENCE_S) -> Scanned:
    """A sequence as its files describe it, seen by one camera."""
    cam = folder / "mav0" / f"cam{camera}"
    if not cam.is_dir():
        there = ", ".join(sorted(path.name for path in cam.parent.glob("cam?")))
        return Scanned(
            (), np.zeros(0), (), (error(cam, None, f"does not exist: mav0 has {there}"),)
        )
    stamps_ns, images, findings = scan_list(cam / "data.csv", cam / "data", ",")
    start_ns = float(stamps_ns[0]) if images else 0.0
    times_s = (stamps_ns - start_ns) / 1e9
    try:
        lens, body_from_cam = read_sensor(cam / "sensor.yaml")
    except BadData as problem:
        found = error(
            cam / "sensor.yaml", None, str(problem).removeprefix(f"{cam / 'sensor.yaml'} ")
        )
        return Scanned(images, times_s, (), (*findings, found))
    poses = None
    for path in (folder / "mav0" / name / "data.csv" for name in POSES):
        if poses is None and path.exists():
            table, found_poses = pose_files.scan_asl(path, start_ns)
            findings += found_poses
            keys = np.zeros(0) if table.keys is None else table.keys
            poses = matched(times_s, keys, table.world_from_cam @ body_from_cam, max_difference_s)
    return Scanned(images, times_s, (lens,) * len(images), tuple(findings), poses)


def read_sensor(path: Path) -> tuple[DistortedCamera, FloatArray]:
    """The camera of a sensor.yaml, and its body_from_cam [4, 4]; BadData says what it lacks."""
    content = calibration_files.load_yaml(path)
    calibration = calibration_files.from_yaml(path, content)
    model = MODELS.get(str(content.get("distortion_model")))
    if model is None:
        raise BadData(
            f"{path} has the distortion_model {content.get('distortion_model')!r}: expected "
            f"{list(MODELS)}"
        )
    if calibration.size_px is None or len(calibration.distortion) != 4:
        raise BadData(
            f"{path} needs resolution: [width, height] and 4 distortion_coefficients: complete it"
        )
    Intrinsics(*calibration.numbers, *calibration.size_px)
    try:
        numbers = np.array(calibration_files.data_of(content["T_BS"]), np.float64)
        body_from_cam = se3.orthonormalised(numbers.reshape(4, 4), pose_files.ROTATION_TOLERANCE)
    except (KeyError, TypeError, ValueError, BadData) as problem:
        raise BadData(
            f"{path} has no T_BS of 16 numbers that is a rigid motion ({problem}): complete it"
        ) from problem
    return DistortedCamera.of(
        model, calibration.numbers, calibration.distortion, calibration.size_px
    ), body_from_cam
