"""Frame ranges, the starts of clips, and crops whose intrinsics agree with their pixels."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.data import windows
from geovp_classic.data.windows import FrameRange, Recording, SideCamera
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import Intrinsics, Trajectory


@dataclass(frozen=True)
class Images:
    """Frames in memory."""

    frames: np.ndarray

    def __len__(self) -> int:
        return len(self.frames)

    def read(self, index: int) -> np.ndarray:
        return self.frames[index]


def recording_of(
    frames: np.ndarray, camera: Intrinsics, right: SideCamera | None = None
) -> Recording:
    """Return frames at 10 Hz of a camera that moves along z, 1 m a frame."""
    count = len(frames)
    world_from_cam = np.eye(4)[None].repeat(count, axis=0)
    world_from_cam[:, 2, 3] = np.arange(count)
    times_s = np.arange(count) / 10
    trajectory = Trajectory(world_from_cam, times_s, is_metric=True)
    return Recording("a", Images(frames), times_s, camera, trajectory, 1.65, right)


def test_ranges_include_the_first_and_exclude_the_last_frame() -> None:
    assert FrameRange.parse("03[180:360)") == FrameRange("03", 180, 360)
    assert FrameRange.parse(" raw0095 ") == FrameRange("raw0095", 0, None)
    assert str(FrameRange("06").within(51)) == "06[0:51)"
    with pytest.raises(BadData, match="sequence 03 has 300 frames"):
        FrameRange.parse("03[180:360)").within(300)


@given(
    st.from_regex(r"[a-z0-9_]{1,8}", fullmatch=True), st.integers(0, 10**6), st.integers(1, 10**6)
)
def test_a_range_is_read_as_it_is_written(name: str, first: int, count: int) -> None:
    frames = FrameRange(name, first, first + count)
    assert FrameRange.parse(str(frames)) == frames


@pytest.mark.parametrize(
    "text",
    ["03[180:360]", "03[180,360)", "03[:360)", "[0:3)", "", "03[5:5)", "03[9:5)", "03 [0:4)"],
)
def test_other_notations_of_a_range_are_refused(text: str) -> None:
    with pytest.raises(BadData, match=r"first|expected"):
        FrameRange.parse(text)


def test_clips_start_every_stride_and_end_inside() -> None:
    # 51 frames, clips of 30: the last one that fits starts at 21
    assert list(windows.starts(FrameRange("06", 0, 51), 30, 10)) == [0, 10, 20]
    assert list(windows.starts(FrameRange("03", 180, 210), 30, 10)) == [180]
    with pytest.raises(BadData, match=r"03\[180:209\) has 29 frames, but one clip needs 30"):
        windows.starts(FrameRange("03", 180, 209), 30, 10)


@given(st.integers(0, 50), st.integers(2, 60), st.integers(2, 20), st.integers(1, 9))
def test_clips_fill_their_range(first: int, count: int, num_frames: int, stride: int) -> None:
    if count < num_frames:
        return
    begun = windows.starts(FrameRange("a", first, first + count), num_frames, stride)
    assert begun[0] == first
    assert begun[-1] + num_frames <= first + count < begun[-1] + stride + num_frames


def test_settings_without_clips_are_refused() -> None:
    for num_frames, stride, size_px, message in (
        (1, 1, (8, 8), "num_frames is 1"),
        (2, 0, (8, 8), "stride is 0"),
        (2, 1, (8, 9), "a square"),
        (2, 1, (0, 0), "a square"),
    ):
        with pytest.raises(BadData, match=message):
            windows.check_protocol(num_frames, stride, size_px)


@pytest.mark.parametrize(
    ("native_px", "side_px", "tolerance_px"),
    [
        ((1242, 375), 256, 0.01),
        ((1226, 370), 256, 0.01),
        ((416, 128), 128, 1e-6),
        ((416, 128), 256, 0.02),
    ],
)
def test_a_corner_lands_where_the_intrinsics_say(
    native_px: tuple[int, int], side_px: int, tolerance_px: float
) -> None:
    width_px, height_px = native_px
    corner_u, corner_v = width_px // 2 - 20, height_px // 2 + 13  # the first white column and row
    frame = np.zeros((height_px, width_px, 3), np.uint8)
    frame[corner_v:, corner_u:] = 255
    camera = Intrinsics(720.0, 715.0, width_px / 2 + 7.3, height_px / 2 - 2.2, width_px, height_px)
    clip = windows.cut(
        recording_of(frame[None].repeat(2, axis=0), camera), 0, 2, (side_px, side_px)
    )
    on_corner = np.array([corner_u - 0.5, corner_v - 0.5])  # between black and white
    expected, _ = pinhole.project(
        pinhole.unproject(on_corner, np.array(9.0), camera), clip.intrinsics
    )
    white = clip.frames[0, :, :, 0] / 255.0  # the share of a pixel's area that is white
    found = [side_px - 0.5 - white[-1].sum(), side_px - 0.5 - white[:, -1].sum()]
    np.testing.assert_allclose(found, expected, atol=tolerance_px)


def test_a_clip_has_the_frames_times_poses_and_views_of_its_range() -> None:
    camera = Intrinsics(10, 10, 3.5, 1.5, 8, 4)
    frames = np.arange(6, dtype=np.uint8)[:, None, None, None] * np.ones((1, 4, 8, 3), np.uint8)
    right_from_cam = np.eye(4)
    right_from_cam[0, 3] = -0.5
    recording = recording_of(
        frames, camera, SideCamera(Images(frames + 100), camera, right_from_cam)
    )
    clip = windows.cut(recording, 2, 3, (4, 4), with_full=True)
    assert clip.name == "a/000002"
    assert clip.frames.shape == (3, 4, 4, 3)
    assert clip.frames[:, 0, 0, 0].tolist() == [2, 3, 4]
    assert clip.times_s.tolist() == [0.2, 0.3, 0.4]
    assert clip.trajectory.world_from_cam[:, 2, 3].tolist() == [2, 3, 4]
    assert clip.camera_height_m == 1.65
    assert clip.intrinsics == Intrinsics(10, 10, 1.5, 1.5, 4, 4)  # columns 2 to 5
    assert clip.full.frames.shape == (3, 4, 8, 3)
    assert clip.full.intrinsics == camera
    np.testing.assert_array_equal(clip.full.view_from_cam, np.eye(4))
    assert clip.right.frames[:, 0, 0, 0].tolist() == [102, 103, 104]
    np.testing.assert_array_equal(clip.right.view_from_cam, right_from_cam)
    assert windows.cut(recording, 2, 3, (4, 4)).full is None


def test_a_recording_has_one_time_and_one_pose_a_frame() -> None:
    camera = Intrinsics(10, 10, 3.5, 1.5, 8, 4)
    frames = np.zeros((5, 4, 8, 3), np.uint8)
    with pytest.raises(BadData, match="a: 4 times for 5 frames"):
        Recording("a", Images(frames), np.arange(4.0), camera)
    with pytest.raises(BadData, match="a: 3 right frames for 5 frames"):
        recording_of(frames, camera, SideCamera(Images(frames[:3]), camera, np.eye(4)))


def test_times_in_milliseconds_and_impossible_cameras_are_refused() -> None:
    camera = Intrinsics(10, 10, 3.5, 1.5, 8, 4)
    frames = Images(np.zeros((5, 4, 8, 3), np.uint8))
    with pytest.raises(BadData, match="give times in seconds"):
        Recording("a", frames, 100 * np.arange(5.0), camera)
    for wrong in ({"fx_px": 0.1}, {"cx_px": 100.0}):
        with pytest.raises(BadData, match="give the calibration in pixels"):
            Recording("a", frames, np.arange(5.0), replace(camera, **wrong))


def test_no_piece_crosses_a_break() -> None:
    whole = FrameRange("a", 2, 20)
    assert windows.pieces(whole, (), 5) == [whole]
    assert windows.pieces(whole, (1, 8, 10, 20), 5) == [
        FrameRange("a", 2, 8),
        FrameRange("a", 10, 20),
    ]
    assert windows.pieces(whole, (8, 15), 9) == [
        FrameRange("a", 8, 15)
    ]  # none is long enough: the longest


def test_depths_are_cropped_and_resized_with_the_frames() -> None:
    """The depth of frames of 8x4 pixels is the column: the middle 4 columns are 2 to 5."""
    frames = np.zeros((3, 4, 8, 3), np.uint8)
    camera = Intrinsics(5, 5, 3.5, 1.5, 8, 4)
    column = np.tile(np.arange(8.0), (4, 1))
    recording = replace(recording_of(frames, camera), depths=lambda index: column + 10 * index)
    cropped = windows.cut(recording, 1, 2, (4, 4)).depths
    assert cropped[:, 0].tolist() == [[12, 13, 14, 15], [22, 23, 24, 25]]
    whole = windows.cut(recording, 0, 2, (4, 4), fit="stretch").depths
    assert set(whole[0, 0].tolist()) <= set(range(8))  # no means
    assert np.diff(whole[0, 0]).tolist() == [2, 2, 2]
