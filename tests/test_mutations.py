"""Damaged files: each reader refuses them or reads what was there, fast and in little memory.

`python -m tests.test_mutations COUNT [NAME ...]` tries COUNT mutations of the readers' files and
prints their outcomes; the tests try a few. No mutation may give another value to a reader with
checksums.
"""

from __future__ import annotations

import collections
import dataclasses
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
from video_files import write_video

from geovp_benchmarks.matrix import schema
from geovp_benchmarks.results.store import Method, Results, ScoreRecord, Scores
from geovp_classic import files
from geovp_classic.data.findings import RAISE
from geovp_classic.data.formats import calibration_files, pose_files
from geovp_classic.data.frames import image_frames, video_frames
from geovp_classic.data.layouts import detection, euroc, kitti_raw
from geovp_classic.data.layouts.videos import Videos
from geovp_classic.data.recordings import scans, splits
from geovp_classic.errors import GeovpError
from geovp_classic.types import Clip, Intrinsics, Motion, Prediction, Trajectory
from tests.benchmarks.made import write_protocol

NUM_MUTATIONS = 100
MAX_SECONDS = 10.0
MAX_MIB = 1024
CAMERA = Intrinsics(60.0, 60.0, 23.5, 15.5, 48, 32)
NOISE = np.random.default_rng(0).integers(0, 2**16, (32, 48, 3), dtype=np.uint16)
IMAGE = cv2.GaussianBlur((NOISE >> 8).astype(np.uint8), (0, 0), 1.5)
POSES = np.tile(np.eye(4), (8, 1, 1))
POSES[:, 2, 3] = np.arange(8)
PATH = Trajectory(POSES, np.arange(8) / 10, is_metric=True)
SPLICES = (b"nan", b"1e309", b"-1e300", b"9" * 5000, b"[" * 20_000, b"\xff" * 7 + b"\x7f", b"1_0")

Write = Callable[[Path], Path]  # writes a valid file below a folder


@dataclasses.dataclass(frozen=True)
class Reader:
    """Function that writes a valid file, and the one that reads it."""

    write: Write
    read: Callable[[Path], Any]
    has_checksum: bool = False


def write_bytes(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def text(name: str, content: str) -> Write:
    return lambda folder: write_bytes(folder / name, content.encode())


def image(name: str, array: np.ndarray = IMAGE) -> Write:
    content = cv2.imencode(Path(name).suffix, array)[1].tobytes()
    return lambda folder: write_bytes(folder / name, content)


def video(name: str, codec: str) -> Write:
    def write(folder: Path) -> Path:
        path = folder / name
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), 10, (48, 32))  # type: ignore[attr-defined]
        for shift in range(6):
            writer.write(np.roll(IMAGE, shift, axis=1))
        writer.release()
        return path

    return write


def container(name: str, **settings: Any) -> Write:
    frames = [np.roll(IMAGE, shift, axis=1) for shift in range(6)]
    return lambda folder: write_video(folder / name, frames, **settings)


def cameras_of_videos(folder: Path) -> Path:
    write_video(folder / "a.mp4", [IMAGE] * 6)
    return write_bytes(folder / "cameras.toml", b'[a]\nfov_deg = 60\nfps = 10\nkind = "car"\n')


def read_videos(path: Path) -> Any:
    data = Videos(path.parent, num_frames=3, size_px=(24, 24))
    return [data[number].frames for number in range(len(data))], data.strata(data.clip_names[0])


def read_video(path: Path) -> Any:
    opened = video_frames.VideoFrames(path)
    return [opened.read(index) for index in range(len(opened))]


