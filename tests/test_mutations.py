"""Damaged files: every reader refuses them in one sentence or reads what was there, fast and in
little memory.

`python tests/test_mutations.py COUNT [NAME ...]` tries COUNT mutations of every reader's file and
prints what became of them; the tests try a few. `guarded` readers have a checksum, so that no
mutation may give another value.
"""

from __future__ import annotations

import collections
import dataclasses
import functools
import hashlib
import random
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from geovp_benchmarks import matrix
from geovp_benchmarks.store import Part, Results, Rows
from geovp_classic.data import (
    calibration_files,
    colmap,
    euroc,
    frames,
    kitti_layout,
    kitti_raw_layout,
    pose_files,
    posed_sequences,
    splits,
)
from geovp_classic.data.findings import raise_first
from geovp_classic.data.undistortion import DistortedCamera, UndistortedDepths
from geovp_classic.errors import GeovpError
from geovp_classic.forecasting import body_motion, motion_prior
from geovp_classic.predictors import recorded as recorded_predictions
from geovp_classic.types import Clip, Intrinsics, Motion, Prediction, Trajectory

IN_TESTS = 100
SLOWEST_S, MOST_MIB = 10.0, 1024
CAMERA = Intrinsics(60.0, 60.0, 23.5, 15.5, 48, 32)
NOISE = np.random.default_rng(0)
SMOOTH = cv2.GaussianBlur(NOISE.integers(0, 256, (32, 48, 3), dtype=np.uint8), (0, 0), 1.5)
POSES = np.tile(np.eye(4), (8, 1, 1))
POSES[:, 2, 3] = np.arange(8)
PATH = Trajectory(POSES, np.arange(8) / 10, is_metric=True)
SPLICES = [
    b"nan",
    b"1e309",
    b"-1e300",
    b"9" * 5000,
    b"[" * 20_000,
    b"\xff\xff\xff\xff\xff\xff\xff\x7f",
    b"\0" * 9,
    b"1_0",
]


@dataclasses.dataclass(frozen=True)
class Reader:
    """A kind of file: how a good one is written below a folder, and what reading it gives."""

    write: Callable[[Path], Path]
    read: Callable[[Path], Any]
    guarded: bool = False


def text(name: str, content: str) -> Callable[[Path], Path]:
    return lambda folder: blob(folder / name, content.encode())


def blob(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def image(name: str, array: np.ndarray) -> Callable[[Path], Path]:
    return lambda folder: blob(folder / name, cv2.imencode(Path(name).suffix, array)[1].tobytes())


def listed(write: Callable[[Path], Path]) -> Callable[[Path], Path]:
    """The same with SHA256SUMS beside it."""

    def both(folder: Path) -> Path:
        path = write(folder)
        blob(
            path.with_name("SHA256SUMS"),
            f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n".encode(),
        )
        return path

    return both


def first_error(scanned: tuple[Any, ...]) -> Any:
    raise_first(scanned[-1])
    return scanned[:-1]


def video(name: str, codec: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        writer = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*codec), 10, (48, 32))  # type: ignore[attr-defined]
        for shift in range(6):
            writer.write(np.roll(SMOOTH, shift, axis=1))
        writer.release()
        return folder / name

    return write


def read_video(path: Path) -> Any:
    found = frames.VideoFrames.open(path)
    return [found.read(index) for index in range(len(found))]


def results(folder: Path, file: str) -> Path:
    """A results folder with everything in it; the file in it that is mutated."""
    made = Results(folder)
    made.write_protocol(
        {"cells": ["x"], "clips": ["a"], "num_past": 3, "metrics": {"psnr": {"role": "frame"}}}
    )
    made.write_datasets(["near", "far"] if file == "datasets.json" else [""])
    cell = {
        "label": "x",
        "kind": "predictor",
        "status": "done",
        "grants": ["PAST_POSES"],
        "num_samples": 1,
    }
    cell |= {
        "num_clips": 1,
        "seconds": {"view": 2.5},
        "fingerprint": "f",
        "components": {"predictor": {"name": "y"}},
    }
    made.write_cell("x", cell)
    columns = (["a"] * 6, [0] * 6, range(1, 7), ["psnr"] * 6, np.linspace(20, 30, 6))
    made.write_part(
        "x", Rows.of(*columns), Part(0, ("a",), "f", {"psnr": {}}, {"view": 2.5}, 100.0)
    )
    stack = np.stack([SMOOTH] * 8)
    made.write_clip(Clip("a", stack, PATH.times_s, CAMERA, PATH, camera_height_m=1.65))
    motion = Motion(PATH[:3], POSES[None, 3:], np.ones(3, bool))
    made.write_prediction(
        "x", "a", Prediction(stack[None, 3:], np.ones((1, 5, 32, 48), bool), motion)
    )
    return folder / file


