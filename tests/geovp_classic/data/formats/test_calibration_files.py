"""Files with the same camera, written as their programs write it, give the same numbers."""

import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from geovp_classic.data.formats.calibration_files import exif_focal_px, read_camera
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics

KITTI = "P0: 1 0 2 0 0 1 2 0 0 0 1 0\nP2: 500 0 319.5 4.5 0 510 239.5 0.2 0 0 1 0.003\n"
TOPIC = "height: 144\nwidth: 192\nK: [166.0, 0, 95.5, 0, 166.0, 71.5, 0, 0, 1]\nD: [-0.05, 0.01]\n"
KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [166, 166, 95.5, 71.5]
  distortion_model: radtan
  distortion_coeffs: [-0.05, 0.01, 0, 0]
  resolution: [192, 144]
"""


@pytest.mark.parametrize("prefix", ["P", "P_rect_0"])
def test_kitti_camera_is_that_of_the_folder(prefix: str, tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(KITTI.replace("P", prefix))
    camera = read_camera(path, tmp_path / "frames", (640, 480))
    assert camera.pinhole == Intrinsics(500, 510, 319.5, 239.5, 640, 480)
    assert read_camera(path, tmp_path / "image_0", (4, 4)).pinhole.fx_px == 1
    with pytest.raises(BadData, match=f"no line '{prefix}3:'"):
        read_camera(path, tmp_path / "image_3", (4, 4))


def test_images_of_half_the_size_have_half_the_focal_length(tmp_path: Path) -> None:
    path = tmp_path / "cameras.txt"
    path.write_text("1 SIMPLE_RADIAL 640 480 500 320 240 -0.05\n")
    camera = read_camera(path, tmp_path, (320, 240))
    assert camera.pinhole == Intrinsics(250, 250, 159.5, 119.5, 320, 240)
    assert camera.distortion == (-0.05,)
    with pytest.raises(BadData, match="640x480, these are 640x360"):
        read_camera(path, tmp_path, (640, 360))


def test_unknown_models_are_refused_any_number_of_times(tmp_path: Path) -> None:
    """Pycolmap loses a level of recursion for each unknown name."""
    (tmp_path / "cameras.txt").write_text("1 NOTHING 640 480 500 510\n")
    for _ in range(1100):
        with pytest.raises(BadData, match="is not a calibration"):
            read_camera(tmp_path / "cameras.txt", tmp_path, (640, 480))


def test_the_equivalent_focal_length_of_a_photo_refers_to_the_diagonal(tmp_path: Path) -> None:
    photo = Image.new("RGB", (400, 300))  # a diagonal of 500 px
    photo.save(tmp_path / "a.jpg")
    assert exif_focal_px(tmp_path / "a.jpg") is None
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26  # FocalLengthIn35mmFilm
    photo.save(tmp_path / "a.jpg", exif=exif)
    assert exif_focal_px(tmp_path / "a.jpg") == pytest.approx(26 * 500 / 43.27)


OPENCV = """%YAML:1.0
---
image_width: 192
image_height: 144
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 166., 0., 95.5, 0., 166., 71.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.05, 0.01, 0., 0., 0. ]
"""
ROSTOPIC = """header: {frame_id: cam}
height: 144
width: 192
distortion_model: plumb_bob
d: [-0.05, 0.01, 0, 0, 0]
k: [166.0, 0, 95.5, 0, 166.0, 71.5, 0, 0, 1]
---
header: {frame_id: cam}
---
"""
ORB_SLAM2 = """%YAML:1.0
#--------------------------------------------------------------------------------------------
Camera.fx: 166.0
Camera.fy: 166.0
Camera.cx: 95.5
Camera.cy: 71.5

Camera.k1: -0.05
Camera.k2: 0.01
Camera.p1: 0.0
Camera.p2: 0.0

