"""Clips of EuRoC MAV (Burri et al. 2016), or of anything in the ASL layout.

A sequence is a folder with `mav0/camK/{data.csv, sensor.yaml, data/*.png}` and, if poses are known,
data.csv in `mav0/state_groundtruth_estimate0` or `mav0/mocap0`: time in ns, position and quaternion
(w first) of world_from_body. T_BS of a camera's sensor.yaml is body_from_cam.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from geovp_classic.data import calibration_files, pose_files
from geovp_classic.data.findings import Findings
from geovp_classic.data.scan import Scan, matched, scan_list, sequence_folders
from geovp_classic.data.sequences import PosedSequences
from geovp_classic.data.undistortion import DistortedCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class Euroc(PosedSequences):
    """EuRoC and other folders in the ASL layout; settings as `PosedSequences`'.

    `camera` is the K of camK. An image has the pose whose time is nearest, at most
    `max_difference_s` away. Times are seconds since the first image. TUM VI's images use 16 bits:
    `image_bits = 16`.
    """

    name: ClassVar[str] = "euroc"

    camera: int = 0
    max_difference_s: float = 0.005  # poses come at 100 to 200 Hz

    @staticmethod
    def folders(root: Path) -> dict[str, Path]:
        """Return the sequences of a root by name."""
        return sequence_folders(
            root,
            lambda path: any(path.glob("mav0/cam*/data.csv")),
            "a folder with mav0/cam0",
        )

    @staticmethod
    def scan(
        folder: Path,
        camera: int = 0,
        max_difference_s: float = max_difference_s,
    ) -> Scan:
        """Scan a sequence with one of its cameras."""
        findings = Findings()
        cam = folder / "mav0" / f"cam{camera}"
        if not cam.is_dir():
            present = ", ".join(
                sorted(path.name for path in cam.parent.glob("cam?"))
            )
            findings.error(cam, f"does not exist: mav0 has {present}")
            return Scan((), np.zeros(0), (), findings)
        stamps_ns, images = scan_list(
            cam / "data.csv", cam / "data", findings, ","
        )
        start_ns = stamps_ns[0] if images else 0.0
        times_s = (stamps_ns - start_ns) / 1e9
        try:
            lens, body_from_cam = read_sensor(cam / "sensor.yaml")
        except BadData as problem:
            findings.add(cam / "sensor.yaml", problem)
            return Scan(images, times_s, (), findings)
        poses = None
        for name in ("state_groundtruth_estimate0", "mocap0"):
            path = folder / "mav0" / name / "data.csv"
            if poses is None and path.exists():
                pose_times_s, world_from_body = pose_files.scan_asl(
                    path, start_ns, findings
                )
                poses = matched(
                    times_s, pose_times_s, world_from_body, max_difference_s
                )
                poses = poses @ body_from_cam
        return Scan(images, times_s, (lens,) * len(images), findings, poses)

    def _scan(self, folder: Path) -> Scan:
        return self.scan(folder, self.camera, self.max_difference_s)


def read_sensor(path: Path) -> tuple[DistortedCamera, FloatArray]:
    """Read the camera of a sensor.yaml, and its body_from_cam [4, 4]."""
    table = calibration_files.load_yaml(path)
    calibration = calibration_files.from_yaml(path, table)
    if calibration.size_px is None:
        raise BadData(f"{path} lacks resolution: [width, height]: complete it")
    view = Intrinsics(*calibration.numbers, *calibration.size_px)
    lens = calibration.lens(view) or DistortedCamera(view)
    try:
        numbers = np.array(
            calibration_files.matrix_data(table["T_BS"]), np.float64
        )
        transform = numbers.reshape(4, 4)
        body_from_cam = se3.orthonormalised(
            transform, pose_files.ROTATION_TOLERANCE
        )
    except (KeyError, TypeError, ValueError, BadData) as problem:
        raise BadData(
            f"{path} has no T_BS of 16 numbers that is a rigid motion ({problem}): complete it"
        ) from problem
    return lens, body_from_cam
