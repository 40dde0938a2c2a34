"""Frame screening, and the interpolation of poses without a usable frame."""

import cv2
import numpy as np
import pytest

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.geometry import pinhole, se3
from geovp_classic.observation import recent
from geovp_classic.observation.frame_screening import FrameScreening
from geovp_classic.types import BoolArray, ByteArray, Context, Intrinsics, Trajectory


def usable(frames: ByteArray) -> BoolArray:
    return FrameScreening().usable(np.stack([pinhole.grey8(frame) for frame in frames]))


@pytest.fixture
def film() -> ByteArray:
    """Eight frames of a texture that moves by two pixels a step."""
    texture = np.random.default_rng(0).integers(0, 256, (32, 64), dtype=np.uint8)
    return np.stack(
        [np.repeat(texture[:, 2 * step : 2 * step + 32, None], 3, axis=2) for step in range(8)]
    )


@pytest.mark.parametrize(("value", "steps"), [(0, [3]), (255, [0, 7]), (90, [4, 5])])
def test_blank_frames_are_unusable(film: ByteArray, value: int, steps: list[int]) -> None:
    film[steps] = value
    assert np.flatnonzero(~usable(film)).tolist() == steps


def test_a_stationary_starting_or_stopping_camera_has_no_duplicates(film: ByteArray) -> None:
    assert usable(np.repeat(film[:1], 8, axis=0)).all()
    assert usable(np.concatenate([film[:1], film[:1], film[:6]])).all()
    rolling_out = np.concatenate([film[:5], np.clip(film[4:5], 1, 254), np.clip(film[4:5], 1, 254)])
    assert usable(rolling_out)[:5].all()


def test_context_and_past_lose_the_same_steps(film: ByteArray) -> None:
    film[2] = 0
    poses = se3.exp(np.arange(8.0)[:, None] * [0, 0, 1.0, 0, 0.1, 0])
    past = Trajectory(poses, np.arange(8.0), True)
    camera = Intrinsics(30.0, 30.0, 15.5, 15.5, 32, 32)
    context, recent_past = recent(
        Context(film, np.arange(10.0), camera, past=past), past, "crop", 8
    )
    assert (
        context.times_s.tolist()
        == [*recent_past.times_s.tolist(), 8, 9]
        == [0, 1, 3, 4, 5, 6, 7, 8, 9]
    )
    np.testing.assert_array_equal(context.frames[2], film[3])
    np.testing.assert_array_equal(context.past.world_from_cam, poses[[0, 1, 3, 4, 5, 6, 7]])


@pytest.fixture(scope="module")
def street() -> ByteArray:
    """Ten frames of a drive round a corner."""
    return Synthetic(num_clips=2, num_frames=10, size_px=(96, 96))[1].frames


@pytest.mark.parametrize("cut", [2, 5, 8])
def test_frames_before_a_cut_are_unusable(street: ByteArray, cut: int) -> None:
    frames = street.copy()
    frames[:cut] = frames[:cut, :, ::-1]
    np.testing.assert_array_equal(usable(frames), np.arange(10) >= cut)
    frames[0] = 0  # a black frame more changes nothing
    np.testing.assert_array_equal(usable(frames), np.arange(10) >= cut)


def test_a_turn_one_bad_frame_and_a_jump_of_the_exposure_are_no_cuts(street: ByteArray) -> None:
    assert usable(street).all()
    blurred, torn, dim, new = (street.copy() for _ in range(4))
    new[9] = new[9, :, ::-1]
    blurred[6] = cv2.blur(blurred[6], (31, 1))
    torn[4] = torn[4, :, ::-1]
    dim[5:] = dim[5:] // 4
    for frames in (blurred, torn, dim, new):
        assert usable(frames).all()
