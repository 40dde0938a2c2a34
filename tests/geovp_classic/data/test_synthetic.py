"""The synthetic data set: contents of its clips, reproducibility and the cache."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from geovp_classic.data.synthetic import Synthetic
from geovp_classic.data.synthetic import dataset as synthetic
from geovp_classic.data.synthetic.manoeuvres import Manoeuvre
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import Clip, PrivilegedInput

TINY = {"num_clips": 1, "num_frames": 4, "size_px": (48, 48)}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def stereo(cache: Path) -> Clip:
    """Return a tiny clip with all views."""
    return Synthetic(**TINY, with_full=True, with_right=True, cache=cache)[0]


def test_clips_hold_everything_in_the_right_shape(stereo: Clip) -> None:
    assert stereo.name == "seed0-straight/000"
    assert stereo.frames.shape == (4, 48, 48, 3)
    np.testing.assert_allclose(stereo.times_s, [0.0, 0.1, 0.2, 0.3])
    assert stereo.depths.dtype == np.float32
    assert (stereo.depths > 0).all()
    assert stereo.moving is not None
    assert stereo.trajectory.is_metric
    assert stereo.camera_height_m == 1.65
    assert stereo.full.frames.shape == stereo.right.frames.shape == (4, 48, 158, 3)
    everything = (
        PrivilegedInput.PAST_POSES
        | PrivilegedInput.PAST_DEPTHS
        | PrivilegedInput.FULL_FRAMES
        | PrivilegedInput.RIGHT_FRAMES
        | PrivilegedInput.CAMERA_HEIGHT
    )
    context, target = stereo.split(2, everything)
    assert context.right is not None
    assert target.moving is not None


def test_frames_are_the_middle_of_the_full_frames(stereo: Clip, cache: Path) -> None:
    np.testing.assert_array_equal(stereo.full.frames[:, :, 55:103], stereo.frames)
    assert stereo.full.intrinsics.cropped(55, 0, 48, 48) == stereo.intrinsics
    alone = Synthetic(**TINY, cache=cache)[0]
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


def test_the_same_seed_gives_the_same_clip(tmp_path: Path, cache: Path) -> None:
    here, there = (Synthetic(**TINY, cache=folder)[0] for folder in (cache, tmp_path))
    assert np.abs(here.frames.astype(int) - there.frames).max() <= 1
    np.testing.assert_allclose(here.depths, there.depths, rtol=1e-6)


def test_clips_cycle_through_manoeuvres_then_windows_then_streets() -> None:
    data = Synthetic(num_clips=40, num_frames=30, stride=10)
    assert [data.window(index)[1] for index in range(8)] == list(Manoeuvre)
    assert data.clip_name(1) == "seed0-left-turn/000"
    assert data.clip_name(9) == "seed0-left-turn/010"
    assert data.clip_name(1 + 8 * 3) == "seed0-left-turn/030"  # frames 30..59: the end of the drive
    assert data.clip_name(1 + 8 * 4) == "seed1000-left-turn/000"
    assert len({data.clip_name(index) for index in range(40)}) == 40
    assert len(data) == 40


def test_names_do_not_need_rendering(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clips = Synthetic(**{**TINY, "num_clips": 2}, cache=cache)
    names = tuple(clips[index].name for index in range(2))
    monkeypatch.setattr(synthetic, "render_drive", lambda *_: pytest.fail("rendered"))
    assert dataclasses.replace(clips, seed=0, num_frames=5).clip_names == names == clips.clip_names


def test_windows_of_one_drive_share_its_poses(cache: Path) -> None:
    data = Synthetic(num_clips=9, num_frames=4, size_px=(16, 16), stride=2, bounce=0.0, cache=cache)
    early, late = data[0], data[8]
    np.testing.assert_allclose(
        early.trajectory.world_from_cam[2:], late.trajectory.world_from_cam[:2], rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(late.times_s[0], 0.2)


def test_a_second_reading_comes_from_the_cache(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = Synthetic(**TINY, cache=cache)
    first = data[0]

    def refuse(*_: object) -> None:
        raise AssertionError("rendered again")

    monkeypatch.setattr(synthetic, "render_drive", refuse)
    np.testing.assert_array_equal(data[0].frames, first.frames)
    more = dataclasses.replace(data, num_clips=5)  # the same clips, and more of them
    np.testing.assert_array_equal(more[0].frames, first.frames)
    with pytest.raises(AssertionError, match="rendered again"):
        dataclasses.replace(data, noise=9.0)[0]


@pytest.mark.parametrize("damage", ["truncated", "flipped", "empty", "not a zip"])
def test_a_damaged_cache_file_is_rendered_again(tmp_path: Path, damage: str) -> None:
    data = Synthetic(num_clips=1, num_frames=2, size_px=(16, 16), cache=tmp_path)
    good = data[0].frames
    (file,) = tmp_path.rglob("*.npz")
    content = bytearray(file.read_bytes())
    middle = len(content) // 2
    content[middle] ^= 255
    file.write_bytes(
        {
            "truncated": bytes(content[: middle - 100]),
            "flipped": bytes(content),
            "empty": b"",
            "not a zip": b"images",
        }[damage]
    )
    np.testing.assert_array_equal(data[0].frames, good)
    with np.load(file) as stored:
        np.testing.assert_array_equal(stored["frames"], good)
    assert not list(tmp_path.rglob("*.part"))


def test_the_environment_selects_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny = Synthetic(num_clips=1, num_frames=2, size_px=(8, 8))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    monkeypatch.delenv("GEOVP_CACHE", raising=False)
    assert tiny[0].frames.shape == (2, 8, 8, 3)
    assert len(list((tmp_path / "xdg" / "geovp" / "synthetic").rglob("0000.npz"))) == 1
    monkeypatch.setenv("GEOVP_CACHE", str(tmp_path / "own"))
    assert tiny[0].frames.shape == (2, 8, 8, 3)
    assert len(list((tmp_path / "own" / "synthetic").rglob("0000.npz"))) == 1


@pytest.mark.skipif(os.name != "posix", reason="folders below a file")
def test_a_read_only_cache_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadData, match="set GEOVP_CACHE to another folder"):
        Synthetic(num_clips=1, num_frames=2, size_px=(8, 8), cache=tmp_path / "file")[0]


@pytest.mark.parametrize(
    "wrong", [{"num_clips": 0}, {"num_frames": 0}, {"stride": 0}, {"size_px": (0, 8)}, {"seed": -1}]
)
def test_impossible_settings_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(BadData, match="synthetic:"):
        Synthetic(**wrong)


def test_indices_follow_sequences(cache: Path) -> None:
    data = Synthetic(**TINY, cache=cache)
    with pytest.raises(IndexError):
        data[1]
    np.testing.assert_array_equal(data[-1].frames, data[0].frames)
