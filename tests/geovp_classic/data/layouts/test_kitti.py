"""KITTI clips: their frames, camera and poses; and errors of a damaged data set."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic.data.layouts.kitti import Kitti
from geovp_classic.data.recordings import splits
from geovp_classic.data.recordings.windows import FrameRange
from geovp_classic.errors import BadData
from geovp_classic.types import Intrinsics

Edit = Callable[[Path, int, str], None]


def kitti(root: Path | str, **settings: object) -> Kitti:
    """Return the data set of clips of 4 frames, 24 pixels wide."""
    return Kitti(root, **{"num_frames": 4, "stride": 4, "size_px": (24, 24), **settings})


def test_frames_come_from_the_preferred_camera_of_each_sequence(kitti_root: Path) -> None:
    data = kitti(str(kitti_root))
    names = [f"{sequence}/{first:06d}" for sequence in ("00", "01") for first in (0, 4, 8)]
    assert list(data.clip_names) == [clip.name for clip in data] == names
    # conftest: grey value 10 * index + 5 * camera; 00 has image_2 and image_3, 01 image_0 alone
    assert data[1].frames[:, 5, 5, 0].tolist() == [50, 60, 70, 80]
    assert data[4].frames[:, 5, 5, 0].tolist() == [40, 50, 60, 70]
    third = kitti(kitti_root, sequences=("00",), camera=3)[0]
    assert third.frames[:, 5, 5, 0].tolist() == [15, 25, 35, 45]


def test_poses_are_those_of_the_camera_shown(kitti_root: Path, edit: Edit) -> None:
    # camera 2 is 6 cm to the left of camera 0, camera 3 is 44 cm to the right; 1 m a frame forwards
    for camera, x_m in ((2, -0.06), (3, 0.44)):
        trajectory = kitti(kitti_root, sequences=("00",), camera=camera)[1].trajectory
        positions = trajectory.world_from_cam[:, :3, 3]
        np.testing.assert_allclose(positions, [[x_m, 0, z_m] for z_m in (4, 5, 6, 7)])
        assert trajectory.is_metric
    # camera 0 turned by 90 degrees to the right: its x axis is the world's -z, so 44 cm to its
    # right is z = -0.44
    edit(kitti_root / "poses" / "00.txt", 2, "0 0 1 0 0 1 0 0 -1 0 0 0")
    trajectory = kitti(kitti_root, sequences=("00",), camera=3)[0].trajectory
    np.testing.assert_allclose(trajectory.world_from_cam[1, :3, 3], [0, 0, -0.44], atol=1e-12)


def test_full_and_right_frames_are_optional(kitti_root: Path) -> None:
    assert kitti(kitti_root)[0].full is None
    assert kitti(kitti_root)[0].right is None
    data = kitti(kitti_root, with_full=True, with_right=True)
    clip = data[0]
    assert clip.full.frames.shape == (4, 24, 64, 3)
    assert clip.right.frames[:, 0, 0, 0].tolist() == [15, 25, 35, 45]
    assert clip.right.intrinsics == clip.full.intrinsics == Intrinsics(50, 50, 31.5, 11.5, 64, 24)
    # camera 3 is 50 cm to the right of camera 2: a point's x is 0.5 less there
    np.testing.assert_allclose(clip.right.view_from_cam[:3, 3], [-0.5, 0, 0])
    assert data[3].right is None  # sequence 01 has no image_1


def test_ranges_limit_the_clips(kitti_root: Path, tmp_path: Path) -> None:
    data = kitti(kitti_root, sequences=("00[2:8)", "01"), stride=2)
    assert data.ranges == (FrameRange("00", 2, 8), FrameRange("01", 0, 12))
    assert data.clip_names[:3] == ("00/000002", "00/000004", "01/000000")
    assert data.split_hash == splits.content_hash(data.ranges)
    (tmp_path / "mine.toml").write_text('ranges = ["01[0:4)"]')
    assert kitti(kitti_root, split=str(tmp_path / "mine.toml")).clip_names == ("01/000000",)


def test_wrong_settings_are_refused_on_construction(kitti_root: Path) -> None:
    wrong: list[tuple[dict[str, object], str]] = [
        ({"sequences": ("07",)}, "no sequence '07': name one of 00, 01"),
        ({"sequences": ("00[0:13)",)}, "sequence 00 has 12 frames"),
        ({"sequences": ("00[0:3)",)}, "has 3 frames without a break, but one clip needs 4"),
        ({"sequences": ("00", "00[4:8)")}, "clip 00/000004 is named twice"),
        ({"sequences": ()}, "no sequence is named"),
        ({"split": "tets"}, "did you mean 'test'"),
        ({"split": "test", "sequences": ("00",)}, "both split 'test' and sequences"),
        ({"camera": 1}, "has no image_1: give a camera of"),
        ({"num_frames": 1}, "num_frames is 1"),
        ({"stride": 0}, "stride is 0"),
        ({"size_px": (8, 9)}, "a square"),
        ({"size_px": (0, 0)}, "a square"),
        ({"root": kitti_root / "poses"}, f"give its root, {kitti_root}$"),
    ]
    for settings, message in wrong:
        with pytest.raises(BadData, match=message):
            kitti(**{"root": kitti_root, **settings})


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("poses/00.txt", "# lost", r"00\.txt: 11 rows for 12 frames"),
        ("sequences/00/times.txt", "", r"times\.txt: 11 rows for 12 frames"),
        ("sequences/00/calib.txt", "P2: 50 9 31 0 0 50 11 0 0 0 1 0", r"P2 is not K \[I | t\]"),
        ("sequences/00/calib.txt", "", r"calib\.txt: has no line 'P2:'"),
    ],
)
def test_a_damaged_text_file_is_named_with_its_line(
    kitti_root: Path, edit: Edit, file: str, text: str, message: str
) -> None:
    edit(kitti_root / file, 3, text)
    with pytest.raises(BadData, match=message):
        kitti(kitti_root)


def test_missing_and_damaged_images_are_named(kitti_root: Path) -> None:
    folder = kitti_root / "sequences" / "00" / "image_2"
    image = folder / "000005.png"
    image.write_bytes(image.read_bytes()[:-20])
    data = kitti(kitti_root)
    assert data[0].name == "00/000000"
    with pytest.raises(BadData, match=r"000005\.png cannot be decoded as an image"):
        data[1]
    cv2.imwrite(str(image), np.zeros((24, 60), np.uint8))
    with pytest.raises(BadData, match=r"000005\.png is 60x24 pixels, expected 64x24"):
        data[1]