Camera.fps: 30.0
ORBextractor.scaleFactor: 1.2
"""
ORB_SLAM3 = """%YAML:1.0
Camera.type: "PinHole"
Camera1.fx: 166.0
Camera1.fy: 166.0
Camera1.cx: 95.5
Camera1.cy: 71.5
Camera1.k1: -0.05
Camera1.k2: 0.01
Camera1.p1: 0.0
Camera1.p2: 0.0
Camera2.fx: 1.0
Camera2.k1: 1.0
Camera.width: 192
Camera.height: 144
IMU.T_b_c1: !!opencv-matrix
   rows: 4
   cols: 4
   dt: f
   data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
"""
VINS = """%YAML:1.0
---
model_type: PINHOLE
camera_name: camera
image_width: 192
image_height: 144
distortion_parameters:
   k1: -0.05
   k2: 0.01
   p1: 0.0
   p2: 0.0
projection_parameters:
   fx: 166.0
   fy: 166.0
   cx: 95.5
   cy: 71.5
"""
VINS_FISHEYE = """%YAML:1.0
---
model_type: KANNALA_BRANDT
image_width: 192
image_height: 144
projection_parameters:
   k2: -0.05
   k3: 0.01
   k4: 0.0
   k5: 0.0
   mu: 166.0
   mv: 166.0
   u0: 95.5
   v0: 71.5
"""
NUMPY = """camera_matrix: [[166, 0, 95.5], [0, 166, 71.5], [0, 0, 1]]
dist_coeff: [[-0.05, 0.01, 0, 0, 0]]
"""
REGION = """height: 960
width: 1280
D: [-0.05, 0.01]
K: [166, 0, 395.5, 0, 166, 271.5, 0, 0, 1]
roi: {x_offset: 300, y_offset: 200, height: 144, width: 192, do_rectify: False}
"""
TWO_CAMERAS = """cam0:
  intrinsics: [100, 100, 95.5, 71.5]
  resolution: [192, 144]
cam1:
  intrinsics: [166, 166, 95.5, 71.5]
  distortion_model: radtan
  distortion_coeffs: [-0.05, 0.01, 0, 0]
  resolution: [192, 144]
