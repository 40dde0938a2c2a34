"""Frame ranges, the starts of clips, and crops whose intrinsics agree with their pixels."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.data.recordings import windows
from geovp_classic.data.recordings.windows import FrameRange, Recording
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import Intrinsics, Trajectory

CAMERA = Intrinsics(10, 10, 3.5, 1.5, 8, 4)


@dataclass(frozen=True)
class Images:
    """Frames in memory."""

    frames: np.ndarray

    def __len__(self) -> int:
        return len(self.frames)

    def read(self, index: int) -> np.ndarray:
        return self.frames[index]


def recording_of(frames: np.ndarray, camera: Intrinsics) -> Recording:
    """Return frames at 10 Hz of a camera that moves along z, 1 m a frame."""
    world_from_cam = np.tile(np.eye(4), (len(frames), 1, 1))
    world_from_cam[:, 2, 3] = np.arange(len(frames))
    times_s = np.arange(len(frames)) / 10
    trajectory = Trajectory(world_from_cam, times_s, is_metric=True)
    return Recording("a", Images(frames), times_s, camera, trajectory, 1.65)


def test_ranges_may_be_open() -> None:
    assert FrameRange.parse(" raw0095 ") == FrameRange("raw0095", 0, None)
    assert str(FrameRange("06").within(51)) == "06[0:51)"
    with pytest.raises(BadData, match="sequence 03 has 300 frames"):
        FrameRange.parse("03[180:360)").within(300)
    for text in (" ", "03[5:5)", "03[7:5)"):
        with pytest.raises(BadData, match="is not a range of frames"):
            FrameRange.parse(text)


@given(
    st.from_regex(r"[a-z0-9_]{1,8}", fullmatch=True), st.integers(0, 10**6), st.integers(1, 10**6)
)
def test_a_range_is_read_as_it_is_written(name: str, first: int, count: int) -> None:
    frames = FrameRange(name, first, first + count)
    assert FrameRange.parse(str(frames)) == frames


def test_names_may_hold_spaces_and_brackets() -> None:
    for name in ("b c", "run [1]", "a[3", "x (2)", "[0:3)"):
        assert FrameRange.parse(name) == FrameRange(name)
        assert FrameRange.parse(f"{name}[3:9)") == FrameRange(name, 3, 9)
    assert FrameRange.parse(" 03 [0:4) ") == FrameRange("03", 0, 4)


@pytest.mark.parametrize(
    ("width_px", "height_px", "side_px", "tolerance_px"),
    [(1242, 375, 256, 0.01), (416, 128, 128, 1e-6), (416, 128, 256, 0.02)],
)
def test_a_corner_lands_where_the_intrinsics_say(
    width_px: int, height_px: int, side_px: int, tolerance_px: float
) -> None:
    corner_u, corner_v = width_px // 2 - 20, height_px // 2 + 13  # the first white column and row
    frames = np.zeros((2, height_px, width_px, 3), np.uint8)
    frames[:, corner_v:, corner_u:] = 255
    camera = Intrinsics(720.0, 715.0, width_px / 2 + 7.3, height_px / 2 - 2.2, width_px, height_px)
    clip = windows.cut(recording_of(frames, camera), 0, 2, (side_px, side_px))
    on_corner = np.array([corner_u - 0.5, corner_v - 0.5])  # between black and white
    point = pinhole.unproject(on_corner, np.array(9.0), camera)
    expected, _ = pinhole.project(point, clip.intrinsics)
    white = clip.frames[0, :, :, 0] / 255.0  # the fraction of a pixel's area that is white
    corner = [side_px - 0.5 - white[-1].sum(), side_px - 0.5 - white[:, -1].sum()]
    np.testing.assert_allclose(corner, expected, atol=tolerance_px)


def test_a_clip_has_the_frames_times_poses_and_depths_of_its_range() -> None:
    """The depth of frames of 8x4 pixels is the column: the middle 4 columns are 2 to 5."""
    frames = np.arange(6)[:, None, None, None] * np.ones((4, 8, 3))
    column = np.tile(np.arange(8.0), (4, 1))
    depths = Images(column + 10 * np.arange(6.0)[:, None, None])
    recording = replace(recording_of(frames.astype(np.uint8), CAMERA), depths=depths)
    clip = windows.cut(recording, 2, 3, (4, 4))
    assert clip.name == "a/000002"
    assert clip.frames[:, 0, 0, 0].tolist() == [2, 3, 4]
    assert clip.times_s.tolist() == [0.2, 0.3, 0.4]
    assert clip.trajectory.world_from_cam[:, 2, 3].tolist() == [2, 3, 4]
    assert clip.camera_height_m == 1.65
    assert clip.intrinsics == Intrinsics(10, 10, 1.5, 1.5, 4, 4)  # columns 2 to 5
    assert clip.depths[1, 0].tolist() == [32, 33, 34, 35]
    stretched = windows.cut(recording, 0, 2, (16, 4), fit="stretch")
    assert stretched.intrinsics == Intrinsics(20, 10, 7.5, 1.5, 16, 4)
    smaller = windows.cut(recording, 0, 2, (4, 4), fit="stretch").depths[0, 0].tolist()
    assert smaller in ([0, 2, 4, 6], [1, 3, 5, 7])  # no means


def test_implausible_recordings_are_refused() -> None:
    images, times_s = Images(np.zeros((5, 4, 8, 3), np.uint8)), np.arange(5.0)
    for arguments, message in (
        ((100 * times_s, CAMERA), "give times in seconds"),
        ((times_s, replace(CAMERA, fx_px=0.1)), "give the calibration in pixels"),
        ((times_s, replace(CAMERA, fx_px=1000)), "expected more than 10"),
    ):
        with pytest.raises(BadData, match=message):
            Recording("a", images, *arguments)


def test_no_piece_crosses_a_break() -> None:
    def pieces(breaks: tuple[int, ...], num_frames: int) -> list[str]:
        return list(map(str, windows.pieces(FrameRange("a", 2, 20), breaks, num_frames)))

    assert pieces((), 5) == ["a[2:20)"]
    assert pieces((1, 8, 10, 20), 5) == ["a[2:8)", "a[10:20)"]
    with pytest.raises(BadData, match="has 7 frames without a break"):
        pieces((8, 15), 9)


@pytest.mark.parametrize(
    ("times_s", "rate_hz", "every", "anchor", "numbers"),
    [
        (np.arange(10) / 25, 10.0, 1, 0, [0, 2, 4, 6, 8]),
        (np.arange(10) / 25, 10.0, 1, 9, [1, 3, 5, 7, 9]),
        (np.arange(10) / 29.97, 10.0, 1, 4, [1, 4, 7]),
        (np.arange(10) / 30, 10.0, 2, 0, [0, 6]),
        (np.arange(4) / 5, 10.0, 1, 0, [0, 1, 2, 3]),
        (np.arange(4) / 5, "native", 3, 0, [0, 3]),
        # six frames at 30 Hz, then three at 10 Hz: of the slow ones, all
        (np.r_[np.arange(7) / 30, 0.3, 0.4, 0.5], 10.0, 1, 0, [0, 3, 6, 7, 8, 9]),
        (np.zeros(0), 10.0, 1, 0, []),
    ],
)
def test_frames_are_used_at_a_rate(
    times_s: np.ndarray, rate_hz: Any, every: int, anchor: int, numbers: list[int]
) -> None:
    assert windows.frames_at_rate(times_s, rate_hz, every, anchor).tolist() == numbers
