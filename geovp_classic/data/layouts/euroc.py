"""Clips of EuRoC MAV (Burri et al. 2016), or of anything in the ASL layout.

A sequence is a folder with `mav0/camK/{data.csv, sensor.yaml, data/*.png}` and, if poses are known,
data.csv in `mav0/state_groundtruth_estimate0` or `mav0/mocap0`: time in ns, position and quaternion
(w first) of world_from_body. T_BS of a camera's sensor.yaml is body_from_cam.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geovp_classic import files
from geovp_classic.data.findings import Findings
from geovp_classic.data.formats import calibration_files, pose_files
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.data.recordings.scans import Scan, nearest_poses, read_list
from geovp_classic.data.recordings.sequences import PosedSequences
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Euroc(PosedSequences):
    """EuRoC and other folders in the ASL layout; settings as `PosedSequences`'.

    `camera` is the K of camK. An image has the pose whose time is nearest, at most
    `max_difference_s` away. Times are those of the files, in seconds. TUM VI's images use 16
    bits: `image_bits = 16`.
    """

    name = "euroc"
    patterns = ("mav0/cam*/data.csv",)

    camera: int = 0
    max_difference_s: float = 0.005  # half the period of poses, which come at 100 to 200 Hz

    def scan(self, folder: Path, findings: Findings) -> Scan:
        """Scan a sequence with one of its cameras."""
        mav0 = folder / "mav0"
        cam = mav0 / f"cam{self.camera}"
        if not cam.is_dir():
            present = ", ".join(sorted(path.name for path in mav0.glob("cam?")))
            findings.add(cam, f"does not exist: mav0 has {present}")
        stamps_ns, images = read_list(cam / "data.csv", cam / "data", findings, "ns")
        times_s = stamps_ns / 1e9
        sensor = cam / "sensor.yaml"
        scan = Scan(images, times_s)
        with findings.catch(sensor):
            scan = scan.mounted(*read_sensor(sensor))
        truth = mav0 / "state_groundtruth_estimate0" / "data.csv"
        if not truth.exists():
            truth = mav0 / "mocap0" / "data.csv"
        if truth.exists():
            recorded = pose_files.read_asl(truth, findings)
            poses = nearest_poses(times_s, *recorded, self.max_difference_s)
            scan = replace(scan, world_from_cam=poses @ scan.rig_from_cam)
        return scan


def read_sensor(path: Path) -> tuple[DistortedCamera, FloatArray]:
    """Read the camera of a sensor.yaml, and its body_from_cam [4, 4]."""
    text = files.read_text(path, files.MIB)
    expected = "expected intrinsics, resolution, and T_BS of 16 numbers that is a rigid motion"
    with files.checked(f"{path} is not a calibration", expected):
        table = calibration_files.load_yaml(text)
        lens = calibration_files.camera_of_yaml(table)
        numbers = calibration_files.matrix_data(table["T_BS"])
        body_from_cam = np.reshape(numbers, (4, 4)).astype(np.float64)
        return lens, se3.orthonormalised(body_from_cam, pose_files.ROTATION_TOLERANCE)
