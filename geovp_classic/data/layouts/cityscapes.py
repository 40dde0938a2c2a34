"""Clips of Cityscapes' video sequences (Cordts et al. 2016).

A root holds `TYPE/SPLIT/CITY/CITY_SEQ_FRAME_SUFFIX` with the types `leftImg8bit_sequence`, `camera`
(calibration) and perhaps `vehicle_sequence` (speed and yaw rate). A sequence is a snippet of 30
frames at 17 Hz. Its name is that of its annotated frame, the 20th, such as
"frankfurt_000000_000294"; the calibration is that frame's.
"""

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic import files
from geovp_classic.data.findings import Findings
from geovp_classic.data.formats.calibration_files import scaled_to
from geovp_classic.data.frames.image_frames import image_size
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.data.recordings.scans import Scan
from geovp_classic.data.recordings.sequences import PosedSequences
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics

NUM_FRAMES = 30  # of a snippet
ANNOTATED = 19  # number of the annotated frame in a snippet
RATE_HZ = 17.0
SIZE_PX = (2048, 1024)  # of the images that calibrations are about
# axes of the camera are forward, left, up in the calibration, and right, down, forward here
CAMERA_AXES = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


@dataclass(frozen=True)
class Cityscapes(PosedSequences):
    """Snippets of Cityscapes, each a sequence; settings as `PosedSequences`'.

    `split` is "train", "val" or "test"; without it, all are used. Clips have no poses unless
    `vehicle_poses` is set: then these are the car's recorded speed and yaw rate, summed up, so
    that they drift and know no slopes. Without `camera_height_m`, the calibration states it.
    Images may have been resized.
    """

    name = "cityscapes"

    split: str | None = None
    vehicle_poses: bool = False

    def folders(self) -> dict[str, Path]:
        """Return the snippets by name, as paths without a suffix; BadData if there are none."""
        names = f"{self.split or '*'}/*/*_{6 * '[0-9]'}_leftImg8bit.png"
        snippets = {}
        last = "", 0
        length = 0
        for path in sorted((self.root / "leftImg8bit_sequence").glob(names)):
            sequence, digits, _ = path.name.rsplit("_", 2)
            frame = int(digits)
            if last != (sequence, frame - 1) or length == NUM_FRAMES:
                name = f"{sequence}_{frame + ANNOTATED:06d}"
                snippets[name] = path.with_name(name)
                length = 0
            last = sequence, frame
            length += 1
        if not snippets:
            raise BadData(
                f"{self.root} holds no images leftImg8bit_sequence/{names}: give the folder in "
                "which leftImg8bit_sequence_trainvaltest.zip was unpacked"
            )
        return snippets

    def scan(self, folder: Path, findings: Findings) -> Scan:
        """Scan a snippet; `folder` is root/leftImg8bit_sequence/SPLIT/CITY/NAME."""
        paths = self._paths(folder, "leftImg8bit_sequence", "leftImg8bit.png")
        images = tuple(filter(Path.exists, paths))
        scan = Scan(images, np.arange(len(images)) / RATE_HZ)
        for path in paths:
            if path not in images:
                findings.add(path, "does not exist: unpack the images again")
        readings = []
        if self.vehicle_poses:
            vehicle = self._paths(folder, "vehicle_sequence", "vehicle.json")
            for path in vehicle:
                with findings.catch(path):
                    readings.append(read_numbers(path, ("speed", "yawRate")))
        path = self._paths(folder, "camera", "camera.json")[ANNOTATED]
        with findings.catch(path):
            camera, vehicle_from_cam = read_calibration(path)
            camera = scaled_to(camera, image_size(images[0]), str(path))
            poses = None
            if len(readings) == len(images):
                poses = integrated(np.array(readings))
            scan = scan.mounted(camera, vehicle_from_cam, poses)
            height_m = float(vehicle_from_cam[2, 3])
            scan = replace(scan, camera_height_m=height_m)
        return scan

    def _paths(self, folder: Path, kind: str, suffix: str) -> list[Path]:
        """Return the files of a type for all frames of a snippet."""
        split, city, name = folder.parts[-3:]
        sequence, digits = name.rsplit("_", 1)
        first = int(digits) - ANNOTATED
        return [
            self.root / kind / split / city / f"{sequence}_{frame:06d}_{suffix}"
            for frame in range(first, first + NUM_FRAMES)
        ]


def read_calibration(path: Path) -> tuple[DistortedCamera, FloatArray]:
    """Read a camera of 2048x1024 images, and its vehicle_from_cam [4, 4].

    The vehicle's origin is on the ground below the rear axle, its axes are forward, left, up
    (Cityscapes Calibration, Schneider & Cordts 2016). BadData names what is wrong.
    """
    intrinsic = read_numbers(path, ("fx", "fy", "u0", "v0"), "intrinsic")
    fx, fy, cx, cy = intrinsic.tolist()
    extrinsic = read_numbers(path, ("yaw", "pitch", "roll", "x", "y", "z"), "extrinsic")
    rotation = Rotation.from_euler("ZYX", extrinsic[:3]).as_matrix()
    camera = DistortedCamera(Intrinsics(fx, fy, cx, cy, *SIZE_PX))
    return camera, se3.compose(rotation @ CAMERA_AXES, extrinsic[3:])


def read_numbers(path: Path, names: tuple[str, ...], section: str | None = None) -> FloatArray:
    """Read numbers of a JSON file, or of a section of it, by name; BadData without them."""
    table = files.read_json(path)
    expected = "expected " + ", ".join(names)
    if section is not None:
        expected += f" in {section!r}"
    with files.checked(f"{path} lacks a number", expected):
        if section is not None:
            table = table[section]
        numbers = np.array([float(table[name]) for name in names])
        if not np.isfinite(numbers).all():
            raise ValueError("not finite")
        return numbers


def integrated(
    readings: FloatArray,  # [N, 2], speed in m/s and yaw rate in rad/s, to the left
) -> FloatArray:
    """Return world_from_vehicle [N, 4, 4], starting at the identity, of motion in the plane.

    Speed and yaw rate are those halfway between two frames, so that each step is an arc.
    """
    means = (readings[1:] + readings[:-1]) / 2
    twists = np.zeros((len(means), 6))
    twists[:, [0, 5]] = means / RATE_HZ
    poses = itertools.accumulate(se3.exp(twists), np.matmul, initial=np.eye(4))
    return np.stack(list(poses))
