"""Cityscapes: snippets, cameras of resized images, poses from speed and yaw rate, and errors."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import street

from geovp_classic import api
from geovp_classic.data.doctor import Doctor
from geovp_classic.data.layouts import cityscapes
from geovp_classic.data.layouts.cityscapes import Cityscapes
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3

Write = Callable[..., Path]
NAME = "frankfurt_000000_000294"
CAMERA = f"camera/val/frankfurt/{NAME}_camera.json"
IMAGE = "leftImg8bit_sequence/val/frankfurt/frankfurt_000000_000280_leftImg8bit.png"
VEHICLE = "vehicle_sequence/val/frankfurt/frankfurt_000000_000280_vehicle.json"
MIRRORED = json.dumps(
    {
        "intrinsic": {"fx": -1, "fy": 1, "u0": 1, "v0": 1},
        "extrinsic": dict.fromkeys(("x", "y", "z", "roll", "pitch", "yaw"), 0),
    }
)
WINDOW: dict[str, Any] = {"num_frames": 14, "stride": 30, "size_px": (128, 64), "fit": "stretch"}


@pytest.fixture
def root(tmp_path: Path, write_cityscapes: Write) -> Path:
    """The contracts' street as frames 275 to 304, 128x64 pixels, with a yaw rate of 0.5 rad/s."""
    write_cityscapes(tmp_path, NAME, street.clip(30), turn_rad_s=0.5)
    return tmp_path


def test_a_snippet_gives_its_clip(root: Path) -> None:
    data = Cityscapes(root, **WINDOW)
    assert data.clip_names == (f"{NAME}/000000",)
    clip, expected = data[0], street.clip(30)
    np.testing.assert_array_equal(clip.frames, expected.frames[:14, 32:96])
    np.testing.assert_allclose(clip.times_s, np.arange(14) / 17)
    camera = expected.intrinsics.cropped(0, 32, 128, 64)
    np.testing.assert_allclose(clip.intrinsics.matrix, camera.matrix, atol=1e-9)
    assert clip.trajectory is None  # although the speed is recorded
    assert clip.camera_height_m == pytest.approx(1.22)
    settings = {"name": "cityscapes", "root": root, **WINDOW, "size_px": (64, 32)}
    half = api.open_clip({**settings, "camera_height_m": 1.3})
    np.testing.assert_allclose(half.intrinsics.matrix, camera.resized(64, 32).matrix, atol=1e-9)
    assert (half.frames.shape, half.camera_height_m) == ((14, 32, 64, 3), 1.3)


def test_splits_and_snippets_are_selected(root: Path, write_cityscapes: Write) -> None:
    # one follows the other without a gap
    for name in ("frankfurt_000000_000324", "frankfurt_000001_000019", "munster_000002_000019"):
        write_cityscapes(root, name, street.clip())
    write_cityscapes(root, "aachen_000000_000019", street.clip(), split="train")
    in_val = [
        NAME,
        "frankfurt_000000_000324",
        "frankfurt_000001_000019",
        "munster_000002_000019",
    ]
    clips = Cityscapes(root, split="val", **WINDOW).clip_names
    assert clips == tuple(f"{name}/000000" for name in in_val)
    assert list(Cityscapes(root, **WINDOW).recordings) == ["aachen_000000_000019", *in_val]
    chosen = Cityscapes(root, sequences=(f"{NAME}[10:30)",), **WINDOW)
    assert chosen.clip_names == (f"{NAME}/000010",)
    with pytest.raises(BadData, match=r"no images leftImg8bit_sequence/demo/.*: give the folder"):
        Cityscapes(root, split="demo", **WINDOW)


def test_points_are_projected_as_the_calibration_documents(root: Path) -> None:
    """Equations 1 to 6 of csCalibration.pdf, for a point of the vehicle's frame."""
    table = json.loads((root / CAMERA).read_text())
    outer, inner = table["extrinsic"], table["intrinsic"]
    sy, sp, sr = (np.sin(outer[name]) for name in ("yaw", "pitch", "roll"))
    cy, cp, cr = (np.cos(outer[name]) for name in ("yaw", "pitch", "roll"))
    vehicle_from_cam = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    point = np.array([12.0, 1.5, 0.4])
    x, y, z = np.transpose(vehicle_from_cam) @ (point - [outer["x"], outer["y"], outer["z"]])
    expected = [inner["u0"] - inner["fx"] * y / x, inner["v0"] - inner["fy"] * z / x]
    camera, pose = cityscapes.read_calibration(root / CAMERA)
    (point_cam,) = se3.transform(se3.inverse(pose), point[None])
    np.testing.assert_allclose(pinhole.project(point_cam, camera.pinhole)[0], expected)


def test_speed_and_yaw_rate_give_a_circle(root: Path) -> None:
    recording = Cityscapes(root, vehicle_poses=True, **WINDOW).recordings[NAME]
    assert recording.trajectory.is_metric
    _, vehicle_from_cam = cityscapes.read_calibration(root / CAMERA)
    world_from_vehicle = recording.trajectory.world_from_cam @ se3.inverse(vehicle_from_cam)
    angle = 0.5 * np.arange(30) / 17  # to the left, on a radius of 8.5 / 0.5 = 17 m
    circle = 17 * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=-1)
    np.testing.assert_allclose(world_from_vehicle[:, :3, 3], circle, atol=1e-9)
    heading = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    np.testing.assert_allclose(world_from_vehicle[:, :3, 0], heading, atol=1e-9)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        (CAMERA, None, "cannot be read"),
        (CAMERA, "{", "is not JSON"),
        (CAMERA, "{}", "lacks a number ('intrinsic'): expected fx, fy, u0, v0 in 'intrinsic'"),
        (CAMERA, '{"intrinsic": {"fx": 1, "fy": "a"}}', "lacks a number (could not convert"),
        (CAMERA, '{"intrinsic": {"fx": 1, "fy": 1, "u0": NaN, "v0": 1}}', "(not finite): expected"),
        (CAMERA, MIRRORED, "positive focal lengths"),
        (VEHICLE, '{"speed": 3}', "lacks a number ('yawRate'): expected speed, yawRate"),
        (IMAGE, None, "does not exist: unpack"),
    ],
)
def test_bad_files_are_named(root: Path, file: str, text: str | None, message: str) -> None:
    (root / file).unlink()
    if text is not None:
        (root / file).write_text(text)
    with pytest.raises(BadData) as caught:
        Cityscapes(root, vehicle_poses=True, **WINDOW)
    assert str(root / file) in str(caught.value)
    assert message in str(caught.value)
    if file == VEHICLE:  # not read without the setting
        Cityscapes(root, **WINDOW)
    else:
        examination = Doctor().examine(root)
        assert str(caught.value) in [str(finding) for finding in examination.findings]
