"""A folder of images or a video becomes clips with the user's camera, times and poses."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.data import pose_files
from geovp_classic.data.folder import Folder
from geovp_classic.data.windows import FrameRange
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
    return folder


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Twelve frames at 25 Hz."""
    path = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25, (64, 24))
    for number in range(1, 13):
        writer.write(np.full((24, 64, 3), 10 * number, np.uint8))
    writer.release()
    return path


def folder(path: Path, **settings: object) -> Folder:
    return Folder(path, CAMERA, **{"num_frames": 4, "stride": 4, "size_px": (24, 24), **settings})


def straight(times_s: np.ndarray) -> Trajectory:
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


def test_paths_may_be_text(images: Path, tmp_path: Path) -> None:
    (tmp_path / "times.txt").write_text("\n".join(str(0.2 * step) for step in range(12)))
    data = Folder(
        str(images), CAMERA, times=str(tmp_path / "times.txt"), num_frames=4, size_px=(24, 24)
    )
    np.testing.assert_allclose(data[0].times_s, [0.0, 0.2, 0.4, 0.6])


def test_a_video_has_its_own_rate(video: Path) -> None:
    data = folder(video)
    clip = data[1]
    assert clip.name == "drive/000004"
    np.testing.assert_allclose(clip.frames[:, 3, 3, 0], [50, 60, 70, 80], atol=2)
    np.testing.assert_allclose(clip.times_s, [0.16, 0.20, 0.24, 0.28])
    np.testing.assert_allclose(folder(video, frame_rate_hz=5.0)[0].times_s, [0, 0.2, 0.4, 0.6])
    np.testing.assert_array_equal(data[0].frames, folder(video)[0].frames)  # backwards


def test_frames_limit_the_clips(images: Path) -> None:
    assert folder(images, frames=(3, 8)).clip_names == ("drive/000003",)
    for frames, message in {
        (3, 13): "has 12 frames",
        (5, 5): "first < last",
        (3, 6): "one clip needs 4",
    }.items():
        with pytest.raises(BadData, match=message):
            folder(images, frames=frames)


def test_a_tum_trajectory_brings_its_times(images: Path, tmp_path: Path) -> None:
    given = straight(100 + np.arange(12) * 0.5)
    pose_files.write_tum(tmp_path / "tum.txt", given)
    clip = folder(images, trajectory=tmp_path / "tum.txt", is_metric=False)[1]
    assert clip.times_s.tolist() == [102, 102.5, 103, 103.5]
    assert clip.trajectory.world_from_cam[:, 2, 3].tolist() == [4, 5, 6, 7]
    assert not clip.trajectory.is_metric
    assert folder(images, trajectory=tmp_path / "tum.txt", frame_rate_hz=2.0)[
        0
    ].times_s.tolist() == [0, 0.5, 1, 1.5]


def test_a_kitti_trajectory_takes_the_frames_times(images: Path, tmp_path: Path) -> None:
    times_s = np.arange(12) * 0.25
    pose_files.write_kitti(tmp_path / "kitti.txt", straight(times_s))
    (tmp_path / "times.txt").write_text("\n".join(map(str, times_s)))
    clip = folder(images, trajectory=tmp_path / "kitti.txt", times=tmp_path / "times.txt")[2]
    assert clip.trajectory.times_s.tolist() == clip.times_s.tolist() == [2, 2.25, 2.5, 2.75]
    np.testing.assert_allclose(
        folder(images, trajectory=tmp_path / "kitti.txt")[0].times_s, [0, 0.1, 0.2, 0.3]
    )


@pytest.mark.parametrize("write", [pose_files.write_tum, pose_files.write_kitti])
def test_poses_of_the_wrong_length_are_refused(images: Path, tmp_path: Path, write: object) -> None:
    assert callable(write)
    write(tmp_path / "poses.txt", straight(np.arange(11) / 10))
    with pytest.raises(BadData, match=r"poses\.txt: 11 poses for 12 frames, expected one each"):
        folder(images, trajectory=tmp_path / "poses.txt")


def test_wrong_settings_are_refused(images: Path, tmp_path: Path) -> None:
    (tmp_path / "times.txt").write_text("0\n1\n")
    wrong: list[tuple[dict[str, object], str]] = [
        ({"frame_rate_hz": 0.0}, "frame_rate_hz is 0.0"),
        ({"frame_rate_hz": 1e-8}, "expected a number of at least 0.02"),
        ({"times": tmp_path / "times.txt"}, r"times\.txt: 2 times for 12 frames"),
        ({"times": tmp_path / "times.txt", "frame_rate_hz": 1.0}, "both frame_rate_hz and times"),
        ({"trajectory": tmp_path / "none.txt"}, r"none\.txt: does not exist"),
        ({"num_frames": 13}, "has 12 frames, but one clip needs 13"),
    ]
    for settings, message in wrong:
        with pytest.raises(BadData, match=message):
            folder(images, **settings)
    with pytest.raises(BadData, match="principal point outside the images of 64x24"):
        Folder(images, (720.0, 720.0, 610.0, 180.0), num_frames=4)


def test_a_path_that_holds_no_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadData, match="does not exist: give a folder of images or a video file"):
        folder(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadData, match="holds no images"):
        folder(tmp_path / "empty")
    (tmp_path / "text.mp4").write_text("text")
    with pytest.raises(BadData, match="cannot be decoded as a video"):
        folder(tmp_path / "text.mp4")


def test_folders_in_a_folder_are_sequences(images: Path, tmp_path: Path) -> None:
    """Two drives, "b 2" of 8 images at 5 Hz with poses, and the fixture's of 12 at 10 Hz; a folder
    of texts is none.
    """
    (tmp_path / "b 2").mkdir()
    (tmp_path / "texts").mkdir()
    for number in range(8):
        cv2.imwrite(str(tmp_path / "b 2" / f"{number}.png"), np.full((24, 64), number, np.uint8))
    for path, step_s in ((tmp_path / "b 2", 0.2), (images, 0.1)):
        times_s = step_s * np.arange(8 if step_s == 0.2 else 12)
        (path / "times.txt").write_text("".join(f"{time_s}\n" for time_s in times_s))
        pose_files.write_kitti(path / "poses.txt", straight(times_s))
    data = folder(tmp_path, times="times.txt", trajectory="poses.txt")
    assert data.clip_names == (
        "b 2/000000",
        "b 2/000004",
        "drive/000000",
        "drive/000004",
        "drive/000008",
    )
    np.testing.assert_allclose(data[1].times_s, [0.8, 1.0, 1.2, 1.4])
    assert data[1].frames[:, 0, 0, 0].tolist() == [4, 5, 6, 7]
    assert data[4].trajectory is not None
    some = folder(tmp_path, sequences=("drive[0:8)",))
    assert some.clip_names == ("drive/000000", "drive/000004")
    assert some.split_hash != data.split_hash
    assert folder(images).split_hash == ""  # as before there were roots: stored results stay valid
    assert "sequences" not in registry.describe(folder(images))
    for settings, message in (
        (
            {"frames": (0, 4)},
            r'frames is of one sequence: give sequences = \["NAME\[0:4\)"\] in its place',
        ),
        ({"sequences": ("c",)}, "sequence 'c' is not in .*, which holds b 2, drive"),
        ({"trajectory": "none.txt"}, r"b 2/none\.txt: does not exist"),
    ):
        with pytest.raises(BadData, match=message):
            folder(tmp_path, **settings)