def read_part(folder: Results) -> Any:
    return [*folder.scores("x").lines()], [part.seconds for part in folder.parts("x")]


def kept(file: str, read: Callable[[Results], Any]) -> Reader:
    above = file.count("/")
    return Reader(
        functools.partial(results, file=file),
        lambda path: read(Results(path.parents[above])),
        guarded=not file.endswith(".json"),
    )


def colmap_model(file: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        import pycolmap

        model = pycolmap.Reconstruction()
        lens = pycolmap.Camera(
            model="PINHOLE", params=[60, 60, 24, 16], camera_id=1, width=48, height=32
        )
        model.add_camera_with_trivial_rig(lens)
        for number, pose in enumerate(POSES):
            rigid = pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:3, :3]), -pose[:3, 3])
            model.add_image_with_trivial_frame(
                pycolmap.Image(name=f"{number}.png", camera_id=1, image_id=number + 1), rigid
            )
            blob(folder / "images" / f"{number}.png", b"")
        (folder / "sparse").mkdir()
        (model.write_binary if file.endswith("bin") else model.write_text)(str(folder / "sparse"))
        return folder / "sparse" / file

    return write


def read_colmap(path: Path) -> Any:
    scanned = colmap.scan(path.parents[1])
    raise_first(scanned.findings)
    return scanned.world_from_cam, [dataclasses.astuple(camera) for camera in scanned.cameras]


def rgb_list(folder: Path) -> Path:
    for number in range(4):
        blob(folder / f"rgb/{number}.png", b"")
    return blob(
        folder / "rgb.txt", "".join(f"{100 + 0.1 * n:.6f} rgb/{n}.png\n" for n in range(4)).encode()
    )


def weights(folder: Path) -> Path:
    checkpoints, torch = (
        pytest.importorskip("geovp_learned.checkpoints"),
        pytest.importorskip("torch"),
    )
    values = torch.linspace(-1, 1, 200).reshape(10, 20)
    checkpoints.write_tensors(
        folder / "w.safetensors", {"net.weight": values}, {"format": "x", "settings": {"n": 3}}
    )
    return folder / "w.safetensors"


def read_weights(path: Path) -> Any:
    from geovp_learned import checkpoints

    metadata, tensors = checkpoints.read_tensors(path)
    return metadata, {name: tensor.numpy() for name, tensor in tensors.items()}


def recorded(folder: Path) -> Path:
    np.savez(folder / "a.npz", frames=np.stack([SMOOTH] * 3), covered=np.ones((3, 32, 48), bool))
    return folder / "a.npz"


def packaged(name: str) -> Callable[[Path], Path]:
    source = Path(motion_prior.__file__).parents[1] / "poses" / name
    return lambda folder: blob(folder / name, source.read_bytes())


def pose_lines(write: Callable[[Path, Trajectory], None]) -> Callable[[Path], Path]:
    def lines(folder: Path) -> Path:
        write(folder / "poses.txt", PATH)
        return folder / "poses.txt"

    return lines


