"""The synthetic data set: contents of its clips and reproducibility."""

import numpy as np
import pytest

from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.data.synthetic.street import MANOEUVRES
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import Clip, PrivilegedInput

TINY = {"num_clips": 1, "num_frames": 4, "size_px": (48, 48)}


@pytest.fixture(scope="module")
def stereo() -> Clip:
    """Return a tiny clip with all views."""
    return Synthetic(**TINY, with_full=True, with_right=True)[0]


def test_clips_hold_everything_in_the_right_shape(stereo: Clip) -> None:
    assert stereo.name == "seed0-straight/000"
    assert stereo.frames.shape == (4, 48, 48, 3)
    np.testing.assert_allclose(stereo.times_s, [0.0, 0.1, 0.2, 0.3])
    assert stereo.depths.dtype == np.float32
    assert (stereo.depths > 0).all()
    assert stereo.full.frames.shape == stereo.right.frames.shape == (4, 48, 158, 3)
    context, target = stereo.split(2, ~PrivilegedInput.NONE)
    assert context.right is not None
    assert context.camera_height_m == 1.65
    assert target.moving is not None


def test_frames_are_the_middle_of_the_full_frames(stereo: Clip) -> None:
    np.testing.assert_array_equal(stereo.full.frames[:, :, 55:103], stereo.frames)
    assert stereo.full.intrinsics.cropped(55, 0, 48, 48) == stereo.intrinsics
    alone = Synthetic(**TINY)[0]
    np.testing.assert_array_equal(alone.frames, stereo.frames)
    np.testing.assert_array_equal(alone.depths, stereo.depths)
    assert alone.full is None
    assert alone.right is None


def test_the_right_camera_sees_near_things_further_left(stereo: Clip) -> None:
    """Its images are shifted by focal length times 0.54 m over depth."""
    np.testing.assert_allclose(stereo.right.view_from_cam[:3, 3], [-0.54, 0.0, 0.0])
    points = pinhole.unproject(
        pinhole.pixel_grid(stereo.intrinsics), stereo.depths[0], stereo.intrinsics
    )
    known = np.isfinite(stereo.depths[0]) & (stereo.depths[0] < 25)
    in_right = se3.transform(stereo.right.view_from_cam, points[known])
    pixels, _ = pinhole.project(in_right, stereo.right.intrinsics)
    column, row = np.round(pixels).astype(int).T
    ours = stereo.frames[0][known].astype(float)
    matched = np.abs(stereo.right.frames[0][row, column] - ours).mean()
    shifted = np.abs(stereo.right.frames[0][row, np.clip(column + 4, 0, 157)] - ours).mean()
    assert matched < 0.7 * shifted


def test_clips_cycle_through_manoeuvres_then_windows_then_streets() -> None:
    data = Synthetic(num_clips=40, num_frames=30, stride=10)
    assert [data.window(index)[1] for index in range(8)] == list(MANOEUVRES)
    assert data.clip_names[1] == "seed0-left-turn/000"
    assert data.clip_names[9] == "seed0-left-turn/010"
    assert (
        data.clip_names[1 + 8 * 3] == "seed0-left-turn/030"
    )  # frames 30..59: the end of the drive
    assert data.clip_names[1 + 8 * 4] == "seed1000-left-turn/000"
    assert len(set(data.clip_names)) == 40
    assert len(data) == 40


def test_windows_of_one_drive_share_its_poses() -> None:
    data = Synthetic(num_clips=9, num_frames=4, size_px=(16, 16), stride=2, bounce=0.0)
    early, late = data[0], data[8]
    np.testing.assert_allclose(
        early.trajectory.world_from_cam[2:], late.trajectory.world_from_cam[:2], rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(late.times_s[0], 0.2)


@pytest.mark.parametrize(
    "wrong", [{"num_clips": 0}, {"num_frames": 0}, {"stride": 0}, {"size_px": (0, 8)}, {"seed": -1}]
)
def test_impossible_settings_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(BadData, match="synthetic:"):
        Synthetic(**wrong)