def write_results(folder: Path) -> None:
    """Write a results folder with a score, a kept clip and a kept prediction."""
    results = Results(folder)
    write_protocol(results, "x", "a", num_past=3)
    method = {"label": "x", "kind": "predictor", "status": "done", "num_samples": 1}
    method |= {"fingerprint": "f", "components": {}}
    method |= {"privileged_inputs": []}
    results.write_method(Method(name="x", **method))
    rows = Scores(["a"], {"psnr": np.linspace(20, 30, 6).reshape(1, 1, 6)})
    results.write_scores([(rows, ScoreRecord("x", ["a"], "f", {"psnr": {}}, {"view": 2.5}, 100.0))])
    stack = np.stack([IMAGE] * 8)
    results.clips().write("a", Clip("a", stack, PATH.times_s, CAMERA, PATH, camera_height_m=1.65))
    motion = Motion(PATH[:3], POSES[None, 3:], np.ones(3, bool))
    covered = np.ones((1, 5, 32, 48), bool)
    results.predictions(results.by_name()["x"]).write(
        "a", Prediction(stack[None, 3:], covered, motion)
    )


def result(file: str, read: Callable[[Results], Any]) -> Reader:
    """Return the reader of a file in a results folder; records in JSON have no checksum."""

    def write(folder: Path) -> Path:
        write_results(folder)
        (path,) = folder.glob(file)
        return path

    root = file.count("/")
    has_checksum = not file.endswith(".json")
    return Reader(write, lambda path: read(Results(path.parents[root])), has_checksum)


def read_scores(results: Results) -> Any:
    return [*results.scores("x").rows()], results.by_name()["x"].scored.seconds


def colmap_model(file: str) -> Write:
    def write(folder: Path) -> Path:
        import pycolmap

        size = {"width": 48, "height": 32}
        lens = pycolmap.Camera(model="PINHOLE", params=[60, 60, 24, 16], camera_id=1, **size)
        model = pycolmap.Reconstruction()
        model.add_camera_with_trivial_rig(lens)
        for number, pose in enumerate(POSES):
            image = pycolmap.Image(name=f"{number}.png", camera_id=1, image_id=number + 1)
            model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
            write_bytes(folder / f"images/{number}.png", b"")
        sparse = folder / "sparse"
        sparse.mkdir()
        (model.write_binary if file.endswith("bin") else model.write_text)(str(sparse))
        return sparse / file

    return write


def read_colmap(path: Path) -> Any:
    scanned = detection.detect(path.parents[1])[1].scan(path.parents[1], RAISE)
    return scanned.world_from_cam, [dataclasses.astuple(camera) for camera in scanned.cameras]


def rgb_list(folder: Path) -> Path:
    for number in range(4):
        write_bytes(folder / f"rgb/{number}.png", b"")
    lines = [f"{100 + 0.1 * number:.6f} rgb/{number}.png\n" for number in range(4)]
    return write_bytes(folder / "rgb.txt", "".join(lines).encode())


def weights(folder: Path) -> Path:
    torch = pytest.importorskip("torch")
    from safetensors.torch import save_file

    path = folder / "w.safetensors"
    tensors = {"net.weight": torch.linspace(-1, 1, 200).reshape(10, 20)}
    save_file(tensors, path, {"format": '"x"', "settings": '{"n": 3}'})
    return path


def read_weights(path: Path) -> Any:
    from geovp_learned import checkpoints

    metadata, tensors = checkpoints.read_tensors(path)
    return metadata, {name: tensor.numpy() for name, tensor in tensors.items()}


def arrays(folder: Path) -> Path:
    np.savez(folder / "a.npz", frames=np.stack([IMAGE] * 3), covered=np.ones((3, 32, 48), bool))
    return folder / "a.npz"


def poses(write: Callable[[Path, Trajectory], None]) -> Write:
    def write_poses(folder: Path) -> Path:
        write(folder / "poses.txt", PATH)
        return folder / "poses.txt"

    return write_poses


def read_calibration(path: Path) -> Any:
    return calibration_files.read_camera(path, path.parent, (48, 32))


