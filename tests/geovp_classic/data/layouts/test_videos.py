"""A folder of videos with a file of cameras: rates, windows, sizes and what the file lacks."""

from pathlib import Path

import numpy as np
import pytest
from video_files import grey_levels, write_video

from geovp_classic import registry
from geovp_classic.data.doctor import Doctor
from geovp_classic.data.layouts import detection
from geovp_classic.data.layouts.videos import Videos
from geovp_classic.errors import BadData

CAMERAS = """
[fast]
fps = 30
fov_deg = 90
kind = "car"
camera_height_m = 1.4
[slow]
intrinsics = [50, 60, 30, 20]
kind = "drone"
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """fast.mp4 has 40 frames of 64x48 at 30 Hz, frame k all grey 5 k; slow.mkv 9 of 48x64 at 8 Hz."""
    write_video(tmp_path / "fast.mp4", grey_levels(40, 5), rate=30)
    write_video(tmp_path / "slow.mkv", grey_levels(9, 20, (48, 64)), rate=8)
    (tmp_path / "cameras.toml").write_text(CAMERAS)
    return tmp_path


def test_the_first_and_the_last_window_of_each_video_are_clips(root: Path) -> None:
    """At 10 of 30 Hz, 5 frames span 13: the last window begins at 40 - 13 = 27."""
    data = Videos(root, num_frames=5, size_px=(32, 32))
    names = ("fast/000000", "fast/000027", "slow/000000", "slow/000004")
    assert (data.clip_names, len(data)) == (names, 4)
    fast, slow = data[1], data[3]
    assert (fast.name, slow.name) == (names[1], names[3])
    np.testing.assert_allclose(fast.frames[:, 3, 3, 0], 5 * np.arange(27, 40, 3), atol=2)
    np.testing.assert_allclose(fast.times_s, np.arange(27, 40, 3) / 30, atol=1e-3)
    np.testing.assert_allclose(slow.frames[:, 3, 3, 0], 20 * np.arange(4, 9), atol=2)
    assert (fast.frames.shape[1:3], slow.frames.shape[1:3]) == ((24, 32), (42, 32))
    assert fast.intrinsics.fx_px == pytest.approx(16)  # 90 degrees: f is W / 2
    assert slow.intrinsics.fx_px == pytest.approx(50 * 32 / 48)
    assert (fast.camera_height_m, slow.camera_height_m) == (1.4, None)
    assert data.strata("slow/000004") == {"kind": "drone"}
    assert len({data.clip_digest(index) for index in range(4)}) == 4


def test_rates_windows_and_steps_are_settings(root: Path) -> None:
    settings = {"root": str(root), "num_frames": 4, "sequences": ["fast"], "size_px": [32, 32]}
    for given, starts in (
        ({"rate_hz": "native"}, [0, 36]),
        ({"frame_step": 2}, [0, 21]),  # 3 steps of 6 frames, and one
        ({"num_windows": 3}, [0, 15, 30]),
        ({"num_windows": 1}, [0]),
    ):
        data = registry.build("datasets", {"name": "videos", **settings, **given})
        assert data.clip_names == tuple(f"fast/{start:06d}" for start in starts), given
    data = Videos(root, num_frames=4, stride=2, sequences=("fast[2:9)",), num_windows="all")
    assert data.clip_names == ("fast/000002", "fast/000004")  # counted among those in use
    np.testing.assert_allclose(data[0].frames[:, 3, 3, 0], 5 * np.arange(6, 18, 3), atol=2)


def test_no_clip_is_cut_across_a_pause(root: Path) -> None:
    """A pause of 3 s after the tenth of 20 frames at 10 Hz: windows of 8 begin at 0, 6 and 12."""
    times_ms = [100 * k + 3000 * (k >= 10) for k in range(20)]
    write_video(root / "slow.mkv", grey_levels(20, 10, (48, 64)), times_ms=times_ms)
    facts = (root / "cameras.toml").read_text()
    (root / "cameras.toml").write_text(facts.replace("fps = 8", ""))
    settings = {"num_frames": 8, "sequences": ("slow",), "size_px": (32, 32)}
    data = Videos(root, num_windows=3, **settings)
    assert data.clip_names == ("slow/000000", "slow/000012")
    data = Videos(root, num_windows="all", stride=2, **settings)
    assert data.clip_names == ("slow/000000", "slow/000002", "slow/000010", "slow/000012")
    with pytest.raises(BadData, match="each clip holds a pause"):
        Videos(root, num_windows=1, **settings | {"num_frames": 11})


def test_the_doctor_and_the_detection_know_the_layout(root: Path) -> None:
    assert detection.detect(root)[0] == "videos"
    examination = Doctor().examine(root)
    assert examination.is_sound
    assert [row["frames"] for row in examination.rows] == ["40", "9"]
    assert [row["calibrated"] for row in examination.rows] == ["f 32 px", "f 50 px"]
    single = Doctor().examine(root / "fast.mp4")
    assert [row["size_px"] for row in single.rows] == ["64x48"]
    (root / "cameras.toml").unlink()
    with pytest.raises(BadData, match="expected one with a table for each video"):
        detection.detect(root)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "[fast]\nfov_deg = 90\n",
            r'not describe slow: add a table for each, such as \["a name"\]',
        ),
        (
            CAMERAS.replace("fps = 30", "fps = 10"),
            "has 30 frames per second, fps is 10: .* rate_hz = 10",
        ),
        (CAMERAS.replace("fov_deg = 90", ""), "fast has a wrong value .* intrinsics"),
        (CAMERAS.replace("90", "180"), "fast has a wrong value"),
        (CAMERAS.replace("90", '"wide"'), "fast has a wrong value"),
        (CAMERAS.replace("50, 60", "50"), "slow has a wrong value"),
        (CAMERAS.replace("50, 60", "-50, 60"), "slow has a wrong value"),
        ("fast = 3\nslow = 3\n", "expected a table for each video"),
        ("[fast", "is not TOML"),
    ],
)
def test_wrong_files_of_cameras_are_refused(content: str, message: str, root: Path) -> None:
    (root / "cameras.toml").write_text(content)
    with pytest.raises(BadData, match=message):
        Videos(root, num_frames=4)


def test_short_videos_and_wrong_settings_are_refused(root: Path) -> None:
    for settings, message in (
        ({"num_frames": 12}, r"slow has 9 frames at rate_hz = 10.0, but one clip needs 12"),
        ({"num_windows": 0}, "expected 1 or more"),
        ({"rate_hz": 0.0}, "expected a number of at least 0.02"),
        ({"frame_step": 0}, "1 or more"),
    ):
        with pytest.raises(BadData, match=message):
            Videos(root, **{"num_frames": 4, **settings})
    write_video(root / "fast.MOV", grey_levels(4))
    with pytest.raises(BadData, match=r"fast\.mp4 has the same name as fast\.MOV: rename one"):
        Videos(root, num_frames=4)
