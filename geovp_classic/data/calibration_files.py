"""Intrinsics from the files that other programs write: KITTI's calib.txt, COLMAP's cameras.txt, ROS
and Kalibr YAML.

EXIF data of photos give a focal length alone.
"""

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geovp_classic import files
from geovp_classic.data.kitti_layout import PREFERRED_CAMERAS, scan_calibration
from geovp_classic.data.undistortion import DistortedCamera
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics

FILM_DIAGONAL_MM = 43.27  # of 36 x 24 mm, to which an equivalent focal length refers (CIPA DCG-001)
EXIF_TABLE, EXIF_EQUIVALENT_MM = 0x8769, 0xA405
EXPECTED = "KITTI's calib.txt, COLMAP's cameras.txt, a ROS camera_info or a Kalibr camchain (.yaml)"
MAX_EQUIVALENT_MM = 5000.0
MAX_ASPECT_CHANGE = 0.01
MAX_DISTORTION = 1e4  # of any coefficient
OPENCV_COEFFICIENTS = (
    2,
    4,
    5,
    8,
)  # k1, k2, p1, p2, k3, k4, k5, k6 (OpenCV, ROS's plumb_bob, Kalibr's radtan)
FISHEYE = (
    "equidistant",
    "fisheye",
)  # ROS's and Kalibr's words for Kannala and Brandt's four coefficients
MAX_SIDE_PX = 2**16  # of images
SIZE_LIMIT = files.MIB


@dataclass(frozen=True)
class Calibration:
    """The camera of a file; its size is None where the file does not say it."""

    numbers: tuple[
        float, float, float, float
    ]  # fx, fy, cx, cy in pixels, (0, 0) the top-left one's centre
    size_px: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()
    # COLMAP's name of the distortion's model; fewer than its eight coefficients may be given
    model: str = "FULL_OPENCV"

    def __post_init__(self) -> None:
        width, height = self.size_px or (1, 1)
        if (
            not np.isfinite(self.distortion).all()
            or max(map(abs, self.distortion), default=0) > MAX_DISTORTION
        ):
            raise BadData(
                f"the calibration's distortion is {list(self.distortion)}: give {EXPECTED}"
            )
        Intrinsics(*self.numbers, width, height)

    def of_size(self, path: Path, width_px: int, height_px: int) -> Intrinsics:
        """The camera of images of that size; BadData when the file is about images of another
        shape.
        """
        width, height = self.size_px or (width_px, height_px)
        if abs(np.log(width * height_px / (height * width_px))) > MAX_ASPECT_CHANGE:
            raise BadData(
                f"{path} is about images of {width}x{height}, these are {width_px}x{height_px}: "
                "give the file of this camera, or --intrinsics"
            )
        return Intrinsics(*self.numbers, width, height).resized(width_px, height_px)

    def lens(self, camera: Intrinsics) -> DistortedCamera | None:
        """`camera`, which is this one at some size, with its distortion; None without any."""
        if not np.any(self.distortion):
            return None
        coefficients = self.distortion
        if self.model == "FULL_OPENCV":
            if len(coefficients) not in OPENCV_COEFFICIENTS:
                raise BadData(
                    f"the distortion {list(coefficients)} has {len(coefficients)} coefficients, "
                    "expected k1, k2 [, p1, "
                    "p2 [, k3 [, k4, k5, k6]]]"
                )
            coefficients += (0.0,) * (8 - len(coefficients))
        numbers = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
        return DistortedCamera.of(
            self.model, numbers, coefficients, (camera.width_px, camera.height_px)
        )


def read_calibration(path: Path, images: Path) -> Calibration:
    """The camera of a file; of several in KITTI's, the one of the folder `images`/.../image_K, else
    the usual one.
    """
    text = files.read_text(path, SIZE_LIMIT)
    if path.suffix.lower() in (".yaml", ".yml"):
        return from_yaml(path, load_yaml(path))
    return _kitti(path, images) if re.search(r"^P\w*:", text, re.MULTILINE) else _colmap(path, text)


def exif_focal_px(photo: Path) -> float | None:
    """The focal length in pixels by the 35 mm equivalent in a photo's EXIF data; None where there
    is none.
    """
    from PIL import Image

    try:
        with files.opened(photo) as file, Image.open(file) as image:
            equivalent_mm = float(image.getexif().get_ifd(EXIF_TABLE).get(EXIF_EQUIVALENT_MM, 0))
            diagonal_px = float(np.hypot(*image.size))
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        SyntaxError,
        struct.error,
    ):  # EXIF data of many programs are bad
        return None
    return (
        equivalent_mm * diagonal_px / FILM_DIAGONAL_MM
        if 0 < equivalent_mm < MAX_EQUIVALENT_MM
        else None
    )


