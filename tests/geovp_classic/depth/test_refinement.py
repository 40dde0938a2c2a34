"""Refinement: finer than the hypotheses where there is texture and parallax, and hands off everywhere else."""

import cv2
import numpy as np
import pytest

from geovp_classic.depth import refinement
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(90.0, 90.0, 39.5, 31.5, 80, 64)
PLANE = np.array([0.02, 0.06, 0.1])  # inverse depth = ray . PLANE: everything on it is in front of the camera
POSES = np.tile(np.eye(4), (9, 1, 1))  # drives forward, swaying; the last one is the reference
POSES[:, 2, 3] = np.linspace(-2.4, 0, 9)
POSES[:-1, 0, 3] = 0.3 * np.sin(np.arange(8))


def _painted(points: FloatArray) -> FloatArray:
    """Grey values of the plane at the points [..., 3]: waves that are a few pixels long."""
    x, y, z = np.moveaxis(2.5 * points, -1, 0)
    return 120 + 40 * np.sin(4.3 * x + 1.1 * y) * np.cos(3.7 * y + 0.8 * z) + 30 * np.sin(2.9 * z - 1.7 * x)


def _images() -> FloatArray:
    """What the cameras see of the plane [9, H, W], each pixel's ray met with it exactly."""
    seen = []
    for pose in POSES:
        rays = pinhole.rays(CAMERA) @ pose[:3, :3].T
        along = (1 - pose[:3, 3] @ PLANE) / (rays @ PLANE)
        seen.append(_painted(pose[:3, 3] + along[..., None] * rays))
    return np.stack(seen).astype(np.float32)


def _exact() -> FloatArray:
    return (pinhole.rays(CAMERA) @ PLANE).astype(np.float32)


def _shift_px(inverse_depth: FloatArray) -> FloatArray:
    """How far off [H, W] the first frame sees the points for their error in inverse depth."""
    first_from_last = se3.inverse(POSES[0]) @ POSES[-1]
    places = [
        pinhole.project(pinhole.rays(CAMERA) + q[..., None] * first_from_last[:3, 3], CAMERA)[0]
        for q in (inverse_depth, _exact())
    ]
    return np.asarray(np.linalg.norm(places[0] - places[1], axis=-1))


def _plain(image: FloatArray) -> FloatArray:
    """The image less its windows' means, by their deviations; beyond the border it is mirrored."""
    reach = refinement.WINDOW_PX // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(image, reach, mode="reflect"), (2 * reach + 1,) * 2)
    variance = windows.var(axis=(2, 3)) + refinement.NOISE_DEVIATION**2
    return np.asarray((image - windows.mean(axis=(2, 3))) / np.sqrt(variance))


def _bilinear(image: FloatArray, place: FloatArray) -> float:
    column, row = np.floor(place).astype(int)
    u, v = place - np.floor(place)
    corners = image[row : row + 2, column : column + 2]
    return float(np.array([1 - v, v]) @ corners @ np.array([1 - u, u]))


def _twin(inverse_depth: FloatArray, images: FloatArray, poses: FloatArray, reference: int) -> FloatArray:
    """The refined inverse depth, pixel by pixel and frame by frame; only the blur is OpenCV's."""
    plain = [_plain(image.astype(np.float64)) for image in images]
    pull, grip, speed = np.zeros((3, *inverse_depth.shape))
    matrix, rays = CAMERA.matrix, pinhole.rays(CAMERA)
    for step in set(range(len(images))) - {reference}:
        other_from_cam = se3.inverse(poses[step]) @ poses[reference]
        for row, column in np.ndindex(*inverse_depth.shape):
            q = float(inverse_depth[row, column])
            point = matrix @ (other_from_cam[:3, :3] @ rays[row, column] + q * other_from_cam[:3, 3])
            there, epipole = point[:2] / point[2], matrix @ other_from_cam[:3, 3]
            if point[2] <= 0 or (there < 1).any() or (there > [CAMERA.width_px - 2, CAMERA.height_px - 2]).any():
                continue
            along = (epipole[:2] - there * epipole[2]) / point[2]
            parallax = float(np.linalg.norm(along))
            before, after = (_bilinear(plain[step], there + way * along / parallax) for way in (-0.5, 0.5))
            difference, slope = plain[reference][row, column] - (before + after) / 2, (after - before) * parallax
            say = 1 / (1 + (difference / refinement.MISFIT) ** 2)
            pull[row, column] += say * slope * difference
            grip[row, column] += say * slope**2
            speed[row, column] = max(speed[row, column], parallax)
    pull, grip = (np.asarray(cv2.GaussianBlur(one, (0, 0), refinement.TOGETHER_PX)) for one in (pull, grip))
    stiff = np.maximum(speed, refinement.LEAST_PARALLAX * np.median(speed[speed > 0]))
    longest = refinement.LARGEST_STEP_PX / stiff
    step_by = np.clip(pull / (grip + refinement.STIFFNESS * stiff**2), -longest, longest)
    return np.asarray(np.where(speed > 0, np.maximum(inverse_depth + step_by, 0), inverse_depth))


