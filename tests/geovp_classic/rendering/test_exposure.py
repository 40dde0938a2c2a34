"""The exposure of a wall that a camera with known gains drives towards."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from geovp_classic.rendering.exposure import (
    ExposedScene,
    Exposure,
    ExposureControl,
    ExposureEstimator,
    ToneCurve,
)
from geovp_classic.rendering.source import Source
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Trajectory, Views
from tests.geovp_classic.rendering.wall import at, wall

CAMERA = Intrinsics(100.0, 100.0, 63.5, 47.5, 128, 96)
DISTANCE = 10.0
TIMES_S = 0.1 * np.arange(1, 41)
CONTROLLED = Exposure(np.arange(-2.0, 1.0), np.zeros(3), 0.0, np.log(100), confidence=1.0)


def drive(gains: FloatArray) -> tuple[FloatArray, ByteArray]:
    """Return the poses of a drive, 0.4 m a step, and its images with those gains."""
    poses = at(*((0.0, 0.4 * step) for step in range(len(gains))))
    images = [wall(pose, DISTANCE, CAMERA, contrast=25.0)[0][..., 0] for pose in poses]
    return poses, (gains[:, None, None] * np.stack(images) + 0.5).astype(np.uint8)


def estimate(gains: FloatArray, step_s: float = 0.1) -> Exposure:
    poses, images = drive(np.asarray(gains))
    depth = DISTANCE - poses[-1, 2, 3]
    inverse_depth = np.full((CAMERA.height_px, CAMERA.width_px), 1 / depth, np.float32)
    past = Trajectory(poses, step_s * np.arange(len(images)), is_metric=True)
    return ExposureEstimator().estimate(images, CAMERA, past, inverse_depth)


def log_gains(
    exposure: Exposure, coming: int, last: int, level: float, times_s: FloatArray = TIMES_S
) -> FloatArray:
    """Return log gains at those times while uniform images change from one grey to another."""
    histograms = np.eye(256)[coming], np.eye(256)[last]
    control = ExposureControl()
    return np.array([control.log_gain(exposure, float(t), *histograms, level) for t in times_s])


@pytest.mark.parametrize("scale", [1.0, 0.5, 0.1, 0.05])
def test_gains_are_those_of_the_camera(scale: float) -> None:
    gains = scale * np.array([1.3, 0.8, 1.1, 1.0])
    tolerance = 0.01 if scale == 1 else 0.04
    exposure = estimate(gains)
    np.testing.assert_allclose(exposure.log_gains, np.log(gains[-1] / gains), atol=tolerance)


def test_sources_are_as_bright_as_the_last_frame() -> None:
    gains = np.array([1.4, 1.2, 1.0])
    exposure, (poses, images), (_, expected) = estimate(gains), drive(gains), drive(np.ones(3))
    source = Source(np.repeat(images[0, ..., None], 3, axis=-1), CAMERA, poses[0])
    matched = exposure.match(source, 0).frame.astype(float)
    assert np.abs(matched[..., 0] - expected[0]).mean() < 1.5
    means = images.mean(axis=(1, 2))
    assert exposure.log_level == pytest.approx(np.log(means).mean(), abs=0.01)


@pytest.mark.parametrize(("factor", "observed_range"), [(1.0, 0.05), (3.0, 0.05), (3.0, 0.0)])
def test_the_exposure_changes_as_far_as_observed(factor: float, observed_range: float) -> None:
    # The mean of the image falls from 100 to 50, which a free control compensates in 4 s by log 2
    exposure = estimate(np.exp([0.0, observed_range, 0.0, 0.0, 0.0]))
    assert exposure.log_range == pytest.approx(observed_range, abs=0.01)
    control = ExposureControl(max_range_factor=factor)
    histograms = np.eye(256)[50], np.eye(256)[100]
    certain = replace(exposure, confidence=1.0)
    gain = control.log_gain(certain, 4.0, *histograms, np.log(100))
    assert gain == pytest.approx(factor * observed_range, abs=0.03)
    free = replace(certain, log_range=np.inf)
    assert control.log_gain(free, 4.0, *histograms, np.log(100)) > 0.5


def test_a_trend_continues_for_a_moment() -> None:
    exposure = estimate(1.05 ** np.arange(5))
    assert exposure.log_rate_hz == pytest.approx(np.log(1.05) / 0.1, rel=0.1)
    gains = log_gains(replace(exposure, confidence=0.0), 100, 100, np.log(100))
    decay = np.exp(-0.1 / ExposureControl().inertia_s)
    assert 0 < gains[0] < gains[1]
    total = exposure.log_rate_hz * 0.1 * decay / (1 - decay)  # the sum of a geometric series
    np.testing.assert_allclose(gains[20:], total, rtol=0.01)


def test_confidence_is_that_of_a_tenth_of_a_second_at_any_rate() -> None:
    tens, fifties = estimate(1.02 ** np.arange(5)), estimate(1.004 ** np.arange(21), 0.02)
    assert fifties.confidence == pytest.approx(tens.confidence, abs=0.05)


def test_a_control_compensates_a_change_with_a_lag() -> None:
    exposure = estimate(np.array([1.0, 1.2, 0.9, 1.0, 1.0, 1.0]))
    assert exposure.confidence > 0.9
    assert exposure.log_rate_hz == pytest.approx(0.0, abs=0.05)
    gains = log_gains(replace(exposure, log_rate_hz=0.0), 70, 100, np.log(100))
    assert -1e-9 < gains[0] < 0.02  # the change is not yet in the image
    assert 0 < gains[1] < gains[2] < gains[3] < np.log(100 / 70)
    # The mean falls by 30 in 4 s to 70: a first-order control lags by that log rate over its pull.
    lag = 30 / 4 / 70 / ExposureControl().pull_hz
    assert gains[-1] == pytest.approx(np.log(100 / 70) - lag, abs=0.005)


@pytest.mark.parametrize("dt_s", [1e-3, 0.03, 0.5, 1.0, 20.0])
@pytest.mark.parametrize("grey", [70, 120])
def test_control_settles_at_the_level(grey: int, dt_s: float) -> None:
    times_s = np.array([4.0, 20.0]) + dt_s
    gains = log_gains(CONTROLLED, grey, grey, CONTROLLED.log_level, times_s)
    assert gains.max() < 1.3 * np.log(100 / 70)
    assert gains[-1] == pytest.approx(np.log(100 / grey), abs=0.02)


@pytest.mark.parametrize("num_before", [3, 5, 7])
def test_a_jump_changes_the_level_but_is_no_trend(num_before: int) -> None:
    exposure = estimate(np.where(np.arange(8) < num_before, 1.0, 0.5))
    steady = estimate(np.full(8, 0.5))
    np.testing.assert_allclose(exposure.log_gains[:num_before], np.log(0.5), atol=0.01)
    assert exposure.log_rate_hz == pytest.approx(0.0, abs=0.05)
    assert exposure.log_level == pytest.approx(steady.log_level, abs=0.02)
    assert exposure.confidence < 0.05


def test_saturated_pixels_darken_less() -> None:
    curve = ToneCurve()
    greys = np.arange(256.0)
    darker = curve.values(np.log(0.7))
    np.testing.assert_allclose(darker[:230], 0.7 * greys[:230])
    assert darker[255] == pytest.approx(255 * 0.7**curve.saturated_gain_fraction)
    assert (np.diff(curve.values(-0.3)) > 0).all()
    np.testing.assert_array_equal(curve.values(0.0), greys)
    np.testing.assert_allclose(curve.values(np.log(1.5)), np.minimum(1.5 * greys, 255))


@dataclass(frozen=True)
class UniformScene:
    """A scene of the same brightness everywhere and always."""

    grey: int

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        size = (len(world_from_cam), intrinsics.height_px, intrinsics.width_px)
        frames = np.full((*size, 3), self.grey, np.uint8)
        return Views(frames, np.ones(size, bool), np.ones(size, np.float32))


@pytest.mark.parametrize("is_whole", [False, True])
def test_crops_hold_their_last_mean_and_whole_images_the_observed_one(is_whole: bool) -> None:
    # The left half is dark: the right half has a mean of 120, the whole image one of 60, and all
    # observed images one of 90.
    frame = np.zeros((96, 128, 3), np.uint8)
    frame[:, 64:] = 120
    last = Source(frame, CAMERA, np.eye(4))
    exposure = replace(CONTROLLED, log_level=np.log(90))
    scene = ExposedScene(UniformScene(70), last, exposure, ExposureControl(), 7.0, is_whole)
    poses = np.tile(np.eye(4), (40, 1, 1))
    for camera, crop_mean in ((CAMERA.cropped(64, 0, 64, 96), 120), (CAMERA, 60)):
        views = scene.view(poses, 7 + 5 * TIMES_S, camera)
        assert views.frames[-1].mean() == pytest.approx(90 if is_whole else crop_mean, abs=1.5)


def test_black_images_stay_black_and_gains_are_bounded() -> None:
    lively = replace(CONTROLLED, log_rate_hz=50.0, log_level=np.log(200))
    source = Source(np.full((96, 128, 3), 100, np.uint8), CAMERA, np.eye(4))
    scene = ExposedScene(UniformScene(0), source, lively, ExposureControl(), 0.0, is_whole=True)
    assert not scene.view(np.eye(4)[None], np.array([0.1]), CAMERA).frames.any()
    assert log_gains(lively, 1, 1, np.log(200)).max() == ExposureControl().max_log_gain
