"""A folder of images or a video becomes clips with the user's camera, times and poses."""

import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from video_files import grey_levels, write_video

from geovp_classic.data.doctor import Doctor
from geovp_classic.data.formats import pose_files
from geovp_classic.data.layouts.folder import Folder
from geovp_classic.data.recordings.windows import FrameRange
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics, Trajectory

CAMERA = (40.0, 40.0, 31.5, 11.5)


@pytest.fixture
def images(tmp_path: Path) -> Path:
    """Frames f1.png to f12.png of 64x24 pixels, frame k all grey 10 k."""
    folder = tmp_path / "drive"
    folder.mkdir()
    for number in range(1, 13):
        cv2.imwrite(str(folder / f"f{number}.png"), np.full((24, 64), 10 * number, np.uint8))
    (folder / ".f13.png").touch()
    return folder


def folder(path: Path, **settings: object) -> Folder:
    """Return the data set of clips of 4 frames, 24 pixels wide."""
    fixed = {"intrinsics": CAMERA, "num_frames": 4, "stride": 4, "size_px": (24, 24)}
    return Folder(path, **{**fixed, **settings})


def straight(times_s: np.ndarray) -> Trajectory:
    """Return a path along z, 1 m a frame."""
    world_from_cam = np.eye(4)[None].repeat(len(times_s), axis=0)
    world_from_cam[:, 2, 3] = np.arange(len(times_s))
    return Trajectory(world_from_cam, times_s, is_metric=True)


def test_images_become_clips_in_the_order_of_their_numbers(images: Path) -> None:
    data = folder(images, camera_height_m=1.2, with_full=True)
    assert data.clip_names == ("drive/000000", "drive/000004", "drive/000008")
    assert data.ranges == (FrameRange("drive", 0, 12),)
    clip = data[2]
    assert clip.frames[:, 3, 3, 0].tolist() == [90, 100, 110, 120]
    np.testing.assert_allclose(clip.times_s, [0.8, 0.9, 1.0, 1.1])  # 10 Hz unless told
    assert clip.intrinsics == Intrinsics(40, 40, 11.5, 11.5, 24, 24)
    assert clip.full.intrinsics == Intrinsics(*CAMERA, 64, 24)
    assert clip.trajectory is None
    assert clip.camera_height_m == 1.2
    (images / "f10.png").unlink()
    assert folder(images)[1].times_s[-1] == pytest.approx(0.7)
    (images / "f7.png").unlink()
    np.testing.assert_allclose(folder(images)[1].times_s, [0.4, 0.5, 0.7, 0.8])


def test_a_video_has_its_own_rate(video: Path) -> None:
    clip = folder(video, rate_hz="native")[1]
    assert clip.name == "drive/000004"
    np.testing.assert_allclose(clip.frames[:, 3, 3, 0], [40, 50, 60, 70], atol=2)
    np.testing.assert_allclose(clip.times_s, [0.16, 0.20, 0.24, 0.28])
    np.testing.assert_allclose(folder(video)[0].times_s, [0, 0.08, 0.16, 0.24])  # 12.5 of 25 Hz
    np.testing.assert_allclose(folder(video, frame_step=3, num_frames=2)[0].times_s, [0, 0.24])
    assert folder(video, frame_rate_hz=24.0).clip_names == folder(video).clip_names
    with pytest.raises(BadData, match=r"25 frames per second, frame_rate_hz is 5: .* rate_hz = 5"):
        folder(video, frame_rate_hz=5.0)


