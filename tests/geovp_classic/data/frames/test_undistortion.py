"""Undistorted images show a point where a pinhole camera sees it."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest

from geovp_classic.data.frames import undistortion
from geovp_classic.data.frames.undistortion import DistortedCamera, UndistortedFrames
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics

F, CX, CY, SIZE_PX = 200.0, 158.0, 121.0, (320, 240)
RAY = (0.45, -0.3)  # 90 px to the right of the centre and 60 px up


def camera_of(
    model: str = "PINHOLE",
    distortion: tuple[float, ...] = (),
    focal_px: float = F,
    centre_px: tuple[float, float] = (CX, CY),
) -> DistortedCamera:
    """Return a camera of images of 320x240 pixels."""
    return DistortedCamera(Intrinsics(focal_px, focal_px, *centre_px, *SIZE_PX), model, distortion)


def undistorted(
    image: np.ndarray, camera: DistortedCamera, view: Intrinsics, *interpolation: int
) -> np.ndarray:
    """Return the image of the pinhole camera `view`."""
    frames = SimpleNamespace(read=lambda _: image)
    return UndistortedFrames(frames, (camera,), view, *interpolation).read(0)


def spot(u: float, v: float) -> np.ndarray:
    """Return an image [240, 320, 3] with a smooth bright spot of 3 px around a place."""
    columns, rows = np.meshgrid(np.arange(320), np.arange(240))
    grey = 250 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 18)
    return np.repeat(np.rint(grey).astype(np.uint8)[..., None], 3, axis=2)


def centre_of(image: np.ndarray) -> tuple[float, float]:
    """Return where the spot is."""
    moments = cv2.moments(image[..., 0])
    return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]


@pytest.mark.parametrize(
    ("model", "numbers", "project"),
    [
        ("OPENCV", (-0.28, 0.07, 0.002, -0.003), cv2.projectPoints),
        ("FULL_OPENCV", (0.26, -0.95, -0.0054, 0.0026, 1.16), cv2.projectPoints),
        ("OPENCV_FISHEYE", (-0.01, 0.02, -0.01, 0.003), cv2.fisheye.projectPoints),
    ],
)
def test_a_point_is_shown_where_a_pinhole_camera_sees_it(
    model: str, numbers: tuple[float, ...], project: Callable[..., Any]
) -> None:
    camera = camera_of(model, numbers)
    view = undistortion.common_pinhole([camera], Path("here"))
    zero = np.zeros(3)
    distorted, _ = project(
        np.array([[[*RAY, 1.0]]]), zero, zero, camera.pinhole.matrix, np.array(numbers)
    )
    image = undistorted(spot(*distorted[0, 0]), camera, view)
    expected = view.fx_px * np.array(RAY) + [CX, CY]
    assert np.linalg.norm(distorted[0, 0] - expected) > 2
    np.testing.assert_allclose(centre_of(image), expected, atol=0.4)  # the spot is bent, too


def test_colmap_counts_pixels_from_the_corner() -> None:
    params = [F, CX + 0.5, CY + 0.5, 0.25]
    given = pycolmap.Camera(model="SIMPLE_RADIAL", width=320, height=240, params=params)
    assert DistortedCamera.from_colmap(given) == camera_of("SIMPLE_RADIAL", (0.25,))
    ray = np.array([[0.3, 0.4, 1.0]])
    distorted = DistortedCamera.from_colmap(given).project(ray)
    np.testing.assert_allclose(distorted, given.img_from_cam(ray) - 0.5)
    camera = camera_of()
    image = spot(100, 50)
    assert undistorted(image, camera, camera.pinhole) is image


def test_pincushion_distortion_is_zoomed_until_no_border_is_empty() -> None:
    """A corner at radius r of the view comes from r (1 + 0.1 r^2) of the image, which ends 160 px
    off the centre.
    """
    camera = camera_of("OPENCV", (0.1, 0.0, 0.0, 0.0), centre_px=(159.5, 119.5))
    view = undistortion.common_pinhole([camera], Path("here"))

    def source_px(focal_px: float) -> float:
        """Return how far right of the centre the source of the corner lies."""
        squared = (159.5**2 + 119.5**2) / focal_px**2
        return F * 159.5 / focal_px * (1 + 0.1 * squared)

    assert source_px(view.fx_px) <= 160 < source_px(view.fx_px / 1.011)
    white = undistorted(np.full((240, 320), 255, np.uint8), camera, view)
    assert white.min() == 255


def test_images_of_several_cameras_are_shown_as_one_sees_them() -> None:
    """The second camera has a focal length 5 % longer: the view is zoomed by as much."""
    view = undistortion.common_pinhole([camera_of(), camera_of(focal_px=1.05 * F)], Path("here"))
    assert 1.04 < view.fx_px / F < 1.06
    assert (view.cx_px, view.cy_px) == (CX, CY)


def test_cameras_that_see_no_common_image_are_refused() -> None:
    for cameras in (
        [camera_of(), camera_of(focal_px=5 * F)],
        [camera_of("OPENCV", (np.nan, 0.0, 0.0, 0.0))],
    ):
        with pytest.raises(BadData, match=r"model: no pinhole camera, up to a zoom of 2, .* check"):
            undistortion.common_pinhole(cameras, Path("model"))


def test_depths_are_those_of_the_nearest_pixels() -> None:
    camera = camera_of("OPENCV", (-0.28, 0.07, 0.0, 0.0))
    depth = np.full((240, 320), 2, np.float32)
    depth[:, 160:] = 5
    shown = undistorted(depth, camera, camera.pinhole, cv2.INTER_NEAREST)
    assert set(np.unique(shown)) == {2.0, 5.0}  # no mean of the two


@pytest.mark.parametrize(
    ("model", "count"),
    [
        ("SIMPLE_FISHEYE", 0),
        ("FISHEYE", 0),
        ("SIMPLE_RADIAL_FISHEYE", 1),
        ("RADIAL_FISHEYE", 2),
        ("OPENCV_FISHEYE", 0),
        ("OPENCV_FISHEYE", 4),
        ("THIN_PRISM_FISHEYE", 8),
    ],
)
def test_fisheye_lenses_without_coefficients_are_equidistant(model: str, count: int) -> None:
    """A ray at 45 degrees lies f pi / 4 = 78.5 pixels from the centre, not f = 100."""
    camera = DistortedCamera(Intrinsics(100, 100, 150, 100, 301, 201), model, (0.0,) * count)
    (pixel,) = camera.project(np.array([[1.0, 0.0, 1.0]]))
    np.testing.assert_allclose(pixel, [150 + 100 * np.pi / 4, 100], atol=1e-6)