def _kitti(path: Path, images: Path) -> Calibration:
    projections, findings = scan_calibration(path)
    match = re.fullmatch(r"image_0?([0-3])", images.resolve().name)
    wanted = [int(match[1])] if match else PREFERRED_CAMERAS
    for camera in wanted:
        if camera in projections:
            k = projections[camera].matrix
            return Calibration((float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])))
    raise BadData(
        str(findings[0])
        if findings
        else f"{path} has no line of the camera of {images}: give --intrinsics"
    )


def _colmap(path: Path, text: str) -> Calibration:
    """The only camera of a cameras.txt; COLMAP's pixels start at the image's corner, ours at a
    pixel's centre.
    """
    from geovp_classic.colmap_library import pycolmap

    rows = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(rows) != 1:
        raise BadData(f"{path} holds {len(rows)} lines of cameras, expected one: give {EXPECTED}")
    try:
        (_, name, width, height), params = rows[0][:4], [float(each) for each in rows[0][4:]]
        model = pycolmap.CameraModelId(
            name
        )  # refuses unknown names cleanly: Camera leaks recursion depth at each
        if not 0 < min(int(width), int(height)) <= max(int(width), int(height)) <= MAX_SIDE_PX:
            raise ValueError(f"its images are {width}x{height}")
        camera = pycolmap.Camera(model=model, width=int(width), height=int(height), params=params)
        if not camera.verify_params():
            raise ValueError("its parameters are too few or too many")
        shared, centre = list(camera.focal_length_idxs()), list(camera.principal_point_idxs())
    except (ValueError, RuntimeError, IndexError, TypeError, OverflowError) as error:
        raise BadData(
            f"{path}: {' '.join(rows[0])[:80]!r} is not a camera ({error}): give {EXPECTED}"
        ) from error
    focal, (cx, cy) = [camera.params[i] for i in shared], (camera.params[i] for i in centre)
    others = [float(p) for i, p in enumerate(camera.params) if i not in (*shared, *centre)]
    numbers = (float(focal[0]), float(focal[-1]), float(cx) - 0.5, float(cy) - 0.5)
    return Calibration(numbers, (camera.width, camera.height), tuple(others), camera.model.name)


def load_yaml(path: Path) -> Mapping[str, Any]:
    """The table of a YAML file, that of the first camera in a Kalibr camchain; BadData when it is
    none.
    """
    import yaml

    try:
        read = yaml.safe_load(
            re.sub(r"^%YAML.*$", "", files.read_text(path, SIZE_LIMIT), flags=re.MULTILINE)
        )
        first = read.get("cam0", read)
        first.keys()
    except (ValueError, TypeError, RecursionError, yaml.YAMLError, AttributeError) as error:
        reason = str(error).partition("\n")[0]
        raise BadData(f"{path} is not a calibration ({reason}): give {EXPECTED}") from error
    return first


def from_yaml(path: Path, read: Mapping[str, Any]) -> Calibration:
    """The camera of a ROS camera_info (K or camera_matrix), or of Kalibr's or the ASL layout's
    table (pinhole).
    """
    try:
        matrix = data_of(read.get("camera_matrix", read.get("K", read.get("k"))))
        if "intrinsics" in read:
            if read.get("camera_model", "pinhole") != "pinhole":
                raise ValueError(f"camera_model is {read['camera_model']!r}, expected pinhole")
            fx, fy, cx, cy = read["intrinsics"]
        else:
            fx, _, cx, _, fy, cy = matrix[:6]
        size = read.get("resolution") or (
            read.get("image_width", read.get("width")),
            read.get("image_height", read.get("height")),
        )
        lens = data_of(
            read.get(
                "distortion_coeffs",
                read.get("distortion_coefficients", read.get("D", read.get("d", []))),
            )
        )
        numbers = (float(fx), float(fy), float(cx), float(cy))
        size_px = None if None in size else (int(size[0]), int(size[1]))
        model = "OPENCV_FISHEYE" if str(read.get("distortion_model")) in FISHEYE else "FULL_OPENCV"
        return Calibration(numbers, size_px, tuple(float(each) for each in lens), model)
    except (ValueError, TypeError, AttributeError, KeyError, OverflowError, IndexError) as error:
        reason = str(error).partition("\n")[0]
        raise BadData(f"{path} is not a calibration ({reason}): give {EXPECTED}") from error


def data_of(value: Any) -> list[Any]:
    """The numbers of a matrix, which ROS writes as a list or below `data`."""
    return list(value["data"] if isinstance(value, Mapping) else value or [])