LENS_YAML = "distortion_coefficients: {data: [0.1, 0.01, 0, 0]}\n"
ROS_YAML = f"""image_width: 48
image_height: 32
camera_matrix: {{data: [60, 0, 23.5, 0, 60, 15.5, 0, 0, 1]}}
{LENS_YAML}"""
OPENCV_YAML = """%YAML:1.0
---
image_width: 48
image_height: 32
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [60, 0, 23.5, 0, 60, 15.5, 0, 0, 1]
---
"""
VINS_YAML = """%YAML:1.0
---
model_type: PINHOLE
image_width: 48
image_height: 32
distortion_parameters: {k1: 0.1, k2: 0.01, p1: 0, p2: 0}
projection_parameters: {fx: 60, fy: 60, cx: 23.5, cy: 15.5}
"""
ORB_SLAM_YAML = """%YAML:1.0
Camera.fx: 60
Camera.fy: 60
Camera.cx: 23.5
Camera.cy: 15.5
Camera.k1: 0.1
Camera.k2: 0.01
"""
SENSOR_YAML = f"""T_BS: {{data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}
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
KITTI_CALIBRATION = "P0: 60 0 23.5 0 0 60 15.5 0 0 0 1 0\nP1: 60 0 23.5 -30 0 60 15.5 0 0 0 1 0\n"
COLMAP_CALIBRATION = "1 OPENCV 48 32 60 60 24 16 0.1 0.01 0 0\n"
ASL = "".join(f"{10**18 + n * 10**8},{n},0,0,1,0,0,0\n" for n in range(6))
STAMPS = "".join(f"2011-09-26 13:02:{n:02d}.964389445\n" for n in range(6))
TIMES = "".join(f"{n / 10}\n" for n in range(9))

READERS: dict[str, Reader] = {
    "kitti poses": Reader(poses(pose_files.write_kitti), pose_files.read_kitti),
    "tum poses": Reader(poses(pose_files.write_tum), pose_files.read_tum),
    "asl poses": Reader(text("data.csv", ASL), pose_files.read_asl),
    "times": Reader(text("times.txt", TIMES), pose_files.read_times),
    "calib.txt": Reader(
        text("calib.txt", KITTI_CALIBRATION),
        lambda path: calibration_files.read_projection(path, "P1", (48, 32)),
    ),
    "raw timestamps": Reader(
        text("timestamps.txt", STAMPS),
        lambda path: kitti_raw.read_timestamps(path, RAISE),
    ),
    "cameras.txt": Reader(text("cameras.txt", COLMAP_CALIBRATION), read_calibration),
    "ros yaml": Reader(text("c.yaml", ROS_YAML), read_calibration),
    "vins yaml": Reader(text("c.yaml", VINS_YAML), read_calibration),
    "orb-slam yaml": Reader(text("c.yaml", ORB_SLAM_YAML), read_calibration),
    "sensor.yaml": Reader(text("sensor.yaml", SENSOR_YAML), euroc.read_sensor),
    "rgb.txt": Reader(rgb_list, lambda path: scans.read_list(path, path.parent, RAISE)),
    "split": Reader(
        text("s.toml", 'ranges = ["06", "03[180:360)"]\n'), lambda path: splits.load(str(path))
    ),
    "matrix": Reader(text("m.toml", MATRIX), lambda path: schema.read(path).model_dump_json()),
    "png": Reader(image("a.png"), image_frames.read_image, has_checksum=True),
    "depth": Reader(image("d.png", NOISE[..., 0]), image_frames.read_depth, has_checksum=True),
    "jpg": Reader(image("a.jpg"), image_frames.read_image),
    "bmp": Reader(image("a.bmp"), image_frames.read_image),
    "tif": Reader(image("a.tif"), image_frames.read_image),
    "mp4": Reader(video("a.mp4", "mp4v"), read_video),
    "avi": Reader(video("a.avi", "MJPG"), read_video),
    "h264 in mp4": Reader(container("a.mp4", options={"g": "3"}), read_video),
    "h264 in ts": Reader(container("a.ts", options={"g": "3"}), read_video),
    "h264 in mkv": Reader(container("a.mkv", options={"bf": "2"}), read_video),
    "vp9 in webm": Reader(container("a.webm", codec="libvpx-vp9", options={"g": "3"}), read_video),
    "raw h264": Reader(container("a.h264", format="h264"), read_video),
    "gif": Reader(container("a.gif", codec="gif", pixel_format="rgb8"), read_video),
    "cameras.toml": Reader(cameras_of_videos, read_videos),
    "opencv yaml": Reader(text("c.yml", OPENCV_YAML), read_calibration),
    "npz": Reader(arrays, files.read_npz, has_checksum=True),
    "clip": result("clips/a..npz", lambda results: results.clips().read("a")),
    "prediction": result(
        "x/predictions/a.f.npz",
        lambda results: results.predictions(results.by_name()["x"]).read("a"),
    ),
    "scores": result("x/scores/part-*.parquet", read_scores),
    "method.json": result("x/method.json", lambda results: results.methods()),
    "protocol.json": result("protocol.json", lambda results: dict(results.protocol())),
    "colmap images.bin": Reader(colmap_model("images.bin"), read_colmap),
    "colmap cameras.bin": Reader(colmap_model("cameras.bin"), read_colmap),
    "colmap images.txt": Reader(colmap_model("images.txt"), read_colmap),
    "weights": Reader(weights, read_weights),
}


def mutate(content: bytes, draw: random.Random) -> bytes:
    """Flip a bit (most often), or cut off, remove, repeat, zero or replace bytes."""
    start = draw.randrange(len(content))
    end = min(len(content), start + draw.choice((1, 4, 16, 200)))
    before, middle, after = content[:start], content[start:end], content[end:]
    flipped = bytes([content[start] ^ 1 << draw.randrange(8)]) + content[start + 1 :]
    others = (
        b"",  # cut off
        after,
        middle + middle + after,
        bytes(len(middle)) + after,
        draw.randbytes(len(middle)) + after,
        draw.choice(SPLICES) + after,
        draw.choice(SPLICES) + middle + after,
    )
    return before + (flipped if draw.random() < 0.4 else draw.choice(others))


def same(first: Any, second: Any) -> bool:
    if type(first) is not type(second):
        return False
    if dataclasses.is_dataclass(first):
        return same(vars(first), vars(second))
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[k], second[k]) for k in first)
    if isinstance(first, list | tuple):
        return len(first) == len(second) and all(map(same, first, second))
    if isinstance(first, np.ndarray):
        return first.dtype == second.dtype and first.tobytes() == second.tobytes()
    return bool(first == second)


def try_mutations(name: str, count: int) -> collections.Counter[str]:
    """Count the outcomes of mutations: refused, the same value, another value, or a failure."""
    reader = READERS[name]
    outcomes = collections.Counter[str]()
    draw = random.Random(name)
    with tempfile.TemporaryDirectory() as folder:
        path = reader.write(Path(folder))
        content = path.read_bytes()
        expected = reader.read(path)
        for _ in range(count):
            path.write_bytes(mutate(content, draw))
            outcomes[outcome(reader, path, expected)] += 1
    return outcomes


def outcome(reader: Reader, path: Path, expected: Any) -> str:
    start_s = time.monotonic()
    start_mib = max_memory_mib()
    signal.alarm(int(3 * MAX_SECONDS))  # ends the tests if a reader hangs
    try:
        value = "same" if same(expected, reader.read(path)) else "other"
    except GeovpError:
        value = "refused"
    except Exception as error:
        value = f"raised {type(error).__name__}"
    finally:
        signal.alarm(0)
    if time.monotonic() - start_s > MAX_SECONDS:
        return "slow"
    return "memory" if max_memory_mib() > start_mib + MAX_MIB else value


def max_memory_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_refused_or_read(name: str) -> None:
    outcomes = try_mutations(name, NUM_MUTATIONS)
    assert outcomes["refused"] > 0
    allowed = {"refused", "same"} if READERS[name].has_checksum else {"refused", "same", "other"}
    assert outcomes.keys() <= allowed


if __name__ == "__main__":
    for reader_name in sys.argv[2:] or READERS:
        print(f"{reader_name}: {dict(try_mutations(reader_name, int(sys.argv[1])))}", flush=True)