def test_a_raw_stream_needs_a_rate(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.h264", grey_levels(8, 10, (64, 24)), format="h264")
    with pytest.raises(BadData, match="does not state its rate: give frame_rate_hz"):
        folder(path)
    examination = Doctor().examine(path)
    assert "warning" in [each.severity for each in examination.findings if "rate" in str(each)]
    np.testing.assert_allclose(folder(path, frame_rate_hz=5.0)[0].times_s, [0, 0.2, 0.4, 0.6])


def test_a_tum_trajectory_has_its_own_times(images: Path, tmp_path: Path) -> None:
    path = tmp_path / "tum.txt"
    pose_files.write_tum(path, straight(100 + np.arange(12) * 0.5))
    clip = folder(images, trajectory=path, is_metric=False)[1]
    assert clip.times_s.tolist() == [102, 102.5, 103, 103.5]
    assert clip.trajectory.world_from_cam[:, 2, 3].tolist() == [4, 5, 6, 7]
    assert not clip.trajectory.is_metric
    assert folder(images, trajectory=path, frame_rate_hz=2.0)[0].times_s.tolist() == [
        0,
        0.5,
        1,
        1.5,
    ]


def test_a_kitti_trajectory_has_the_times_of_the_frames(images: Path, tmp_path: Path) -> None:
    poses, times = tmp_path / "kitti.txt", tmp_path / "times.txt"
    pose_files.write_kitti(poses, straight(np.arange(12)))
    np.savetxt(times, np.arange(12) * 0.25)
    clip = folder(images, trajectory=poses, times=times)[2]
    np.savetxt(images / "times.txt", np.arange(12) * 0.5)  # in the folder, by its name
    assert folder(images, times="times.txt")[0].times_s.tolist() == [0, 0.5, 1, 1.5]
    assert clip.trajectory.times_s.tolist() == clip.times_s.tolist() == [2, 2.25, 2.5, 2.75]
    assert folder(images, trajectory=poses)[0].times_s.tolist() == [0, 0.1, 0.2, 0.3]
    for write in (pose_files.write_tum, pose_files.write_kitti):
        write(poses, straight(np.arange(11)))
        with pytest.raises(BadData, match="11 poses for 12 frames, expected one each"):
            folder(images, trajectory=poses)


def test_wrong_settings_are_refused(images: Path, tmp_path: Path) -> None:
    assert folder(images, sequences=("drive[3:8)",)).clip_names == ("drive/000003",)
    times = tmp_path / "times.txt"
    times.write_text("0\n1\n")
    wrong: list[tuple[dict[str, object], str]] = [
        ({"frame_rate_hz": 1e-8}, "expected a number of at least 0.02"),
        ({"times": str(times)}, "2 rows for 12 frames"),
        ({"times": times, "frame_rate_hz": 1.0}, "both frame_rate_hz and times"),
        ({"trajectory": tmp_path / "none.txt"}, r"none\.txt: does not exist"),
    ]
    for settings, message in wrong:
        with pytest.raises(BadData, match=message):
            folder(images, **settings)


def test_a_path_without_frames_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("text")
    for path, message in (
        (tmp_path / "none", "cannot be listed .*: give a video or a folder of images"),
        (tmp_path, "holds no sequence: give a folder of images"),
        (tmp_path / "transforms.json", "is not read: .* give the COLMAP model"),
        (tmp_path / "text.mp4", "cannot be decoded as a video"),
    ):
        with pytest.raises(BadData, match=message):
            folder(path)


def test_folders_in_a_folder_are_sequences(
    images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sequence b 2 has 8 images at 5 Hz, the drive of the fixture 12 at 10 Hz, texts has none."""
    shutil.copytree(images, tmp_path / "lost+found")  # which cannot be read
    monkeypatch.setattr(os, "access", lambda path, _: path.name != "lost+found")
    (tmp_path / "b 2").mkdir()
    (tmp_path / "texts").mkdir()
    for number in range(8):
        cv2.imwrite(str(tmp_path / "b 2" / f"{number}.png"), np.full((24, 64), number, np.uint8))
    for path, times_s in ((tmp_path / "b 2", np.arange(8) / 5), (images, np.arange(12) / 10)):
        np.savetxt(path / "times.txt", times_s)
        pose_files.write_kitti(path / "poses.txt", straight(times_s))
    data = folder(tmp_path, times="times.txt", trajectory="poses.txt")
    names = ("b 2/000000", "b 2/000004", "drive/000000", "drive/000004", "drive/000008")
    assert data.clip_names == names
    np.testing.assert_allclose(data[1].times_s, [0.8, 1.0, 1.2, 1.4])
    assert data[1].frames[:, 0, 0, 0].tolist() == [4, 5, 6, 7]
    assert data[4].trajectory is not None
    assert folder(images).split_hash == "" != data.split_hash  # of one sequence
    with pytest.raises(BadData, match=r"b 2/none\.txt: does not exist"):
        folder(tmp_path, trajectory="none.txt")


def test_several_series_in_a_folder_are_refused_or_chosen(images: Path) -> None:
    """Frames f1 to f12 lie beside masks m1 to m12, which would alternate with them in a video."""
    for number in range(1, 13):
        cv2.imwrite(str(images / f"m{number}.png"), np.zeros((24, 64), np.uint8))
    with pytest.raises(BadData, match=r"2 series .* f\*\.png \(12 images\), m\*\.png"):
        folder(images)
    cv2.imwrite(str(images / "f1_mask.png"), np.zeros((24, 64), np.uint8))
    clip = folder(images, name_pattern="f*.png")[0]  # as the message advises
    assert clip.frames[1, 3, 3, 0] == 20
    with pytest.raises(BadData, match="no image called x"):
        folder(images, name_pattern="x*")
    assert not Doctor().examine(images).is_sound


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("1.png", "01.png", "2.png"), "have the same number"),
        (("f1.png", "f1 (copy).png", "f2.png"), "have the same number|2 series"),
        (("f1.png", "f1 (2).png", "f2.png"), r'same number: .* name_pattern = "f\*.png"'),
        (("f1.png", "f1_depth16.png", "f2.png", "f2_depth16.png"), "have the same number"),
        (("f1.png", "f2.png", "f1.jpg", "f2.jpg"), "2 series"),
        (tuple(f"{n}_{k}.png" for n in "789" for k in "12"), r'name_pattern = "\*_1.png" or'),
        (tuple(f"cam{k}_{n}.png" for k in "01" for n in "123"), r'"cam0_\*.png" or "cam1_\*.png"'),
        (tuple(f"{7919 * n:x}.png" for n in range(40)), "no common form"),  # hexadecimal
        (tuple(f"DSC0{n}.png" for n in (9998, 9999, "0001")), "a counter began again"),
        (("10.5.png", "10.25.png", "10.75.png"), "decimal numbers"),
        (("1.0e+00.png", "1.0e-01.png", "2.0e-01.png"), "decimal numbers"),
    ],
)
def test_ambiguous_orders_are_refused(names: tuple[str, ...], message: str, tmp_path: Path) -> None:
    for name in names:
        cv2.imwrite(str(tmp_path / name), np.zeros((24, 64), np.uint8))
    with pytest.raises(BadData, match=message):
        folder(tmp_path, num_frames=2)


def test_unambiguous_names_are_sorted(tmp_path: Path) -> None:
    for order in (
        ("a.png", "b.png", "c.png"),
        ("9.png", "10.png", "100.jpg"),
        ("000.png", "500.png", "999.png"),
        ("1305.175304.png", "1305.275304.png", "1306.075304.png"),
        ("t-1 x2.png", "t-1 x10.png", "t-2 x1.png"),
        ("cam1_2.png", "cam1_10.png", "cam1_11.png"),
        ("cam1_2024.png", "cam2_2024.png", "cam10_2024.png"),
        ("cam_20261129_1.png", "cam_20261129_2.png", "cam_20261130_1.png", "cam_20261130_2.png"),
    ):
        place = tmp_path / order[0]
        place.mkdir()
        for number, name in enumerate(order):
            cv2.imwrite(str(place / name), np.full((24, 64), 50 * number, np.uint8))
        clip = folder(place, num_frames=3)[0]
        np.testing.assert_allclose(clip.frames[:, 3, 3, 0], [0, 50, 100], atol=2)