LENS_YAML = "distortion_coefficients: {data: [0.1, 0.01, 0, 0]}\n"
YAML = f"""image_width: 48
image_height: 32
camera_matrix: {{data: [60, 0, 23.5, 0, 60, 15.5, 0, 0, 1]}}
{LENS_YAML}"""
SENSOR = f"""T_BS: {{data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}
resolution: [48, 32]
intrinsics: [60, 60, 23.5, 15.5]
distortion_model: radtan
{LENS_YAML}"""
MATRIX = """[protocol]
dataset = { name = "synthetic" }
num_past = 3
num_future = 2
size_px = [32, 32]
stride = 3
[predictors]
copy-last = { name = "copy-last" }
[metrics]
frame = ["psnr"]
"""
ASL = "".join(f"{10**18 + n * 10**8},{n},0,0,1,0,0,0\n" for n in range(6))
STAMPS = "".join(f"2011-09-26 13:02:{n:02d}.964389445\n" for n in range(6))
DEEP = NOISE.integers(0, 2**16, (32, 48), dtype=np.uint16)
LENS = DistortedCamera.of("OPENCV", (60.0, 60.0, 23.5, 15.5), (0, 0, 0, 0), (48, 32))

READERS: dict[str, Reader] = {
    "kitti poses": Reader(pose_lines(pose_files.write_kitti), pose_files.read_kitti),
    "tum poses": Reader(pose_lines(pose_files.write_tum), pose_files.read_tum),
    "asl poses": Reader(
        text("data.csv", ASL), lambda path: first_error(pose_files.scan_asl(path, 1e18))
    ),
    "times": Reader(
        text("times.txt", "".join(f"{n / 10}\n" for n in range(9))), pose_files.read_times
    ),
    "times listed": Reader(
        listed(text("t.txt", "0.0\n0.1\n0.2\n")), pose_files.read_times, guarded=True
    ),
    "calib.txt": Reader(
        text(
            "calib.txt",
            "P0: 60 0 23.5 0 0 60 15.5 0 0 0 1 0\nP1: 60 0 23.5 -30 0 60 15.5 0 0 0 1 0\n",
        ),
        lambda path: first_error(kitti_layout.scan_calibration(path)),
    ),
    "raw timestamps": Reader(
        text("timestamps.txt", STAMPS),
        lambda path: first_error(kitti_raw_layout.scan_timestamps(path)),
    ),
    "cameras.txt": Reader(
        text("cameras.txt", "1 OPENCV 48 32 60 60 24 16 0.1 0.01 0 0\n"),
        lambda path: calibration_files.read_calibration(path, path.parent),
    ),
    "ros yaml": Reader(
        text("c.yaml", YAML), lambda path: calibration_files.read_calibration(path, path.parent)
    ),
    "sensor.yaml": Reader(text("sensor.yaml", SENSOR), euroc.read_sensor),
    "rgb.txt": Reader(
        rgb_list, lambda path: first_error(posed_sequences.scan_list(path, path.parent))
    ),
    "split": Reader(
        text("s.toml", 'ranges = ["06", "03[180:360)"]\n'), lambda path: splits.load(str(path))
    ),
    "matrix": Reader(text("m.toml", MATRIX), lambda path: matrix.read(path).to_json()),
    "png": Reader(image("a.png", SMOOTH), frames.read_image, guarded=True),
    "png of 16 bits": Reader(
        image("a.png", DEEP), lambda path: frames.read_image(path, 16), guarded=True
    ),
    "depth": Reader(
        image("d.png", DEEP),
        lambda path: UndistortedDepths((path,), (LENS,), LENS.pinhole, 5000.0)(0),
        guarded=True,
    ),
    **{
        ending: Reader(image(f"a.{ending}", SMOOTH), frames.read_image)
        for ending in ("jpg", "webp", "bmp", "ppm")
    },
    **{
        ending: Reader(image(f"a.{ending}", SMOOTH), frames.read_image) for ending in ("tif", "jp2")
    },
    "jpg listed": Reader(listed(image("a.jpg", SMOOTH)), frames.read_image, guarded=True),
    "mp4": Reader(video("a.mp4", "mp4v"), read_video),
    "avi": Reader(video("a.avi", "MJPG"), read_video),
    "mp4 listed": Reader(listed(video("a.mp4", "mp4v")), read_video, guarded=True),
    "recorded npz": Reader(recorded, recorded_predictions._read_npz, guarded=True),
    "motion prior": Reader(
        packaged("motion_prior.npz"), motion_prior.load.__wrapped__, guarded=True
    ),
    "body motion": Reader(packaged("body_motion.npz"), body_motion.load.__wrapped__, guarded=True),
    "kept clip": kept("clips/a.npz", lambda folder: folder.clip("a")),
    "kept prediction": kept("x/predictions/a.npz", lambda folder: folder.prediction("x", "a")),
    "part": kept("x/scores/part-00000.parquet", read_part),
    "cell.json": kept("x/cell.json", lambda folder: folder.cells()),
    "protocol.json": kept("protocol.json", lambda folder: dict(folder.protocol())),
    "datasets.json": kept("datasets.json", lambda folder: list(folder.by_dataset())),
    "colmap images.bin": Reader(colmap_model("images.bin"), read_colmap),
    "colmap cameras.bin": Reader(colmap_model("cameras.bin"), read_colmap),
    "colmap frames.bin": Reader(colmap_model("frames.bin"), read_colmap),
    "colmap images.txt": Reader(colmap_model("images.txt"), read_colmap),
    "weights": Reader(listed(weights), read_weights, guarded=True),
}


