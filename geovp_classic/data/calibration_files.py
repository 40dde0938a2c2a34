"""Intrinsics from the files that other programs write: KITTI's calib.txt, COLMAP's cameras.txt, ROS
and Kalibr YAML.

EXIF data of photos give a focal length alone.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import ExifTags, Image

from geovp_classic import files
from geovp_classic.data import kitti
from geovp_classic.data.findings import Findings
from geovp_classic.data.undistortion import DistortedCamera
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics

FILM_DIAGONAL_MM = 43.27  # of 36 x 24 mm, to which an equivalent focal length refers (CIPA DCG-001)
EXPECTED = "KITTI's calib.txt, COLMAP's cameras.txt, a ROS camera_info or a Kalibr camchain (.yaml)"
# COLMAP's distortion models by the names of ROS, Kalibr and the ASL layout
MODELS = dict.fromkeys(
    ["equidistant", "fisheye"], "OPENCV_FISHEYE"
) | dict.fromkeys(
    ["none", "plumb_bob", "radtan", "radial-tangential", "rational_polynomial"],
    "FULL_OPENCV",
)


@dataclass(frozen=True)
class Calibration:
    """The camera of a file; its size is None if the file does not state it."""

    # fx, fy, cx, cy in pixels; (0, 0) is the centre of the top-left one
    numbers: tuple[float, float, float, float]
    size_px: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()
    # COLMAP's name of the distortion model; FULL_OPENCV may have fewer than its eight coefficients
    model: str = "FULL_OPENCV"

    def __post_init__(self) -> None:
        width_px, height_px = self.size_px or (1, 1)
        Intrinsics(*self.numbers, width_px, height_px)

    def of_size(self, path: Path, width_px: int, height_px: int) -> Intrinsics:
        """Return the camera of images of a size.

        BadData if the file is about images of another aspect ratio.
        """
        width, height = self.size_px or (width_px, height_px)
        if abs(np.log(width * height_px / (height * width_px))) > 0.01:
            raise BadData(
                f"{path} is about images of {width}x{height}, these are {width_px}x{height_px}: "
                "give the file of this camera, or --intrinsics"
            )
        return Intrinsics(*self.numbers, width, height).resized(
            width_px, height_px
        )

    def lens(self, camera: Intrinsics) -> DistortedCamera | None:
        """Return `camera`, which is this one at some size, with the distortion.

        None without distortion; BadData for a wrong number of coefficients.
        """
        if not any(self.distortion):
            return None
        coefficients = self.distortion
        if self.model == "FULL_OPENCV":
            if len(coefficients) not in (2, 4, 5, 8):
                raise BadData(
                    f"the distortion {list(coefficients)} has {len(coefficients)} coefficients, "
                    "expected k1, k2 [, p1, p2 [, k3 [, k4, k5, k6]]]"
                )
            coefficients += (0.0,) * (8 - len(coefficients))
        return DistortedCamera(camera, self.model, coefficients)


def read_calibration(path: Path, images: Path) -> Calibration:
    """Read the camera of a file.

    Of several in KITTI's, it is the one of the folder `images`/.../image_K, else the usual one.
    """
    text = files.read_text(path, files.MIB)
    if path.suffix.lower() in (".yaml", ".yml"):
        return from_yaml(path, load_yaml(path))
    if match := re.search(r"^(P|P_rect_0)[0-3]:", text, re.MULTILINE):
        return _from_kitti(path, match[1], images)
    return _from_colmap(path, text)


def exif_focal_px(photo: Path) -> float | None:
    """Return the focal length in pixels by the 35 mm equivalent in a photo's EXIF data.

    None if the data state none.
    """
    try:
        with files.opened(photo) as file, Image.open(file) as image:
            tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
            equivalent_mm = float(tags[ExifTags.Base.FocalLengthIn35mmFilm])
            diagonal_px = float(np.hypot(*image.size))
    except (
        Exception
    ):  # many programs write bad EXIF data, for which Pillow raises many types
        return None
    if not 0 < equivalent_mm < 5000:
        return None
    return equivalent_mm * diagonal_px / FILM_DIAGONAL_MM


def _from_kitti(path: Path, prefix: str, images: Path) -> Calibration:
    """Read the projection of the camera that `images` names, else of the preferred one."""
    findings = Findings()
    match = re.fullmatch(r"image_0?([0-3])", images.resolve().name)
    cameras = [int(match[1])] if match else kitti.PREFERRED_CAMERAS
    for camera in cameras:
        projection = kitti.scan_projection(path, f"{prefix}{camera}", findings)
        if projection is not None:
            return Calibration(projection[0])
    findings.raise_first()
    raise AssertionError


def _from_colmap(path: Path, text: str) -> Calibration:
    """Parse the only camera of a cameras.txt."""
    from geovp_classic.colmap_library import pycolmap

    rows = [
        line.split()
        for line in text.splitlines()
        if line.strip() and not line.startswith("#")
    ]
    if len(rows) != 1:
        raise BadData(
            f"{path} holds {len(rows)} lines of cameras, expected one: give {EXPECTED}"
        )
    try:
        _, name, width, height, *params = rows[0]
        model = pycolmap.CameraModelId(
            name
        )  # Camera(model=name) leaks for unknown names
        camera = pycolmap.Camera(
            model=model,
            width=int(width),
            height=int(height),
            params=[float(param) for param in params],
        )
        if not camera.verify_params():
            raise ValueError("wrong number of parameters")
        if (
            not 0
            < min(camera.width, camera.height)
            <= max(camera.width, camera.height)
            <= 2**16
        ):
            raise ValueError(f"its images are {width}x{height}")
        lens = DistortedCamera.from_colmap(camera)
    except Exception as problem:  # the file may hold anything
        raise BadData(
            f"{path}: {' '.join(rows[0])[:80]!r} is not a camera ({problem}): give {EXPECTED}"
        ) from problem
    view = lens.pinhole
    numbers = (view.fx_px, view.fy_px, view.cx_px, view.cy_px)
    return Calibration(numbers, lens.size_px, lens.distortion, lens.model)


def load_yaml(path: Path) -> Mapping[str, Any]:
    """Load the table of a YAML file, that of the first camera in a Kalibr camchain."""
    text = files.read_text(path, files.MIB)
    try:
        table = yaml.safe_load(
            re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE)
        )  # OpenCV's
        table = table.get("cam0", table)
        table.keys()
    except Exception as problem:
        raise _not_a_calibration(path, problem) from problem
    return table


def from_yaml(path: Path, table: Mapping[str, Any]) -> Calibration:
    """Convert the table of a ROS camera_info, of Kalibr or of the ASL layout.

    BadData for other camera models than pinhole, and unknown distortion models.
    """
    try:
        if table.get("camera_model", "pinhole") != "pinhole":
            raise ValueError(
                f"camera_model is {table['camera_model']!r}, expected pinhole"
            )
        if "intrinsics" in table:
            fx, fy, cx, cy = table["intrinsics"]
        else:
            camera_matrix = _first(table, "camera_matrix", "K", "k")
            fx, _, cx, _, fy, cy = matrix_data(camera_matrix)[:6]
        width = _first(table, "image_width", "width")
        height = _first(table, "image_height", "height")
        width, height = table.get("resolution", (width, height))
        lens = _first(
            table, "distortion_coeffs", "distortion_coefficients", "D", "d"
        )
        return Calibration(
            (float(fx), float(fy), float(cx), float(cy)),
            None
            if width is None or height is None
            else (int(width), int(height)),
            tuple(float(coefficient) for coefficient in matrix_data(lens)),
            MODELS[table.get("distortion_model") or "none"],
        )
    except Exception as problem:
        raise _not_a_calibration(path, problem) from problem


def matrix_data(value: Any) -> list[Any]:
    """Return the numbers of a matrix, which ROS writes as a list or below `data`."""
    return list(value["data"] if isinstance(value, Mapping) else value or [])


def _first(table: Mapping[str, Any], *keys: str) -> Any:
    """Return the value of the first key that a table has, else None."""
    return next((table[key] for key in keys if key in table), None)


def _not_a_calibration(path: Path, problem: Exception) -> BadData:
    reason = str(problem).partition("\n")[0]
    return BadData(f"{path} is not a calibration ({reason}): give {EXPECTED}")
