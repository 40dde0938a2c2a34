"""TUM RGB-D, EuRoC and COLMAP give the clips that the files were written from."""

import pickle
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from geovp_classic import api, registry
from geovp_classic.data import layouts, scan
from geovp_classic.data.colmap import Colmap
from geovp_classic.data.doctor import Doctor
from geovp_classic.data.euroc import Euroc
from geovp_classic.data.tum import Tum
from geovp_classic.data.windows import FrameRange
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Intrinsics, PrivilegedInput

Write = Callable[..., Path]
CUT = {"num_frames": 4, "stride": 4, "size_px": (64, 64)}


@pytest.fixture(scope="module")
def street() -> Clip:
    return api.open_clip({"name": "synthetic", "num_frames": 12, "size_px": [64, 64]})


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
    context, _ = clip.split(2, PrivilegedInput.PAST_POSES)
    assert context.past_depths is None
    assert clip.split(2, PrivilegedInput.PAST_DEPTHS)[0].past_depths is not None


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
    (folder / "groundtruth.txt").unlink()
    assert Tum(folder, **settings)[0].trajectory is None


def test_tum_cameras_follow_from_the_name(tmp_path: Path, write_tum: Write) -> None:
    grey = np.full((5, 480, 640, 3), 90, np.uint8)
    wide = api.open_clip(
        {"name": "synthetic", "num_frames": 5, "size_px": [64, 64]}
    ).intrinsics.resized(640, 480)
    clip = Clip("grey", grey, np.arange(5) / 30, wide)
    for name in ("rgbd_dataset_freiburg3_office", "rgbd_dataset_freiburg1_desk", "hall"):
        write_tum(tmp_path, name, clip)
    third = Tum(tmp_path, sequences=("rgbd_dataset_freiburg3_office",), with_full=True, **CUT)[
        0
    ].full
    first = Tum(tmp_path, sequences=("rgbd_dataset_freiburg1_desk",), with_full=True, **CUT)[0].full
    assert (third.intrinsics.fx_px, third.intrinsics.cx_px) == (535.4, 320.1)  # no distortion
    zoom = first.intrinsics.fx_px / 517.3
    assert first.intrinsics.fy_px / 516.5 == pytest.approx(zoom)
    assert 1.0 <= zoom < 1.1
    with pytest.raises(BadData, match="is not of freiburg1, 2 or 3 by its name: give intrinsics"):
        Tum(tmp_path, sequences=("hall",), **CUT)
    with pytest.raises(BadData, match="distortion is given without intrinsics"):
        Tum(tmp_path, distortion=(0.1, 0, 0, 0, 0), **CUT)


def test_euroc_poses_are_those_of_the_camera(
    tmp_path: Path, write_euroc: Write, street: Clip
) -> None:
    grey = Clip(
        street.name,
        street.frames[..., :1].repeat(3, axis=3),
        street.times_s,
        street.intrinsics,
        street.trajectory,
    )
    write_euroc(tmp_path, "MH_01", grey)
    data = Euroc(tmp_path, **CUT)
    assert data.clip_names[0] == "MH_01/000000"
    assert_same(data[2], grey, 8)
    assert data[0].times_s[0] == 0
    assert Euroc(tmp_path / "MH_01", sequences=("MH_01[2:8)",), **CUT).clip_names == (
        "MH_01/000002",
    )


@pytest.mark.parametrize("model", ["radial-tangential", "equidistant"])
def test_euroc_is_undistorted(tmp_path: Path, write_euroc: Write, street: Clip, model: str) -> None:
    """A spot on the ray (0.4, 0.3) is distorted by hand and shown where a pinhole sees it."""
    camera = Intrinsics(400, 400, 319.5, 319.5, 640, 640)
    columns, rows = np.meshgrid(np.arange(640.0), np.arange(640.0))
    lens, ray, f, angle = (-0.3, 0.05, 0.0, 0.0), np.array([0.4, 0.3]), camera.fx_px, np.arctan(0.5)
    stretch = {
        "radial-tangential": 1 - 0.3 * 0.5**2 + 0.05 * 0.5**4,
        "equidistant": angle * (1 - 0.3 * angle**2 + 0.05 * angle**4) / 0.5,
    }[model]
    u, v = ray * stretch * f + [camera.cx_px, camera.cy_px]
    image = (250 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 50)).astype(np.uint8)
    frames = np.repeat(image[None, ..., None], 3, axis=3).repeat(4, axis=0)
    write_euroc(tmp_path, "V1", Clip("V1", frames, street.times_s[:4], camera), model, lens)
    clip = Euroc(tmp_path, num_frames=4, size_px=(640, 640))[0]
    weight = clip.frames[0, ..., 0].astype(float)
    found = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
    shown = clip.intrinsics
    np.testing.assert_allclose(found, ray * shown.fx_px + [shown.cx_px, shown.cy_px], atol=0.5)
    assert np.hypot(*(found - [u, v])) > 5


