"""TUM RGB-D, EuRoC and COLMAP give the clips that the files were written from."""

import pickle
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.data.doctor import Doctor
from geovp_classic.data.findings import RAISE
from geovp_classic.data.formats import pose_files
from geovp_classic.data.layouts import detection
from geovp_classic.data.layouts.colmap import Colmap
from geovp_classic.data.layouts.euroc import Euroc
from geovp_classic.data.layouts.tum import Tum
from geovp_classic.data.recordings.windows import FrameRange
from geovp_classic.errors import BadData
from geovp_classic.odometry.recorded_odometry import RecordedOdometry
from geovp_classic.types import Clip, Intrinsics

Write = Callable[..., Path]
Edit = Callable[[Path, int, str], None]
CUT = {"num_frames": 4, "stride": 4, "size_px": (64, 64)}


def numbers_of(clip: Clip) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy."""
    camera = clip.intrinsics
    return camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px


def assert_same(clip: Clip, street: Clip, first: int) -> None:
    """Check that the clip is frames first to first + 3 of the street."""
    steps = slice(first, first + 4)
    np.testing.assert_array_equal(clip.frames, street.frames[steps])
    np.testing.assert_allclose(
        clip.trajectory.world_from_cam, street.trajectory.world_from_cam[steps], atol=1e-7
    )
    np.testing.assert_allclose(np.diff(clip.times_s), 0.1, atol=1e-6)
    np.testing.assert_allclose(numbers_of(clip), numbers_of(street), atol=1e-9)


def test_tum_matches_images_poses_and_depths(
    tmp_path: Path, write_tum: Write, street: Clip
) -> None:
    write_tum(tmp_path, "street", street)
    data = Tum(tmp_path, intrinsics=numbers_of(street), **CUT)
    assert data.clip_names == ("street/000000", "street/000004", "street/000008")
    clip = data[1]
    assert_same(clip, street, 4)
    assert clip.times_s[0] == pytest.approx(100.4)
    assert clip.trajectory.is_metric
    near = street.depths[4:8] < 13
    np.testing.assert_allclose(
        clip.depths[near], street.depths[4:8][near], atol=1.01e-4
    )  # half of 1/5000 m
    assert not clip.depths[~near].any()


def test_tum_poses_beyond_the_time_limit_are_dropped(
    tmp_path: Path, write_tum: Write, street: Clip
) -> None:
    """Poses are 4 ms after the images and depths 6 ms before."""
    folder = write_tum(tmp_path, "street", street)
    settings = {"intrinsics": numbers_of(street), **CUT}
    clip = Tum(folder, max_difference_s=0.005, **settings)[0]
    assert not clip.depths.any()
    with pytest.raises(BadData, match="street: none of 12 images has a pose"):
        Tum(folder, max_difference_s=0.003, **settings)
    findings = Doctor().examine(folder, {"max_difference_s": 0.003}).findings
    assert any("none of 12 images" in str(each) for each in findings)
    (folder / "groundtruth.txt").unlink()
    assert Tum(folder, **settings)[0].trajectory is None


def test_tum_cameras_follow_from_the_name(tmp_path: Path, write_tum: Write, street: Clip) -> None:
    folders = [write_tum(tmp_path, name, street) for name in ("freiburg3_office", "freiburg1_desk")]
    _, data = detection.detect(tmp_path)
    (camera, *_) = data.scan(folders[0], RAISE).cameras
    assert camera.pinhole == Intrinsics(535.4, 539.2, 320.1, 247.6, 64, 64)
    (camera, *_) = data.scan(folders[1], RAISE).cameras
    assert camera.distortion == (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
    folder = write_tum(tmp_path, "hall", street)
    with pytest.raises(BadData, match="hall has no known camera: give intrinsics"):
        Tum(folder, **CUT)
    with pytest.raises(BadData, match="distortion is given without intrinsics"):
        Tum(folder, distortion=(0.1, 0, 0, 0, 0), **CUT)


def test_euroc_poses_are_those_of_the_camera(
    tmp_path: Path, write_euroc: Write, street: Clip
) -> None:
    grey = replace(street, frames=street.frames[..., :1].repeat(3, axis=3))
    write_euroc(tmp_path, "MH_01", grey)
    data = Euroc(tmp_path, **CUT)
    assert_same(data[2], grey, 8)
    assert data[0].times_s[0] == pytest.approx(1403636579.763555584, abs=1e-6)
    some = Euroc(tmp_path / "MH_01", sequences=("MH_01[2:8)",), **CUT)
    assert some.clip_names == ("MH_01/000002",)
    lens = (-0.3, 0.05, 0.001, 0.0)
    folder = write_euroc(tmp_path, "V1", street, "radial-tangential", lens)
    camera = data.scan(folder, RAISE).cameras[0]
    assert (camera.model, camera.distortion) == ("FULL_OPENCV", lens)


@pytest.mark.parametrize("times_per_s", [1, 1e9])
def test_trajectories_of_slam_systems_fit_clips_of_euroc(
    tmp_path: Path, write_euroc: Write, street: Clip, times_per_s: float
) -> None:
    """ORB-SLAM3 writes stamps in seconds or in nanoseconds, "%.6f", and lacks lost frames."""
    write_euroc(tmp_path, "MH_01", street)
    clip = Euroc(tmp_path, **CUT)[0]
    stamps_s = 1403636579.763555584 + street.times_s
    lines = [f"{s * times_per_s:.6f} {10 * s % 1} 0 0 0 0 0 1" for s in stamps_s[[0, 2, 3]]]
    (tmp_path / "slam.txt").write_text("\n".join(lines))
    odometry = RecordedOdometry(tmp_path / "slam.txt")
    _, tracked = odometry.track(clip.split(3, odometry.needs)[0])
    assert tracked.tolist() == [True, False, True]


@pytest.mark.parametrize("text", [False, True])
def test_colmap_is_broken_at_unregistered_images(
    tmp_path: Path, write_colmap: Write, street: Clip, text: bool
) -> None:
    """Of images 0 to 11, 5 is lost: 0 to 4 and 6 to 11 are pieces, counted without it.

    A mask beside each image, by COLMAP's own naming, is no image.
    """
    folder = write_colmap(tmp_path, "street", street, lost=[5], text=text)
    for path in [*(folder / "images").iterdir()]:
        shutil.copy(path, path.with_name(f"{path.name}.png"))
    data = Colmap(tmp_path / "street", frame_rate_hz=10.0, **{**CUT, "stride": 1})
    assert data.ranges == (FrameRange("street", 0, 5), FrameRange("street", 5, 11))
    assert data.clip_names == tuple(f"street/{first:06d}" for first in (0, 1, 5, 6, 7))
    assert_same(data[1], street, 1)
    assert_same(data[2], street, 6)
    assert data[2].times_s[0] == pytest.approx(0.6)
    assert not data[0].trajectory.is_metric
    assert Colmap(tmp_path, is_metric=True, **CUT)[0].trajectory.is_metric


def test_colmap_is_broken_at_sub_folders(tmp_path: Path, write_colmap: Write, street: Clip) -> None:
    folder = write_colmap(tmp_path, "street", street, text=True)
    images = folder / "images"
    (images / "later").mkdir()
    model = folder / "sparse" / "0" / "images.txt"
    for number in range(7, 12):
        name = f"im{number}.png"
        (images / name).rename(images / "later" / name)
        model.write_text(model.read_text().replace(f" {name}", f" later/{name}"))
    data = Colmap(folder, **CUT)
    assert data.ranges == (FrameRange("street", 0, 7), FrameRange("street", 7, 12))
    assert_same(data[1], street, 7)


@pytest.mark.parametrize("name", ["images", "points3D", "frames"])
def test_colmap_refuses_unusable_models(
    tmp_path: Path, write_colmap: Write, street: Clip, name: str
) -> None:
    """Pycolmap would read 2^60 records beyond the end of a file."""
    folder = write_colmap(tmp_path, "street", street)
    with pytest.raises(BadData, match="expected a positive number"):
        Colmap(folder, frame_rate_hz=0.0, **CUT)
    (folder / "images" / "im3.png").unlink()
    message = r"images: lacks 1 of 12 images of the model, the first being im3\.png: put"
    with pytest.raises(BadData, match=message):
        Colmap(folder, **CUT)
    path = folder / "sparse" / "0" / f"{name}.bin"
    for content in (b"\x07", (2**60).to_bytes(8, "little") + path.read_bytes()[8:]):
        path.write_bytes(content)
        with pytest.raises(BadData, match=rf"{name}\.bin has .* bytes, not as its counts say"):
            Colmap(folder, **CUT)


@pytest.mark.parametrize("name", ["tum", "euroc", "colmap"])
def test_posed_data_sets_are_recognised_and_pickled(
    tmp_path: Path, name: str, street: Clip, request: pytest.FixtureRequest
) -> None:
    folder = request.getfixturevalue(f"write_{name}")(tmp_path, "a", street)
    table = {**CUT, **detection.spec(folder)}
    assert (table["name"], table["root"]) == (name, folder)
    if name == "tum":
        table["intrinsics"] = list(numbers_of(street))
    data = registry.build("datasets", table)
    assert len(pickle.dumps(data)) < 1000
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(data))[0].frames, data[0].frames)
    examined = Doctor().examine(tmp_path, deep=True)
    assert examined.is_sound, examined.findings
    row = examined.rows[0]
    assert (row["sequence"], row["frames"], row["poses"]) == ("a", "12", "12")
    assert (row["length_m"] == "-") is (name == "colmap")
    with pytest.raises(BadData, match="holds no sequence: give a folder with"):
        registry.build("datasets", {**table, "root": str(tmp_path / "empty")})


def test_the_doctor_lists_all_errors(
    tmp_path: Path, write_tum: Write, street: Clip, edit: Edit
) -> None:
    folder = write_tum(tmp_path, "hall", street)
    edit(folder / "rgb.txt", 4, "100.1 rgb/2.png")
    edit(folder / "rgb.txt", 6, "100.4 rgb/44.png")
    cv2.imwrite(str(folder / "rgb" / "9.png"), np.full((20, 30), 3000, np.uint16))
    cv2.imwrite(str(folder / "depth" / "7.png"), np.zeros((20, 30), np.uint16))
    settings = {"intrinsics": numbers_of(street)}
    report = "\n".join(map(str, Doctor().examine(tmp_path, settings, deep=True).findings))
    for message in (
        "depth/7.png: is 30x20 pixels, expected",
        "rgb.txt line 4: 100.1 is not after 100.1 before it",
        "rgb.txt line 6: there is no file 'rgb/44.png'",
        "rgb/9.png: holds uint16 values, expected 8 bits a channel",
    ):
        assert message in report


def test_damaged_files_of_euroc_are_named(
    tmp_path: Path, write_euroc: Write, street: Clip, edit: Edit
) -> None:
    mav0 = write_euroc(tmp_path, "MH", street) / "mav0"
    with pytest.raises(BadData, match=r"mav0/cam1: does not exist: mav0 has cam0"):
        Euroc(tmp_path, camera=1, **CUT)
    for file, line, text, message in (
        ("state_groundtruth_estimate0/data.csv", 3, "1,2,3", "^[^:]*0/data.csv line 3: 3 numbers"),
        ("cam0/sensor.yaml", 2, "T_SB:", "expected .* T_BS of 16 numbers that is a rigid motion"),
        ("cam0/data.csv", 4, "soon,14036.png", r"cam0/data\.csv line 4: 'soon'"),
    ):
        edit(mav0 / file, line, text)
        with pytest.raises(BadData, match=message):
            Euroc(tmp_path, **CUT)


def test_euroc_has_times_in_nanoseconds(tmp_path: Path, write_euroc: Write, street: Clip) -> None:
    path = write_euroc(tmp_path, "MH", street) / "mav0/cam0/data.csv"
    path.write_text(re.sub(r"\d{3},", ",", path.read_text()))
    with pytest.raises(BadData, match="is 100000, as of times in us: give times in ns"):
        Euroc(tmp_path, **CUT)


@pytest.mark.parametrize("posed", [[6], range(0, 12, 2)])
def test_poses_without_two_images_in_a_row_are_an_error(
    posed: Sequence[int], tmp_path: Path, write_colmap: Write, street: Clip
) -> None:
    """One image has a pose, or each second one: no clip can be cut."""
    write_colmap(tmp_path, "a", street, lost=set(range(12)) - set(posed))
    findings = Doctor().examine(tmp_path).findings
    (error,) = [each.message for each in findings if each.severity == "error"]
    assert error.startswith("has no two images in a row with poses")


@pytest.mark.parametrize("separator", ["\t", ", ", ";"])
def test_separators_of_text_files_are_alike(
    separator: str, tmp_path: Path, write_tum: Write, street: Clip
) -> None:
    folder = write_tum(tmp_path, "a", street)
    for path in folder.glob("*.txt"):
        lines = path.read_text().splitlines()
        lines.insert(0, "t x y z qx qy qz qw" if path.stem == "groundtruth" else "time name")
        path.write_text("\n".join(line.replace(" ", separator) for line in lines))
    scan = Tum(tmp_path, **CUT, intrinsics=numbers_of(street)).scan(folder, RAISE)
    assert len(scan.posed) == len(scan.depths) == 12
    assert pose_files.has_times(folder / "groundtruth.txt")
