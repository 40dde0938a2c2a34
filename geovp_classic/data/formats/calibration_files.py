"""Cameras from the files that other programs write: KITTI's calib.txt, COLMAP's cameras.txt, and
YAML of ROS, Kalibr, OpenCV, ORB-SLAM and VINS.

EXIF data of photos give a focal length alone.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import ExifTags, Image

from geovp_classic import files
from geovp_classic.data.findings import RAISE, BadFile, FileFinding, parse_numbers
from geovp_classic.data.frames.image_frames import Size
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics

KITTI_CAMERAS = (2, 0, 1, 3)  # by preference: left colour, left grey, then the others
# COLMAP's distortion models by the names of ROS, Kalibr and the ASL layout
MODELS = {
    "none": "FULL_OPENCV",
    "plumb_bob": "FULL_OPENCV",
    "radtan": "FULL_OPENCV",
    "radial-tangential": "FULL_OPENCV",
    "rational_polynomial": "FULL_OPENCV",
    "equidistant": "OPENCV_FISHEYE",
    "fisheye": "OPENCV_FISHEYE",
    "fov": "FOV",
}
# settings of ORB-SLAM and of VINS (camodocal): distortion model, names of focal lengths and
# principal point, names of coefficients
SLAM_MODELS = {
    "PinHole": ("radtan", "fx fy cx cy", "k1 k2 p1 p2 k3"),
    "Rectified": ("none", "fx fy cx cy", ""),
    "KannalaBrandt8": ("equidistant", "fx fy cx cy", "k1 k2 k3 k4"),
    "PINHOLE": ("radtan", "fx fy cx cy", "k1 k2 p1 p2"),
    "KANNALA_BRANDT": ("equidistant", "mu mv u0 v0", "k2 k3 k4 k5"),
}
MAX_BRACKETS = 1000  # PyYAML's time grows with their square; a calibration has about 20


def read_camera(path: Path, images: Path, size_px: Size) -> DistortedCamera:
    """Read the camera of images of a size.

    Of several cameras in KITTI's and Kalibr's files, it is that of the folder `images`, image_K
    or below camK, else the preferred one. BadData if the file is about images of another aspect
    ratio.
    """
    text = files.read_text(path, files.MIB)
    formats = (
        "give KITTI's calib.txt, COLMAP's cameras.txt, or a .yaml file of ROS, Kalibr, OpenCV, "
        "ORB-SLAM or VINS"
    )
    with files.checked(f"{path} is not a calibration", formats):
        if match := re.search(r"^(P|P_rect_0)[0-3]:", text, re.MULTILINE):
            folder = re.fullmatch(r"image_0?([0-3])", images.resolve().name)
            cameras = [folder[1]] if folder else KITTI_CAMERAS
            names = [f"{match[1]}{camera}" for camera in cameras]
            name = next((name for name in names if f"{name}:" in text), names[0])
            camera, _ = read_projection(path, name, size_px)
        elif lines := re.findall(r"^[ \t]*\d+[ \t]+([A-Z_]+[ \t].*\S)", text, re.MULTILINE):
            camera = _camera_of_colmap(lines)
        else:
            table = load_yaml(text)
            kalibr = [name for name in table if re.match(r"cam\d", name)]
            folders = [*reversed(images.resolve().parts), *kalibr]
            name = next((each for each in folders if each in kalibr), "")
            camera = camera_of_yaml(table.get(name, table), size_px)
    return scaled_to(camera, size_px, str(path))


def scaled_to(camera: DistortedCamera, size_px: Size, source: str) -> DistortedCamera:
    """Return the camera for images of another size; BadData if the aspect ratio differs, too."""
    width_px, height_px = camera.size_px
    if abs(np.log(width_px * size_px[1] / (height_px * size_px[0]))) > 0.01:
        raise BadData(
            f"{source} is about images of {width_px}x{height_px}, these are "
            f"{size_px[0]}x{size_px[1]}: give the file of this camera, or its intrinsics"
        )
    return replace(camera, pinhole=camera.pinhole.resized(*size_px))


def exif_focal_px(photo: Path | None, film_diagonal_mm: float = 43.27) -> float | None:
    """Return the focal length in pixels by the 35 mm equivalent in a photo's EXIF data.

    None if the data state none. The equivalent refers to a film of 36 x 24 mm (CIPA DCG-001).
    """
    try:
        assert photo is not None
        with files.opened(photo) as file, Image.open(file) as image:
            tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
            equivalent_mm = float(tags[ExifTags.Base.FocalLengthIn35mmFilm])
            diagonal_px = float(np.hypot(*image.size))
    # many programs write bad EXIF data, for which Pillow raises many types
    except Exception:
        return None
    is_plausible = 0 < equivalent_mm < 5000
    return equivalent_mm * diagonal_px / film_diagonal_mm if is_plausible else None


def read_entry(path: Path, name: str, count: int) -> FloatArray:
    """Read the numbers of the line `name: ...` in one of KITTI's files; BadData without them.

    A line without a colon has the name "".
    """
    for line, text in RAISE.lines(path):
        key, _, numbers = text.rpartition(":")
        if key == name:
            with RAISE.catch(path, line):
                return parse_numbers(numbers, count)
    raise BadFile(FileFinding(path, None, "error", f"has no line '{name}:'"))


def read_projection(path: Path, name: str, size_px: Size) -> tuple[DistortedCamera, FloatArray]:
    """Read the projection K [I | t] of a rectified camera in one of KITTI's files.

    Return the camera, and cam_from_cam0 [4, 4]; BadData for another projection.
    """
    projection = read_entry(path, name, 12).reshape(3, 4)
    (fx, _, cx, _), (_, fy, cy, _), _ = projection.tolist()
    with RAISE.catch(path):
        view = Intrinsics(fx, fy, cx, cy, *size_px)
    if not np.allclose(projection[:, :3], view.matrix):
        raise BadData(
            f"{path}: {name} is not K [I | t] of a rectified camera: expected zeros beside the "
            "focal lengths, and 0 0 1 below"
        )
    translation = np.linalg.solve(view.matrix, projection[:, 3])
    return DistortedCamera(view), se3.compose(np.eye(3), translation)


def load_yaml(text: str) -> Mapping[str, Any]:
    """Load the table of a YAML file, whose numbers remain text.

    OpenCV writes a first line that is not YAML 1.1; `ros2 topic echo` ends each message with a line
    of its own, and the first message is used.
    """
    if text.count("[") + text.count("{") > MAX_BRACKETS:
        raise ValueError(f"it has more than {MAX_BRACKETS} brackets")
    text = re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE)
    # the base loader knows no tags, such as OpenCV's of matrices, and computes no numbers
    table = next(filter(None, yaml.load_all(text, yaml.BaseLoader)), None)
    if not isinstance(table, Mapping):
        raise ValueError("it is not a table")
    return table


def camera_of_yaml(table: Mapping[str, Any], size_px: Size | None = None) -> DistortedCamera:
    """Convert the table of a ROS camera_info, of OpenCV, Kalibr, the ASL layout or a SLAM system.

    `size_px` is the size of the images if the table lacks it, as ORB-SLAM's may. ValueError,
    KeyError or TypeError for unknown camera models and missing numbers.
    """
    # OpenCV 2 and ROS 1 write capital letters; of ORB-SLAM's two cameras, the first is used
    values = {
        re.sub(r".*\.|^image_", "", name.lower()): value
        for name, value in table.items()
        if "2." not in name
    }
    if values.get("camera_model", "pinhole") != "pinhole":
        raise ValueError(f"camera_model is {values['camera_model']!r}, expected pinhole")
    # all formats by the names of Kalibr and the ASL layout
    if values.keys() & {"fx", "projection_parameters"}:
        values |= _values_of_slam(values)
    elif "intrinsics" not in values:
        values |= _values_of_matrix(values)
    model = values.get("distortion_model") or "none"
    if model not in MODELS:
        raise ValueError(f"its distortion_model is {model!r}, expected {', '.join(MODELS)}")
    # its name differs; a distortion that is overlooked would stay in the images
    names = (name for name in values if re.fullmatch(r"d|dist\w*coef\w*", name))
    distortion = matrix_data(values.get(next(names, "")))
    stated_px = values.get("resolution", [values.get("width"), values.get("height")])
    if None in stated_px and size_px is not None:
        stated_px = size_px
    fx, fy, cx, cy = map(float, values["intrinsics"])
    width_px, height_px = (round(float(side_px)) for side_px in stated_px)
    view = Intrinsics(fx, fy, cx, cy, width_px, height_px)
    return DistortedCamera(view, MODELS[model], tuple(map(float, distortion)))


def _values_of_slam(values: dict[str, Any]) -> dict[str, Any]:
    """Return the camera of ORB-SLAM, or of VINS, which has two tables, by Kalibr's names."""
    tables = values.get("projection_parameters", {}), values.get("distortion_parameters", {})
    values = values | tables[0] | tables[1]
    name = values.get("model_type") or values.get("type", "PinHole")
    if name not in SLAM_MODELS:
        raise ValueError(f"it has the model {name!r}, expected {', '.join(SLAM_MODELS)}")
    model, parameters, coefficients = SLAM_MODELS[name]
    return {
        "distortion_model": model,
        "intrinsics": [values[name] for name in parameters.split()],
        "d": [values.get(name, 0.0) for name in coefficients.split()],
    }


