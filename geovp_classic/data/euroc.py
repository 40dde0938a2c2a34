"""Clips of EuRoC MAV (Burri et al. 2016), or of anything in the ASL layout.

A sequence is a folder with `mav0/camK/{data.csv, sensor.yaml, data/*.png}` and, if poses are known, data.csv in
`mav0/state_groundtruth_estimate0` or `mav0/mocap0`: time in ns, position and quaternion (w first) of world_from_body.
T_BS of a camera's sensor.yaml is body_from_cam.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_classic.data import calibration_files, pose_files, posed_sequences
from geovp_classic.data.findings import Finding, error
from geovp_classic.data.pose_files import Row
from geovp_classic.data.posed_sequences import PosedSequences, Scanned, matched
from geovp_classic.data.undistortion import DistortedCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics

POSES = ("state_groundtruth_estimate0", "mocap0")
MAX_DIFFERENCE_S = 0.005  # poses come at 100 to 200 Hz
MODELS = dict.fromkeys(("radial-tangential", "radtan", "plumb_bob"), "OPENCV") | {"equidistant": "OPENCV_FISHEYE"}


@dataclass(frozen=True)
class Euroc(PosedSequences):
    """EuRoC and other folders in the ASL layout; settings as `PosedSequences`'.

    `camera` is the K of camK. An image has the pose whose time is nearest, at most `max_difference_s` away. Times are
    seconds since the first image. TUM VI's images use 16 bits: `image_bits = 16`.
    """

    camera: int = 0
    max_difference_s: float = MAX_DIFFERENCE_S

    @property
    def name(self) -> str:
        """The data set's name in results."""
        return "euroc"

    def _folders(self) -> dict[str, Path]:
        return folders(self.root)

    def _scan(self, folder: Path) -> Scanned:
        return scan(folder, self.camera, self.max_difference_s)


def folders(root: Path) -> dict[str, Path]:
    """The sequences of a root by name."""
    return posed_sequences.folders(root, lambda path: any(path.glob("mav0/cam*/data.csv")), "a folder with mav0/cam0")


def scan(folder: Path, camera: int = 0, max_difference_s: float = MAX_DIFFERENCE_S) -> Scanned:
    """A sequence as its files describe it, seen by one camera."""
    cam = folder / "mav0" / f"cam{camera}"
    if not cam.is_dir():
        there = ", ".join(sorted(path.name for path in cam.parent.glob("cam?")))
        return Scanned((), np.zeros(0), (), (error(cam, None, f"does not exist: mav0 has {there}"),))
    stamps_ns, images, findings = _scan_images(cam / "data.csv")
    start_ns = stamps_ns[0] if stamps_ns else 0
    times_s = np.array([(stamp - start_ns) / 1e9 for stamp in stamps_ns])
    try:
        lens, body_from_cam = read_sensor(cam / "sensor.yaml")
    except BadData as problem:
        found = error(cam / "sensor.yaml", None, str(problem).removeprefix(f"{cam / 'sensor.yaml'} "))
        return Scanned(images, times_s, (), (*findings, found))
    poses = None
    for path in (folder / "mav0" / name / "data.csv" for name in POSES):
        if poses is None and path.exists():
            table, found_poses = _scan_poses(path, start_ns)
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
        raise BadData(f"{path} has the distortion_model {content.get('distortion_model')!r}: expected {list(MODELS)}")
    if calibration.size_px is None or len(calibration.distortion) != 4:
        raise BadData(f"{path} needs resolution: [width, height] and 4 distortion_coefficients: complete it")
    Intrinsics(*calibration.numbers, *calibration.size_px)
    try:
        numbers = np.array(calibration_files.data_of(content["T_BS"]), np.float64)
        body_from_cam = se3.orthonormalised(numbers.reshape(4, 4), pose_files.ROTATION_TOLERANCE)
    except (KeyError, TypeError, ValueError, BadData) as problem:
        raise BadData(f"{path} has no T_BS of 16 numbers that is a rigid motion ({problem}): complete it") from problem
    return DistortedCamera.of(model, calibration.numbers, calibration.distortion, calibration.size_px), body_from_cam


def _scan_images(path: Path) -> tuple[list[int], tuple[Path, ...], list[Finding]]:
    """Time stamps in ns and files of a camera's data.csv, and the errors of its bad lines and missing files."""
    lines, findings = pose_files.read_lines(path)
    stamps: list[int] = []
    images: list[Path] = []
    for number, text in lines:
        stamp, _, file = (word.strip() for word in text.partition(","))
        image = path.parent / "data" / file
        if not stamp.isdecimal() or not file:
            findings.append(error(path, number, f"{text!r} is not 'time in ns,file': restore the line"))
        elif not image.is_file():
            findings.append(error(path, number, f"there is no file data/{file}: restore it or remove the line"))
        elif stamps and int(stamp) <= stamps[-1]:
            findings.append(error(path, number, f"time {stamp} is not after {stamps[-1]} before it"))
        else:
            stamps.append(int(stamp))
            images.append(image)
    if not lines and not findings:
        findings.append(error(path, None, "lists no images"))
    return stamps, tuple(images), findings


def _scan_poses(path: Path, start_ns: int) -> tuple[pose_files.PoseTable, list[Finding]]:
    """world_from_body with times in seconds after a start."""
    lines, findings = pose_files.read_lines(path)
    rows: list[Row] = []
    for number, text in lines:
        stamp, _, rest = text.partition(",")
        row = pose_files.parse_row(path, number, rest.replace(",", " "))
        if isinstance(row, Finding):
            findings.append(row)
        elif not stamp.strip().isdecimal() or len(row.numbers) < 7:
            findings.append(
                error(path, number, f"{text[:60]!r} is not 'time in ns, x, y, z, qw, qx, qy, qz': restore it")
            )
        elif rows and (int(stamp) - start_ns) / 1e9 <= rows[-1].numbers[0]:
            findings.append(error(path, number, f"time {stamp} is not after that of line {rows[-1].line}"))
        else:
            x, y, z, qw, qx, qy, qz = row.numbers[:7]
            rows.append(Row(number, ((int(stamp) - start_ns) / 1e9, x, y, z, qx, qy, qz, qw)))
    if not lines and not findings:
        findings.append(error(path, None, "holds no poses"))
    return pose_files.quaternion_table(path, rows, findings)
