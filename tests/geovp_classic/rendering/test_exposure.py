"""The forecast of exposure, on a painted wall that a camera drives towards with known gains."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.rendering import exposure, patches
from geovp_classic.rendering.exposure import ExposedScene, Exposure, ExposureControl
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views

CAMERA = Intrinsics(100.0, 100.0, 63.5, 47.5, 128, 96)
DISTANCE = 10.0
SECONDS = np.arange(-2.0, 1.0)
TIMES_S = 0.1 * np.arange(1, 41)


def paint(pose: FloatArray, gain: float = 1.0) -> ByteArray:
    """A wall of stripes and waves, about 100 bright, as a camera with that gain sees it."""
    reach = (DISTANCE - pose[2, 3]) / pinhole.rays(CAMERA)[..., 2]
    place = pose[:3, 3] + reach[..., None] * (pinhole.rays(CAMERA) @ pose[:3, :3].T)
    wall = 100 + 25 * np.sin(1.3 * place[..., 0]) + 20 * np.cos(1.7 * place[..., 1])
    return np.repeat((gain * wall + 0.5)[..., None], 3, axis=-1).astype(np.uint8)


def drive(gains: FloatArray) -> tuple[list[patches.Source], FloatArray, FloatArray]:
    """Sources with those gains, the inverse depth of the last one, and their times; 0.1 s and 0.4 m
    from one on.
    """
    z = 0.4 * np.arange(len(gains))
    poses = se3.compose(np.eye(3), np.stack([0 * z, 0 * z, z], axis=-1))
    sources = [
        patches.Source(paint(pose, gain), CAMERA, pose)
        for pose, gain in zip(poses, gains, strict=True)
    ]
    inverse_depth = np.full((CAMERA.height_px, CAMERA.width_px), 1 / (DISTANCE - z[-1]), np.float32)
    return sources, inverse_depth, 0.1 * np.arange(1 - len(gains), 1)


@dataclass(frozen=True)
class Grey:
    """The same brightness everywhere and always."""

    value: int

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        size = (len(world_from_cam), intrinsics.height_px, intrinsics.width_px)
        return Views(
            np.full((*size, 3), self.value, np.uint8),
            np.ones(size, bool),
            np.ones(size, np.float32),
        )


def test_gains_are_those_of_the_camera() -> None:
    gains = np.array([1.3, 0.8, 1.1, 1.0])
    found = Exposure.of(*drive(gains))
    np.testing.assert_allclose(found.log_gains, np.log(gains[-1] / gains), atol=0.01)


def gains(
    found: Exposure, brightness: int, last: int, level: float, times_s: FloatArray = TIMES_S
) -> FloatArray:
    """Log gains of images that would be so bright at those times, after a last one of another
    brightness.
    """
    coming, seen = np.eye(256)[brightness], np.eye(256)[last]
    return np.array(
        [ExposureControl().log_gain(found, float(at_s), coming, seen, level) for at_s in times_s]
    )


def test_a_fixed_exposure_stays_as_it_is() -> None:
    sources, inverse_depth, seconds = drive(np.ones(5))
    found = Exposure.of(sources, inverse_depth, seconds)
    assert found.confidence < 0.05
    np.testing.assert_allclose(gains(found, 60, 100, np.log(100), TIMES_S[:1]), 0, atol=0.01)
    alone = Exposure.of(sources[-1:], inverse_depth, seconds[-1:])
    np.testing.assert_array_equal(gains(alone, 60, 100, np.log(100), TIMES_S[:1]), 0)


def test_a_trend_goes_on_for_a_moment_and_no_longer() -> None:
    found = Exposure.of(*drive(1.05 ** np.arange(5)))
    assert found.log_rate_hz == pytest.approx(np.log(1.05) / 0.1, rel=0.1)
    steady = replace(found, confidence=0.0)
    told = gains(steady, 100, 100, np.log(100))
    lasting = np.exp(-0.1 / ExposureControl().inertia_s)
    assert 0 < told[0] < told[1]
    np.testing.assert_allclose(
        told[20:], found.log_rate_hz * 0.1 * lasting / (1 - lasting), rtol=0.01
    )


def test_the_control_of_a_lively_camera_takes_a_change_back() -> None:
    found = Exposure.of(*drive(np.array([1.0, 1.2, 0.9, 1.0, 1.0, 1.0])))
    assert found.confidence > 0.9
    assert found.log_rate_hz == pytest.approx(0.0, abs=0.05)
    told = gains(found, 70, 100, np.log(100))
    assert 0 <= told[0] < 0.02  # it has not seen the change yet
    assert 0 < told[1] < told[2] < told[3] < np.log(100 / 70)
    # The mean falls by 30 in 4 s, at 70 in the end: a first-order control lags by that log rate
    # over its pull.
    assert told[-1] == pytest.approx(
        np.log(100 / 70) - 30 / 4 / 70 / ExposureControl().pull_hz, abs=0.005
    )


def test_a_level_that_is_off_is_returned_to() -> None:
    found = Exposure(SECONDS, np.zeros(3), 0.0, np.log(100), confidence=1.0)
    told = gains(found, 120, 120, found.log_level)
    assert told[0] < -0.01
    assert told[-1] == pytest.approx(np.log(100 / 120), abs=0.01)


@pytest.mark.parametrize("dt_s", [1e-3, 0.03, 0.5, 1.0, 20.0])
def test_any_frame_rate_comes_to_rest_at_the_level(dt_s: float) -> None:
    found = Exposure(SECONDS, np.zeros(3), 0.0, np.log(100), confidence=1.0)
    told = gains(found, 70, 70, found.log_level, np.array([4.0, 20.0]) + dt_s)
    assert told.max() < 1.3 * np.log(100 / 70)
    assert told[-1] == pytest.approx(np.log(100 / 70), abs=0.02)


def test_black_images_stay_black_and_gains_bounded() -> None:
    lively = Exposure(SECONDS, np.zeros(3), 50.0, np.log(200), 1.0)
    source = patches.Source(paint(np.eye(4)), CAMERA, np.eye(4))
    black = ExposedScene(Grey(0), source, lively, ExposureControl(), 0.0, whole=True)
    assert not black.view(np.eye(4)[None], np.array([0.1]), CAMERA).frames.any()
    assert gains(lively, 1, 1, np.log(200)).max() == exposure.LARGEST_LOG_GAIN


def test_white_may_have_been_brighter_than_white() -> None:
    ramp = np.arange(256.0)
    np.testing.assert_allclose(exposure.tone_curve(np.log(0.7))[:230], 0.7 * ramp[:230])
    assert exposure.tone_curve(np.log(0.7))[255] == pytest.approx(
        255 * 0.7**exposure.SATURATED_SHARE
    )
    np.testing.assert_array_equal(exposure.tone_curve(0.0), ramp)
    np.testing.assert_allclose(exposure.tone_curve(np.log(1.5)), np.minimum(1.5 * ramp, 255))
    assert (np.diff(exposure.tone_curve(-0.3)) > 0).all()


@pytest.mark.parametrize("value", [0, 100, 254, 255])
@pytest.mark.parametrize("log_gain", [-0.5, -0.01, 0.0, 0.4])
def test_even_images_take_the_tones(value: int, log_gain: float) -> None:
    frame = np.full((9, 12, 3), value, np.uint8)
    assert (
        np.abs(
            exposure.apply_log_gain(frame, log_gain) - exposure.tone_curve(log_gain)[value]
        ).max()
        <= 1
    )


def test_texture_of_white_is_not_enlarged() -> None:
    noisy = np.where(np.indices((40, 40)).sum(axis=0) % 2, 255, 239).astype(np.uint8)
    dark = exposure.apply_log_gain(np.repeat(noisy[..., None], 3, axis=-1), np.log(0.75)).astype(
        float
    )
    assert dark[10:30, 10:30].std() < noisy.std()
    assert dark.mean() > 0.8 * noisy.mean()


def test_frames_are_matched_to_the_last_one() -> None:
    sources, inverse_depth, seconds = drive(np.array([1.4, 0.7, 1.0]))
    same, _, _ = drive(np.ones(3))
    matched = Exposure.of(sources, inverse_depth, seconds).match(sources)
    for one, expected in zip(matched, same, strict=True):
        assert np.abs(one.frame.astype(float) - expected.frame).mean() < 1.5
    detailed = patches.Source(sources[0].frame, CAMERA, np.eye(4), sources[0].frame)
    twice = Exposure(np.zeros(1), np.array([np.log(1.5)]), 0.0, 0.0, 0.0).match([detailed])[0]
    assert twice.detail is not None
    np.testing.assert_array_equal(twice.detail, twice.frame)


def test_a_part_is_held_at_what_it_showed_a_whole_at_what_all_showed() -> None:
    # Left half dark, right half bright: a view of the right half is held at what that half showed
    # in the end, unless
    # the whole images are known: then their mean is held, at the level of all observed ones.
    frame = np.zeros((96, 128, 3), np.uint8)
    frame[:, 64:] = 120
    last = patches.Source(frame, CAMERA, np.eye(4))
    right = CAMERA.cropped(64, 0, 64, 96)
    control = Exposure(SECONDS[-2:], np.zeros(2), 0.0, np.log(90), 1.0)
    poses = np.tile(np.eye(4), (40, 1, 1))
    for whole, camera, expected in (
        (False, right, 120),
        (False, CAMERA, 60),
        (True, right, 90),
        (True, CAMERA, 90),
    ):
        views = ExposedScene(Grey(70), last, control, ExposureControl(), 7.0, whole).view(
            poses, 7 + 5 * TIMES_S, camera
        )
        assert views.frames[-1].mean() == pytest.approx(expected, abs=1.5)


def test_the_level_is_the_mean_of_what_was_observed() -> None:
    sources, inverse_depth, seconds = drive(np.array([1.4, 0.7, 1.0]))
    means = [source.frame.mean() for source in sources]
    assert Exposure.of(sources, inverse_depth, seconds).log_level == pytest.approx(
        np.mean(np.log(means)), abs=0.01
    )


@pytest.mark.parametrize("jump", [3, 5, 7])
def test_a_jump_pulls_neither_level_nor_speed(jump: int) -> None:
    sources, inverse_depth, seconds = drive(np.where(np.arange(8) < jump, 1.0, 0.25))
    found = Exposure.of(sources, inverse_depth, seconds)
    assert abs(found.log_level - np.log(sources[-1].frame.mean())) < 0.1
    assert abs(found.log_rate_hz) <= exposure.LARGEST_RATE_HZ


def test_a_control_without_inertia_is_refused() -> None:
    with pytest.raises(BadData, match="must be positive"):
        ExposureControl(inertia_s=0)


def test_past_images_are_as_bright_as_they_were() -> None:
    shown = np.array([1.3, 0.8, 1.1, 1.0])
    sources, inverse_depth, seconds = drive(shown)
    found = Exposure.of(sources, inverse_depth, seconds)
    np.testing.assert_allclose(gains(found, 50, 90, np.log(100), seconds), np.log(shown), atol=0.01)


def test_a_jump_is_no_trend_and_moves_the_level() -> None:
    steady, jumped = (
        Exposure.of(*drive(np.array(gains))) for gains in ([0.5] * 8, [1.0] * 5 + [0.5] * 3)
    )
    np.testing.assert_allclose(jumped.log_gains[:5], np.log(0.5), atol=0.01)
    assert jumped.log_rate_hz == pytest.approx(0.0, abs=0.05)
    assert jumped.log_level == pytest.approx(steady.log_level, abs=0.02)
    assert jumped.confidence < 0.05


@pytest.mark.parametrize("dimmed", [0.5, 0.1, 0.05])
def test_gains_of_dim_images(dimmed: float) -> None:
    gains = dimmed * np.array([1.2, 0.9, 1.0])
    np.testing.assert_allclose(
        Exposure.of(*drive(gains)).log_gains, np.log(gains[-1] / gains), atol=0.04
    )