@pytest.mark.parametrize("text", [False, True])
def test_colmap_is_broken_at_unregistered_images(
    tmp_path: Path, write_colmap: Write, street: Clip, text: bool
) -> None:
    """Of images 0 to 11, 5 is lost: 0 to 4 and 6 to 11 are pieces, counted without it."""
    write_colmap(tmp_path, "street", street, lost=[5], text=text)
    data = Colmap(tmp_path / "street", rate_hz=10.0, **{**CUT, "stride": 1})
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


def test_colmap_refuses_unusable_models(tmp_path: Path, write_colmap: Write, street: Clip) -> None:
    folder = write_colmap(tmp_path, "street", street)
    with pytest.raises(BadData, match="expected a positive number"):
        Colmap(folder, rate_hz=0.0, **CUT)
    (folder / "images" / "im3.png").unlink()
    message = r"images: lacks 1 of 12 images of the model, the first being im3\.png: put"
    with pytest.raises(BadData, match=message):
        Colmap(folder, **CUT)
    (folder / "sparse" / "0" / "images.bin").write_bytes(b"\x07")
    with pytest.raises(BadData, match=r"images\.bin has 1 bytes"):
        Colmap(folder, **CUT)


@pytest.mark.parametrize("name", ["images", "points3D", "frames"])
def test_absurd_counts_in_a_colmap_model_are_refused(
    tmp_path: Path, write_colmap: Write, street: Clip, name: str
) -> None:
    """Pycolmap would read 2^60 records beyond the end of a file."""
    path = write_colmap(tmp_path, "street", street) / "sparse" / "0" / f"{name}.bin"
    path.write_bytes((2**60).to_bytes(8, "little") + path.read_bytes()[8:])
    with pytest.raises(BadData, match=rf"{name}\.bin has .* bytes, not as its counts say"):
        Colmap(tmp_path, **CUT)


@pytest.mark.parametrize("name", ["tum", "euroc", "colmap"])
def test_posed_data_sets_are_registered_recognised_and_pickled(
    tmp_path: Path, name: str, street: Clip, request: pytest.FixtureRequest
) -> None:
    request.getfixturevalue(f"write_{name}")(tmp_path, "a", street)
    table = {"name": name, "root": str(tmp_path), "num_frames": 4, "size_px": [64, 64]}
    table |= {"intrinsics": list(numbers_of(street))} if name == "tum" else {"image_bits": 12}
    data = registry.build("datasets", table)
    assert registry.build("datasets", registry.describe(data)) == data
    assert len(pickle.dumps(data)) < 1000
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(data))[0].frames, data[0].frames)
    assert layouts.name_of(tmp_path) == layouts.name_of(tmp_path / "a") == name
    assert layouts.spec(tmp_path / "a") == {"name": name, "root": tmp_path / "a"}
    examined = Doctor().examine(tmp_path, deep=True)
    assert examined.is_sound, examined.findings
    expected = {"sequence": "a", "frames": "12", "size_px": "64x64", "poses": "12"}
    row = examined.rows[0]
    assert row == {**row, **expected, "duration_s": "1.1"}
    assert (row["length_m"] == "-") is (name == "colmap")
    with pytest.raises(BadData, match="no sequence 'b': name one of a"):
        registry.build("datasets", {**table, "sequences": ["b"]})
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadData, match="holds no sequence: give a folder with"):
        registry.build("datasets", {**table, "root": str(tmp_path / "empty")})