def mutated(content: bytes, draw: random.Random) -> bytes:
    """Flipped bits mostly; else bytes cut off, removed, doubled, zeroed, or something else in their
    place.
    """
    data, at = bytearray(content), draw.randrange(len(content))
    end = min(len(data), at + draw.choice((1, 4, 16, 200)))
    kind = draw.randrange(10)
    if kind < 4:
        data[at] ^= 1 << draw.randrange(8)
    elif kind == 4:
        data[at] = draw.choice(b"0123456789.-+eE \n\t,:#\"'[]{}\\/")
    elif kind == 5:
        del data[at:]
    elif kind == 6:
        del data[at:end]
    elif kind == 7:
        data[at:at] = data[at:end]
    elif kind == 8:
        data[at:end] = draw.choice(
            (bytes(end - at), draw.randbytes(end - at), b"\xff" * (end - at))
        )
    else:
        data[at : draw.choice((at, end))] = draw.choice(SPLICES)
    return bytes(data)


def same(a: Any, b: Any) -> bool:
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(
            same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)
        )
    if isinstance(a, dict):
        return (
            isinstance(b, dict) and a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
        )
    if isinstance(a, list | tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return (
            isinstance(b, np.ndarray)
            and a.dtype == b.dtype
            and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        )
    return bool(a == b)


def try_mutations(name: str, count: int) -> collections.Counter[str]:
    """How many mutations were refused, read as what was there or as something else, or ended in
    something worse.
    """
    reader, outcomes, draw = READERS[name], collections.Counter[str](), random.Random(name)
    with tempfile.TemporaryDirectory() as folder:
        path = reader.write(Path(folder))
        content, expected = path.read_bytes(), reader.read(path)
        for _ in range(count):
            damaged = mutated(content, draw)
            path.write_bytes(damaged)
            outcomes[outcome(reader, path, expected) if damaged != content else "same"] += 1
    return outcomes


def outcome(reader: Reader, path: Path, expected: Any) -> str:
    begun_s, before_mib = (
        time.monotonic(),
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    )
    signal.alarm(int(3 * SLOWEST_S))  # a hang ends the tests instead of holding them up
    try:
        found = "same" if same(expected, reader.read(path)) else "other"
    except GeovpError:
        found = "refused"
    except Exception as error:
        found = f"raised {type(error).__name__}"
    finally:
        signal.alarm(0)
    if time.monotonic() - begun_s > SLOWEST_S:
        return "slow"
    return (
        found
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 < before_mib + MOST_MIB
        else "memory"
    )


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_refused_or_read_as_it_was(name: str) -> None:
    outcomes = try_mutations(name, IN_TESTS if name != "motion prior" else IN_TESTS // 5)
    assert outcomes["refused"] > 0
    assert outcomes.keys() <= (
        {"refused", "same"} if READERS[name].guarded else {"refused", "same", "other"}
    )


if __name__ == "__main__":
    for chosen in sys.argv[2:] or READERS:
        print(f"{chosen}: {dict(try_mutations(chosen, int(sys.argv[1])))}", flush=True)
