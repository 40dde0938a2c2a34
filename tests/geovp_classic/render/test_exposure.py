"""The forecast of exposure, on a painted wall that a camera drives towards with known gains."""

from dataclasses import dataclass

import numpy as np
import pytest

from geovp_classic.depth_renderers import DepthFusion
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.render import exposure, surface
from geovp_classic.render.exposure import Exposed, Exposure
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views

CAMERA = Intrinsics(100.0, 100.0, 63.5, 47.5, 128, 96)
DISTANCE = 10.0


def paint(pose: FloatArray, gain: float = 1.0) -> ByteArray:
    """A wall of stripes and waves, about 100 bright, as a camera with that gain sees it."""
    reach = (DISTANCE - pose[2, 3]) / pinhole.rays(CAMERA)[..., 2]
    place = pose[:3, 3] + reach[..., None] * (pinhole.rays(CAMERA) @ pose[:3, :3].T)
    wall = 100 + 25 * np.sin(1.3 * place[..., 0]) + 20 * np.cos(1.7 * place[..., 1])
    return np.repeat((gain * wall + 0.5)[..., None], 3, axis=-1).astype(np.uint8)


def drive(gains: FloatArray) -> tuple[list[surface.Source], FloatArray, FloatArray]:
    """Sources with those gains, the inverse depth of the last one, and their times; 0.1 s and 0.4 m from one on."""
    z = 0.4 * np.arange(len(gains))
    poses = se3.compose(np.eye(3), np.stack([0 * z, 0 * z, z], axis=-1))
    sources = [surface.Source(paint(pose, gain), CAMERA, pose) for pose, gain in zip(poses, gains, strict=True)]
    inverse_depth = np.full((CAMERA.height_px, CAMERA.width_px), 1 / (DISTANCE - z[-1]), np.float32)
    return sources, inverse_depth, 0.1 * np.arange(1 - len(gains), 1)


@dataclass(frozen=True)
class Grey:
    """The same brightness everywhere and always."""

    value: int

    def view(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> Views:
        size = (len(world_from_cam), intrinsics.height_px, intrinsics.width_px)
        return Views(np.full((*size, 3), self.value, np.uint8), np.ones(size, bool), np.ones(size, np.float32))


def test_gains_are_those_of_the_camera() -> None:
    gains = np.array([1.3, 0.8, 1.1, 1.0])
    found = Exposure.of(*drive(gains))
    np.testing.assert_allclose(found.log_gains, np.log(gains[-1] / gains), atol=0.01)


def test_a_fixed_exposure_stays_as_it_is() -> None:
    sources, inverse_depth, seconds = drive(np.ones(5))
    found = Exposure.of(sources, inverse_depth, seconds)
    frames = np.stack([paint(se3.compose(np.eye(3), np.array([0, 0, 3.0])))])
    assert found.held < 0.05
    assert found.forecast(frames, 60.0, np.array([0.1])).mean() == pytest.approx(frames.mean(), rel=0.03)
    alone = Exposure.of(sources[-1:], inverse_depth, seconds[-1:])
    np.testing.assert_array_equal(alone.forecast(frames, 60.0, np.array([0.1])), frames)


def test_a_trend_goes_on_for_a_moment_and_no_longer() -> None:
    found = Exposure.of(*drive(1.05 ** np.arange(5)))
    assert found.log_rate_hz == pytest.approx(np.log(1.05) / 0.1, rel=0.1)
    steady = Exposure(found.log_gains, found.log_rate_hz, held=0.0)
    brightness = steady.forecast(np.full((3, 8, 8, 3), 100, np.uint8), 100.0, np.array([0.1, 1.0, 2.0])).mean((1, 2, 3))
    whole = np.exp(found.log_rate_hz * exposure.MEMORY_S)
    assert 100 < brightness[0] < 100 * whole
    np.testing.assert_allclose(brightness[1:], 100 * whole, atol=0.6)


def test_the_control_of_a_lively_camera_takes_half_of_a_change_back() -> None:
    found = Exposure.of(*drive(np.array([1.0, 1.1, 0.95, 1.0, 1.0, 1.0])))
    assert found.held == pytest.approx(0.5, abs=0.05)
    assert found.log_rate_hz == pytest.approx(0.0, abs=0.05)
    (exposed,) = found.forecast(np.full((1, 8, 8, 3), 50, np.uint8), 100.0, np.array([1.0]))
    assert exposed.mean() == pytest.approx(50 * 2**found.held, abs=1)


def test_black_pictures_stay_black_and_gains_bounded() -> None:
    lively = Exposure(np.zeros(3), 50.0, 1.0)
    assert not lively.forecast(np.zeros((1, 8, 8, 3), np.uint8), 200.0, np.array([1.0])).any()
    dim = lively.forecast(np.full((1, 8, 8, 3), 40, np.uint8), 250.0, np.array([1.0]))
    assert dim.max() == 40 * exposure.LARGEST_GAIN


def test_frames_are_matched_to_the_last_one() -> None:
    sources, inverse_depth, seconds = drive(np.array([1.4, 0.7, 1.0]))
    same, _, _ = drive(np.ones(3))
    matched = Exposure.of(sources, inverse_depth, seconds).matched(sources)
    for one, expected in zip(matched, same, strict=True):
        assert np.abs(one.frame.astype(float) - expected.frame).mean() < 1.5
    detailed = surface.Source(sources[0].frame, CAMERA, np.eye(4), sources[0].frame)
    twice = Exposure(np.array([np.log(1.5)]), 0.0, 0.0).matched([detailed])[0]
    assert twice.detail is not None
    np.testing.assert_array_equal(twice.detail, twice.frame)


def test_the_level_is_that_of_the_last_frame_in_the_view() -> None:
    # Left half dark, right half bright: a view of the right half only is held at what that half showed.
    frame = np.zeros((96, 128, 3), np.uint8)
    frame[:, 64:] = 120
    last = surface.Source(frame, CAMERA, np.eye(4))
    right = CAMERA.cropped(64, 0, 64, 96)
    scene = Exposed(Grey(60), last, Exposure(np.zeros(2), 0.0, 1.0), np.array([0.1]))
    assert scene.view(np.eye(4)[None], right).frames.mean() == pytest.approx(120, abs=1.5)
    assert scene.view(np.eye(4)[None], CAMERA).frames.mean() == pytest.approx(60, abs=1.5)


def test_an_unknown_way_is_refused() -> None:
    with pytest.raises(BadData, match="expected 'forecast' or 'kept'"):
        DepthFusion(exposure="guessed")  # type: ignore[arg-type]
