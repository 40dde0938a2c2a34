"""The pixel convention: (0, 0) is the centre of the top-left pixel, and crops and resizes keep rays
on their pixels.
"""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.geometry import pinhole
from geovp_classic.types import Intrinsics

focal = st.floats(50, 2000)
sizes = st.integers(16, 1300)


@st.composite
def cameras(draw: st.DrawFn) -> Intrinsics:
    width_px, height_px = draw(sizes), draw(sizes)
    centre = [st.floats(0, size, allow_subnormal=False) for size in (width_px, height_px)]
    return Intrinsics(
        draw(focal), draw(focal), draw(centre[0]), draw(centre[1]), width_px, height_px
    )


aside = st.floats(-50, 50, allow_subnormal=False)  # subnormal numbers have no relative precision
points = st.tuples(aside, aside, st.floats(0.1, 200)).map(np.array)


@given(cameras(), points)
def test_unproject_undoes_project(camera: Intrinsics, point: np.ndarray) -> None:
    pixel, depth = pinhole.project(point, camera)
    np.testing.assert_allclose(pinhole.unproject(pixel, depth, camera), point, rtol=1e-9, atol=1e-8)


def test_points_behind_have_no_pixel() -> None:
    camera = Intrinsics(100, 100, 50, 50, 101, 101)
    pixels, depth = pinhole.project(np.array([[0.0, 0, -1], [1, 1, 0], [0, 0, 2]]), camera)
    assert np.isnan(pixels[:2]).all()
    np.testing.assert_array_equal(pixels[2], [50, 50])
    np.testing.assert_array_equal(depth, [-1, 0, 2])


def test_centre_crop_of_kitti() -> None:
    # 1242x375: the square is columns 433..807; 256/375 of the focal length stays.
    camera = Intrinsics(721.5377, 721.5377, 609.5593, 172.854, 1242, 375)
    (rows, columns), square = pinhole.centre_crop(camera, (256, 256))
    assert (rows, columns) == (slice(0, 375), slice(433, 808))
    assert square.fx_px == pytest.approx(721.5377 * 256 / 375)
    assert square.cx_px == pytest.approx((609.5593 - 433 + 0.5) * 256 / 375 - 0.5)
    assert (square.width_px, square.height_px) == (256, 256)


def test_resized_images_agree_with_resized_intrinsics() -> None:
    # A bright blob at a known ray must lie where the resized camera says.
    camera = Intrinsics(200, 200, 95.5, 63.5, 192, 128)
    blob_px = np.array([60.0, 40.0])
    v, u = np.mgrid[:128, :192]
    image = np.exp(-((u - blob_px[0]) ** 2 + (v - blob_px[1]) ** 2) / 50)
    image = np.repeat((image * 255).astype(np.uint8)[..., None], 3, axis=2)
    small = pinhole.resize(image, (96, 64))[..., 0].astype(float)
    moments = cv2.moments(small)
    measured = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    expected, _ = pinhole.project(
        pinhole.unproject(blob_px, np.float64(1.0), camera), camera.resized(96, 64)
    )
    np.testing.assert_allclose(measured, expected, atol=0.02)


@pytest.mark.parametrize(
    ("size_px", "overshoots"),
    [((16, 8), True), ((8, 16), True), ((4, 16), False), ((16, 4), False)],
)
def test_only_growing_is_bicubic_and_overshoots_at_edges(
    size_px: tuple[int, int], overshoots: bool
) -> None:
    image = np.full((8, 8, 3), 100, np.uint8)
    image[3:5, 3:5] = 200
    found = pinhole.resize(image, size_px)
    assert found.shape == (size_px[1], size_px[0], 3)
    assert (found.min() < 100) == overshoots
    assert pinhole.resize(image, (8, 8)) is image


def test_a_crop_has_at_least_one_pixel() -> None:
    window, _ = pinhole.centre_crop(Intrinsics(9.0, 9.0, 4.0, 1.0, 9, 3), (1, 90))
    assert window == (slice(0, 3), slice(4, 5))


def test_grey_weighs_the_colours_as_television_does() -> None:
    primaries = np.array([[[200, 0, 0], [0, 200, 0], [0, 0, 200], [255, 255, 255]]], np.uint8)
    found = pinhole.grey(primaries)  # ITU-R BT.601: 0.299, 0.587, 0.114
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, [[59.8, 117.4, 22.8, 255]], atol=0.51)