"""
FOURTEEN = OPENCV.replace("rows: 5", "rows: 14").replace("0.01, 0.", "0.01" + 10 * ", 0.")
FISHEYE = OPENCV.replace("image_width", "fisheye_model: 1\nimage_width").replace(', 0. ]\n"', "]")
TWICE = (
    "1 OPENCV 192 144 166 166 96 72 -0.05 0.01 0 0\n2 OPENCV 192 144 166 166 96 72 -0.05 0.01 0 0\n"
)


@pytest.mark.parametrize(
    ("name", "content", "model"),
    [
        ("a.yml", OPENCV, "FULL_OPENCV"),
        ("a.yml", TOPIC, "FULL_OPENCV"),
        ("a.yaml", KALIBR, "FULL_OPENCV"),
        ("a.yml", FOURTEEN, "FULL_OPENCV"),
        ("a.yml", FISHEYE, "OPENCV_FISHEYE"),
        ("a.yaml", ROSTOPIC, "FULL_OPENCV"),
        ("a.yaml", ORB_SLAM2, "FULL_OPENCV"),
        ("a.yaml", ORB_SLAM3, "FULL_OPENCV"),
        ("a.yaml", ORB_SLAM3.replace("PinHole", "KannalaBrandt8"), "OPENCV_FISHEYE"),
        ("a.yaml", VINS, "FULL_OPENCV"),
        ("a.yaml", VINS_FISHEYE, "OPENCV_FISHEYE"),
        ("a.yaml", TWO_CAMERAS, "FULL_OPENCV"),
        ("a.yaml", KALIBR.replace("cam0", "cam3"), "FULL_OPENCV"),
        ("a.yaml", NUMPY, "FULL_OPENCV"),
        ("a.yaml", REGION, "FULL_OPENCV"),
        ("a.yml", OPENCV.replace("camera_matrix", "Camera_Matrix"), "FULL_OPENCV"),
        ("info.txt", ROSTOPIC, "FULL_OPENCV"),
        ("cameras.txt", TWICE, "OPENCV"),
    ],
)
def test_files_of_calibration_programs_are_read(
    name: str, content: str, model: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text(content)
    camera = read_camera(path, tmp_path / "cam1" / "data", (192, 144))
    assert camera.pinhole == Intrinsics(166, 166, 95.5, 71.5, 192, 144)
    assert camera.model == model
    assert camera.distortion[:2] == (-0.05, 0.01)
    assert not any(camera.distortion[2:])


@pytest.mark.parametrize("text", ["K: " + 20_000 * "[", 20_000 * "{", "K: " + 200_000 * "9:"])
def test_deeply_nested_files_are_refused_at_once(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    start_s = time.monotonic()
    with pytest.raises(BadData, match=r"a\.yaml is not a calibration"):
        read_camera(path, tmp_path, (192, 144))
    assert time.monotonic() - start_s < 5


PINHOLE = (
    "distortion_model: {}\nD: {}\nK: [166, 0, 95.5, 0, 166, 71.5, 0, 0, 1]\n"
    "image_width: 192\nimage_height: 144\n"
)


def test_kalibr_has_the_model_of_one_angle(tmp_path: Path) -> None:
    """Devernay and Faugeras 2001: r' = atan(2 r tan(w / 2)) / w; atan(2 tan .45) / .9 = .8535."""
    (tmp_path / "a.yaml").write_text(PINHOLE.format("fov", "[0.9]"))
    camera = read_camera(tmp_path / "a.yaml", tmp_path, (192, 144))
    pixel = camera.project(np.array([[1.0, 0.0, 1.0]]))[0]
    np.testing.assert_allclose(pixel, [95.5 + 166 * 0.8535, 71.5], atol=0.02)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.yaml", "just a word", "it is not a table"),
        ("a.yaml", "---\n", "it is not a table"),
        ("a.yaml", "cam0: {camera_model: omni, intrinsics: [1, 2, 3, 4, 5]}", "expected pinhole"),
        ("a.yaml", "K: [1, 2]", "2 numbers in camera_matrix, expected 9"),
        ("a.yaml", NUMPY.replace("[166, 0, 95.5]", "[166, 2, 95.5]"), "camera_matrix is not fx 0"),
        ("a.yaml", "K: [166, 0, 0, 0, 166, 0, 95.5, 71.5, 1]", "camera_matrix is not"),  # MATLAB's
        ("a.yaml", KALIBR.replace("0.01, 0, 0", "0.01, 0"), "has 3 coefficients"),
        ("a.yaml", "%YAML:1.0\nCamera1.fx: 166.0\nCamera.width: 192\n", "'fy'"),
        ("a.yaml", VINS.replace("   fx: 166.0\n", ""), "'fx'"),
        ("a.yaml", VINS.replace("PINHOLE", "MEI"), "the model 'MEI', expected PinHole"),
        ("a.yaml", PINHOLE.format("thin_prism", "[0.1]"), "distortion_model is 'thin_prism', exp"),
        ("cameras.txt", "1 PINHOLE 192 144 500 510", "is not a camera"),
        ("cameras.txt", "1 PINHOLE 192 0 500 510 320 240", "cameras.txt"),
        ("cameras.txt", "1 PINHOLE 192 4000000000000 500 510 320 240", "cameras.txt"),
        ("cameras.txt", "# nothing\n", "it is not a table"),
        (
            "cameras.txt",
            TWICE.replace("\n2 OPENCV 192 144 166", "\n2 OPENCV 192 144 170"),
            "2 diff",
        ),
        ("a.txt", "1 EQUIRECTANGULAR 192 144 192 144", "its model is EQUIRECTANGULAR, expected"),
        ("a.txt", "1 NOTHING 192 144 166", r"\(Invalid string value NOTHING"),
        ("calib.txt", "P2: 1 2 3", "calib.txt"),
    ],
)
def test_wrong_files_are_refused(name: str, content: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(BadData, match=message) as caught:
        read_camera(path, tmp_path, (192, 144))
    assert "\n" not in str(caught.value)