def _values_of_matrix(values: dict[str, Any]) -> dict[str, Any]:
    """Return the camera of OpenCV or ROS by Kalibr's names."""
    renamed: dict[str, Any] = {}
    matrix = matrix_data(values.get("camera_matrix", values.get("k")))
    if len(matrix) != 9:
        raise ValueError(f"it has {len(matrix)} numbers in camera_matrix, expected 9")
    if float(values.get("fisheye_model", 0)):  # of OpenCV's calibration program
        renamed["distortion_model"] = "fisheye"
    fx, _, cx, _, fy, cy, *_ = numbers = [*map(float, matrix)]
    if not np.allclose(numbers, [fx, 0, cx, 0, fy, cy, 0, 0, 1]):
        raise ValueError("its camera_matrix is not fx 0 cx, 0 fy cy, 0 0 1")
    # ROS's region of interest is a part of the sensor that the matrix is about; 0: all of it
    sides = ("x_offset", "y_offset", "width", "height")
    left, top, *region_px = (int(values.get("roi", {}).get(side, 0)) for side in sides)
    if all(region_px):
        cx, cy, renamed["resolution"] = cx - left, cy - top, region_px
    return {**renamed, "intrinsics": (fx, fy, cx, cy)}


def matrix_data(value: Any) -> list[Any]:
    """Return the numbers of a matrix: a list, a list of rows, or a list below `data`."""
    rows = value["data"] if isinstance(value, Mapping) else value or []
    return np.ravel(rows).tolist()


def _camera_of_colmap(lines: list[str]) -> DistortedCamera:
    """Parse the lines of a cameras.txt behind the number; a camera may be there twice."""
    from geovp_classic.colmap_library import pycolmap

    line, *others = dict.fromkeys(lines)
    if others:
        raise ValueError(f"it has {1 + len(others)} different cameras, expected one")
    name, width_px, height_px, *params = line.split()
    # a Camera(model=name) would leak for unknown names
    camera = pycolmap.Camera(
        model=pycolmap.CameraModelId(name),
        width=int(width_px),
        height=int(height_px),
        params=list(map(float, params)),
    )
    if not camera.verify_params() or max(camera.width, camera.height) > 2**16:
        raise ValueError(f"{line[:80]!r} is not a camera")
    return DistortedCamera.from_colmap(camera)