def test_the_doctor_lists_all_errors(
    tmp_path: Path,
    write_tum: Write,
    write_euroc: Write,
    street: Clip,
    edit: Callable[[Path, int, str], None],
) -> None:
    folder = write_tum(tmp_path / "tum", "hall", street)
    edit(folder / "rgb.txt", 4, "100.1 rgb/2.png")
    edit(folder / "rgb.txt", 6, "100.4 rgb/44.png")
    edit(folder / "groundtruth.txt", 3, "100.204 0 0 0 0 0 0 2")
    edit(folder / "groundtruth.txt", 10, "100.904 999 0 0 0 0 0 1")
    cv2.imwrite(str(folder / "rgb" / "9.png"), np.zeros((20, 30, 3), np.uint8))
    found = [
        str(finding).removeprefix(f"{folder}/")
        for finding in Doctor().examine(tmp_path / "tum").findings
    ]
    for start in (
        "rgb.txt line 4: time 100.1 is not after 100.1 before it",
        "rgb.txt line 6: there is no file 'rgb/44.png'",
        "groundtruth.txt line 3: the quaternion has length 2, expected 1",
        "rgb/9.png: is 30x20 pixels, but those before are 64x64",
    ):
        assert any(line.startswith(start) for line in found), start
    assert any("m/s from the pose before: more than a car drives" in line for line in found)
    assert any("after the image before, 0.100 s is usual" in line for line in found)
    sensor = write_euroc(tmp_path / "euroc", "MH", street) / "mav0" / "cam0" / "sensor.yaml"
    whole = sensor.read_text()
    for old, new, expected in (
        ("radial-tangential", "fov", "is not a calibration ('fov')"),
        ("T_BS", "T_SB", "sensor.yaml: has no T_BS of 16 numbers that is a rigid motion"),
        ("[64, 64]", "[32, 32]", "MH: has images of 64x64, calibrated for 32x32"),
        ("camera_model: pinhole", "camera_model: omni", "camera_model is 'omni', expected pinhole"),
    ):
        sensor.write_text(whole.replace(old, new))
        assert any(
            expected in str(finding) for finding in Doctor().examine(tmp_path / "euroc").findings
        ), expected


def test_damaged_lists_of_euroc_are_named(
    tmp_path: Path, write_euroc: Write, street: Clip, edit: Callable[[Path, int, str], None]
) -> None:
    mav0 = write_euroc(tmp_path, "MH", street) / "mav0"
    with pytest.raises(BadData, match=r"mav0/cam1: does not exist: mav0 has cam0"):
        Euroc(tmp_path, camera=1, **CUT)
    truth, images = mav0 / "state_groundtruth_estimate0" / "data.csv", mav0 / "cam0" / "data.csv"
    inf = f"1403636579765555584,0,0,0,1,0,0,inf{',0' * 9}"
    for path, line, text, message in (
        (truth, 3, "1403636579765555584,1,2,3", r"data\.csv line 3: 4 numbers, expected 17"),
        (truth, 3, inf, r"data\.csv line 3: 'inf' is not a finite number"),
        (images, 4, "soon,1403636579763555584.png", r"cam0/data\.csv line 4: .* 'soon'"),
    ):
        edit(path, line, text)
        with pytest.raises(BadData, match=message):
            Euroc(tmp_path, **CUT)
    images.write_text("#timestamp [ns],filename\n")
    with pytest.raises(BadData, match=r"cam0/data\.csv: is empty"):
        Euroc(tmp_path, **CUT)


def test_plain_folders_of_images_are_examined(tmp_path: Path, street: Clip) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        for step in range(3):
            cv2.imwrite(str(tmp_path / name / f"{step}.png"), street.frames[step])
    cv2.imwrite(str(tmp_path / "b" / "0.png"), np.full((64, 64), 3000, np.uint16))
    examined = Doctor().examine(tmp_path)
    assert [row["frames"] for row in examined.rows] == ["3", "3"]
    (error,) = (finding for finding in examined.findings if finding.severity == "error")
    assert "0.png: holds uint16 values, expected 8 bits a channel" in str(error)


def test_nearest_times_within_a_difference() -> None:
    others_s = np.array([0.0, 1.0, 1.5])
    times_s = np.array([-0.05, 0.4, 0.95, 1.3, 9.0])
    assert scan.nearest(times_s, others_s, 0.2).tolist() == [0, -1, 1, 2, -1]
    assert scan.nearest(times_s, others_s[:1], 0.4).tolist() == [0, 0, -1, -1, -1]
    assert scan.nearest(times_s, others_s[:0], 9.0).tolist() == [-1] * 5
