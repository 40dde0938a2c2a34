"""The archives of KITTI's site that a made-up folder lacks are named."""

from pathlib import Path

import pytest

from geovp_benchmarks import cli
from geovp_benchmarks.checks import kitti_archives


def test_odometry_names_what_each_sequence_lacks(tmp_path: Path) -> None:
    complete = tmp_path / "sequences/00"
    (complete / "image_0").mkdir(parents=True)
    (complete / "calib.txt").touch()
    (tmp_path / "poses").mkdir()
    (tmp_path / "poses/00.txt").touch()
    missing = kitti_archives.missing_odometry
    assert missing(tmp_path, ["00", "mine"]) == []
    assert kitti_archives.ODOMETRY["poses"] not in missing(tmp_path, ["11"])
    assert missing(tmp_path, ["00"], camera=2) == [kitti_archives.ODOMETRY["colour"]]
    assert [row[:2] for row in missing(tmp_path, ["00", "01"])] == [
        ["data_odometry_calib.zip", "1 MB"],
        ["data_odometry_poses.zip", "4 MB"],
        ["data_odometry_gray.zip", "22 GB"],
        ["data_odometry_color.zip", "65 GB"],
    ]


def test_the_drives_of_a_protocol_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    date = tmp_path / "2011_09_26"
    (date / "2011_09_26_drive_0060_sync").mkdir(parents=True)
    assert cli.main(["doctor", str(tmp_path), "--protocol", "fvs20"]) == 1
    printed = capsys.readouterr().out
    rows = [
        [*map(str.strip, line.split("|")[1:4])] for line in printed.splitlines() if "zip" in line
    ]
    date_row, *drives = rows
    assert date_row == ["2011_09_26_calib.zip", "4 kB", "2011_09_26/calib_cam_to_cam.txt"]
    drive = "2011_09_26_drive_0084_sync"
    assert drives[0] == [f"{drive}.zip", "1.6 GB", f"2011_09_26/{drive}"]  # 1,574,584,300 bytes
    assert "drive_0060" not in printed
    for number in (84, 93, 96):
        (date / f"2011_09_26_drive_{number:04d}_sync").mkdir()
    (date / "calib_cam_to_cam.txt").touch()
    assert cli.main(["doctor", str(tmp_path), "--protocol", "fvs20"]) == 0