def test_equals_the_slow_twin() -> None:
    poses = POSES[[0, 4, 8]].copy()
    poses[0] = poses[0] @ se3.exp(np.array([0, 0, 0, 0.01, -0.02, 0.03]))
    noise = np.random.default_rng(7).normal(0, 8, (3, 64, 80))
    images = (_images()[[0, 4, 8]] + noise).astype(np.float32)
    found = refinement.refined(_exact() * np.float32(1.1), images, CAMERA, poses, 2)
    expected = _twin(_exact() * np.float32(1.1), images, poses, 2)
    np.testing.assert_allclose(found, expected, rtol=2e-4)
    assert np.abs(expected / (1.1 * _exact()) - 1).max() > 0.02


@pytest.mark.parametrize(("gain", "offset"), [(1.0, 0.0), (0.7, 30.0)])
def test_errors_of_a_fraction_of_a_pixel_fall_to_less_than_half_whatever_the_exposure(
    gain: float, offset: float
) -> None:
    images = _images()
    images[:-1] = gain * images[:-1] + offset
    too_near = _exact() * np.float32(1.05)
    left = _shift_px(refinement.refined(too_near, images, CAMERA, POSES, 8))
    assert 0.2 < np.median(_shift_px(too_near)) < 0.5
    assert np.median(left) < 0.5 * np.median(_shift_px(too_near))


def test_what_is_right_stays_right() -> None:
    assert np.median(_shift_px(refinement.refined(_exact(), _images(), CAMERA, POSES, 8))) < 0.03


def test_any_frame_can_be_the_reference_and_any_unit_will_do() -> None:
    images, poses = _images()[::-1], POSES[::-1].copy()
    too_near = _exact() * np.float32(1.05)
    found = refinement.refined(too_near, images, CAMERA, poses, 0)
    np.testing.assert_allclose(found, refinement.refined(too_near, _images(), CAMERA, POSES, 8), rtol=1e-5)
    poses[:, :3, 3] *= 1000
    np.testing.assert_allclose(1000 * refinement.refined(too_near / 1000, images, CAMERA, poses, 0), found, rtol=1e-4)


def test_nothing_moves_without_texture_without_parallax_or_alone() -> None:
    q, images = _exact(), _images()
    np.testing.assert_allclose(refinement.refined(q, np.full_like(images, 99), CAMERA, POSES, 8), q, rtol=1e-6)
    still = np.tile(np.eye(4), (9, 1, 1))
    np.testing.assert_array_equal(refinement.refined(q, images, CAMERA, still, 8), q)
    np.testing.assert_array_equal(refinement.refined(q, images[-1:], CAMERA, POSES[-1:], 0), q)


def test_no_step_is_longer_than_allowed_and_none_goes_behind_infinity() -> None:
    far_off = _exact() * np.float32(1.3)
    step_px = _shift_px(_exact() + refinement.refined(far_off, _images(), CAMERA, POSES, 8) - far_off)
    assert 0.3 < step_px.max() < refinement.LARGEST_STEP_PX * 1.3  # a pixel is worth less parallax farther away
    noise = np.random.default_rng(5).uniform(0, 255, (9, 64, 80)).astype(np.float32)
    assert refinement.refined(np.zeros((64, 80), np.float32), noise, CAMERA, POSES, 8).min() >= 0


def test_frames_that_look_back_or_elsewhere_have_no_say() -> None:
    poses = POSES.copy()
    poses[0, :3, :3] = np.diag([-1.0, 1.0, -1.0])
    found = refinement.refined(_exact(), _images(), CAMERA, poses, 8)
    np.testing.assert_allclose(found, refinement.refined(_exact(), _images()[1:], CAMERA, POSES[1:], 7), rtol=1e-6)
