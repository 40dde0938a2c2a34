"""Settings of the suite, registered components, and clips written in the layouts of data sets.

The writers compute all numbers of the files independently of the readers. If CI is set, property
tests try the same examples each time; on a developer's machine they look for new ones.
"""

import json
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bag_files
import cv2
import numpy as np
import pytest
import street
from hypothesis import settings
from kitti_files import write_kitti
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from video_files import write_video

import geovp_classic
from geovp_classic import registry
from geovp_classic.data.formats import pose_files
from geovp_classic.errors import MissingExtra
from geovp_classic.types import Clip

settings.register_profile("geovp", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("geovp")


def pytest_configure(config: pytest.Config) -> None:
    """Prepare the process that starts the workers, if there are any."""
    if hasattr(config, "workerinput"):
        return
    _remove_outdated_code()
    if config.getoption("numprocesses", default=None):  # the workers already use all cores
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        os.environ.setdefault("NUMBA_THREADING_LAYER", "workqueue")


def _remove_outdated_code() -> None:
    """Remove compiled code older than any compiled source; numba checks a function's file only."""
    package = Path(geovp_classic.__file__).parent
    sources = [path for path in package.rglob("*.py") if "numba" in path.read_text()]
    newest = max((path.stat().st_mtime for path in sources), default=0)
    for index in package.rglob("*.nbi"):
        if index.stat().st_mtime < newest:
            index.unlink()


WEIGHTS = Path(__file__).parents[1] / "learned/geovp_learned/weights"
SHIPPED = ("svg-tiny", "srvp-tiny", "slamp-tiny", "synsin-small", "deepvo-small")
SETTINGS = {
    "planar": {"source": "ground-truth"},
    "refined": {"source": "ground-truth"},
    "geometric": {"pose_source": "ground-truth", "renderer": "ground-far-plane"},
    "commanded": {"speed_m_s": 5.0, "turn_deg_s": 3.0},
    "dask": {"address": "tcp://127.0.0.1:8786"},
    "tum": {"intrinsics": [150.0, 150.0, 63.5, 63.5]},
    "folder": {"intrinsics": [150.0, 150.0, 63.5, 63.5]},
    # A paper's name alone has no weights of its own
    **{name.split("-")[0]: {"weights": str(WEIGHTS / f"{name}.safetensors")} for name in SHIPPED},
}


@pytest.fixture
def build_component(tmp_path: Path, request: pytest.FixtureRequest) -> Callable[[str, str], Any]:
    """Return a function that builds a registered component; the test is skipped without extras."""

    def build(role: str, name: str) -> Any:
        settings: dict[str, Any] = {"name": name, **SETTINGS.get(name, {})}
        clip = street.clip()
        if role == "datasets":
            settings |= {"num_frames": 3, "size_px": [32, 32]}
        if name == "synthetic":
            settings["num_clips"] = 1
        elif role == "datasets":
            settings["root"] = str(tmp_path)
            if name in ("kitti", "folder"):
                write_kitti(tmp_path, "00", clip, camera=2)
            elif name == "kitti-raw":
                _write_kitti_raw(tmp_path, 1, clip)
            elif name == "videos":
                write_video(tmp_path / "street.mp4", clip.frames)
                (tmp_path / "cameras.toml").write_text("[street]\nfov_deg = 60\n")
            else:
                write = request.getfixturevalue(f"write_{name}")
                write(tmp_path, "street_000000_000019", clip)
        if name == "folder":
            settings["path"] = settings.pop("root") + "/sequences/00/image_2"
        if name == "recorded" and role == "odometries":
            settings["path"] = str(tmp_path / "poses.txt")
            pose_files.write_kitti(tmp_path / "poses.txt", clip.trajectory)
        if name == "recorded" and role == "depth_sources":
            settings |= {"path": str(tmp_path), "frames": "crop"}
            for step, depth in enumerate(clip.depths):
                np.savez(tmp_path / f"{step:06d}.npz", depth)
        if name == "huggingface":
            settings["model"] = str(_write_huggingface(tmp_path))
        if role == "set_metrics":
            settings["weights"] = str(_write_torchscript(tmp_path / "mean.pt"))
        if name == "onnx":
            inputs: dict[str, list[Any]] = {"image": [1, 3, 32, 32]}
            if role == "inpainters":
                inputs["mask"] = [1, 1, 32, 32]
            settings["path"] = str(_write_onnx(tmp_path / "tiny.onnx", inputs))
        if name == "recorded" and role == "predictors":
            for path in (clip.name, "seed0-straight/000", "seed0-stand/000"):
                (tmp_path / path).parent.mkdir()
                np.savez(tmp_path / f"{path}.npz", frames=clip.frames[6:])
            settings["path"] = str(tmp_path)
        try:
            return registry.build(role, settings)
        except MissingExtra as missing:
            pytest.skip(str(missing))

    return build


LATITUDE_DEG = 49.0
LONGITUDE_DEG = 8.4
ALTITUDE_M = 115.0
EARTH_RADIUS_M = 6378137.0
DATE = "2011_09_26"
START = np.datetime64("2011-09-26T13:02:25.964389445")
OFFSET_M = 0.06  # x of camera 0 in the frame of camera 2
FORWARD_LEFT_UP = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # from right, down, forward
RECT_FROM_CAM = Rotation.from_euler("xyz", (0.01, -0.02, 0.005)).as_matrix()
IMU_TO_VELO_T = (-0.8, 0.3, -0.8)
VELO_TO_CAM_T = (0.0, -0.07, -0.27)


@pytest.fixture(scope="session")
def write_kitti_raw() -> Callable[..., Path]:
    """Return a function that writes a clip as drive NNNN of a root and returns its folder."""
    return _write_kitti_raw


def _write_kitti_raw(root: Path, number: int, clip: Clip, with_poses: bool = True) -> Path:
    """Write frames as `image_02`, poses as GPS and IMU readings, and the date's calibration."""
    drive = root / DATE / f"{DATE}_drive_{number:04d}_sync"
    images = drive / "image_02"
    (images / "data").mkdir(parents=True)
    for step, frame in enumerate(clip.frames):
        cv2.imwrite(str(images / f"data/{step:010d}.png"), frame[..., ::-1])
    times_ns = np.round((clip.times_s - clip.times_s[0]) * 1e9).astype("timedelta64[ns]")
    stamps = [str(START + time_ns).replace("T", " ") for time_ns in times_ns]
    _write_lines(images / "timestamps.txt", stamps)
    _write_calibration(root / DATE, clip)
    if with_poses:
        (drive / "oxts/data").mkdir(parents=True)
        cam_from_velo = _rigid(FORWARD_LEFT_UP.T, VELO_TO_CAM_T)
        velo_from_imu = _rigid(np.eye(3), IMU_TO_VELO_T)
        rect_from_imu = _rigid(RECT_FROM_CAM, (0, 0, 0)) @ cam_from_velo @ velo_from_imu
        camera_from_imu = _rigid(np.eye(3), (OFFSET_M, 0, 0)) @ rect_from_imu
        earth_from_world = _rigid(FORWARD_LEFT_UP, (0, 0, 0))  # x east, y north, z up
        for step, world_from_camera in enumerate(clip.trajectory.world_from_cam):
            reading = _reading(earth_from_world @ world_from_camera @ camera_from_imu)
            _write_lines(drive / f"oxts/data/{step:010d}.txt", [_text([*reading, *np.zeros(24)])])
    return drive


def _reading(earth_from_imu: np.ndarray) -> list[float]:
    """Return latitude, longitude, altitude, roll, pitch and yaw; the plane is Mercator's."""
    scale_m = EARTH_RADIUS_M * math.cos(math.radians(LATITUDE_DEG))
    east_m, north_m, up_m = earth_from_imu[:3, 3]
    north_m += scale_m * math.atanh(math.sin(math.radians(LATITUDE_DEG)))
    latitude = math.degrees(math.asin(math.tanh(north_m / scale_m)))  # the Gudermann function
    longitude = LONGITUDE_DEG + math.degrees(east_m / scale_m)
    yaw, pitch, roll = Rotation.from_matrix(earth_from_imu[:3, :3]).as_euler("ZYX")
    return [latitude, longitude, ALTITUDE_M + up_m, roll, pitch, yaw]


def _write_calibration(date: Path, clip: Clip) -> None:
    matrix = clip.intrinsics.matrix
    projection = np.column_stack([matrix, matrix @ [OFFSET_M, 0, 0]])
    cameras = [
        "calib_time: 09-Jan-2012 13:57:47",
        "corner_dist: 9.95e-02",
        f"R_rect_00: {_text(RECT_FROM_CAM)}",
        f"S_rect_02: {clip.intrinsics.width_px} {clip.intrinsics.height_px}",
        f"P_rect_02: {_text(projection)}",
    ]
    _write_lines(date / "calib_cam_to_cam.txt", cameras)
    imu = ["calib_time: 25-May-2012 16:47:16", f"R: {_text(np.eye(3))}"]
    _write_lines(date / "calib_imu_to_velo.txt", [*imu, f"T: {_text(IMU_TO_VELO_T)}"])
    velo = ["calib_time: 15-Mar-2012 11:37:16", f"R: {_text(FORWARD_LEFT_UP.T)}"]
    velo += [f"T: {_text(VELO_TO_CAM_T)}", "delta_f: 0 0"]
    _write_lines(date / "calib_velo_to_cam.txt", velo)


def _rigid(rotation: np.ndarray, translation: Sequence[float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation
    return matrix


def _text(numbers: ArrayLike) -> str:
    return " ".join(f"{number:.12g}" for number in np.ravel(numbers))


def _write_lines(path: Path, lines: Sequence[str], end: str = "\n") -> None:
    path.write_text(end.join([*lines, ""]))


def _quaternion(pose: np.ndarray) -> list[float]:
    """Return x, y, z, w."""
    return Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()


@pytest.fixture(scope="session")
def write_tum() -> Callable[..., Path]:
    """Return a function that writes a clip as the TUM RGB-D sequence `root/name`.

    Depths are 6 ms before, and poses 4 ms after the images.
    """

    def write(root: Path, name: str, clip: Clip) -> Path:
        folder = root / name
        (folder / "rgb").mkdir(parents=True)
        (folder / "depth").mkdir()
        images = ["# timestamp filename"]
        depths = []
        poses = []
        for step, time_s in enumerate(100 + clip.times_s):
            images.append(f"{time_s:.6f} rgb/{step}.png")
            cv2.imwrite(str(folder / f"rgb/{step}.png"), clip.frames[step][..., ::-1])
            if clip.depths is not None:
                depths.append(f"{time_s - 0.006:.6f} depth/{step}.png")
                depth = np.where(clip.depths[step] < 13, clip.depths[step], 0)  # up to 13.1 m
                values = np.rint(5000 * depth).astype(np.uint16)
                cv2.imwrite(str(folder / f"depth/{step}.png"), values)
            if clip.trajectory is not None:
                pose = clip.trajectory.world_from_cam[step]
                numbers = [time_s + 0.004, *pose[:3, 3], *_quaternion(pose)]
                poses.append(" ".join(f"{number:.9f}" for number in numbers))
        for kind, lines in (("rgb", images), ("depth", depths), ("groundtruth", poses)):
            if lines:
                _write_lines(folder / f"{kind}.txt", lines)
        return folder

    return write


@pytest.fixture(scope="session")
def write_euroc() -> Callable[..., Path]:
    """Return a function that writes a clip as the EuRoC sequence `root/name`.

    Poses are at the images' times and 2 ms later.
    """
    body_from_cam = _rigid(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), (-0.02, -0.06, 0.01))

    def write(
        root: Path,
        name: str,
        clip: Clip,
        model: str = "radial-tangential",
        lens: Sequence[float] = (0,) * 4,
    ) -> Path:
        mav = root / name / "mav0"
        (mav / "cam0/data").mkdir(parents=True)
        images = ["#timestamp [ns],filename"]
        poses = ["#timestamp, p_RS_R_x [m], ..., q_RS_w [], q_RS_x [], ..."]
        for step, time_s in enumerate(clip.times_s):
            stamp = 1403636579763555584 + round(float(time_s) * 1e9)
            images.append(f"{stamp},{stamp}.png")
            cv2.imwrite(str(mav / f"cam0/data/{stamp}.png"), clip.frames[step][..., 0])
            if clip.trajectory is not None:
                pose = clip.trajectory.world_from_cam[step] @ np.linalg.inv(body_from_cam)
                x, y, z, w = _quaternion(pose)
                values = [*pose[:3, 3], w, x, y, z, *[0] * 9]
                numbers = ",".join(f"{value:.9f}" for value in values)
                poses += [f"{stamp},{numbers}", f"{stamp + 2_000_000},{numbers}"]
        _write_lines(mav / "cam0/data.csv", images, "\r\n")
        if clip.trajectory is not None:
            (mav / "state_groundtruth_estimate0").mkdir()
            _write_lines(mav / "state_groundtruth_estimate0/data.csv", poses, "\r\n")
        camera = clip.intrinsics
        sensor = [
            "sensor_type: camera",
            "T_BS:",
            "  cols: 4",
            "  rows: 4",
            f"  data: {body_from_cam.ravel().tolist()}",
            "rate_hz: 20",
            f"resolution: [{camera.width_px}, {camera.height_px}]",
            "camera_model: pinhole",
            f"intrinsics: [{camera.fx_px}, {camera.fy_px}, {camera.cx_px}, {camera.cy_px}]",
            f"distortion_model: {model}",
            f"distortion_coefficients: {list(lens)}",
        ]
        _write_lines(mav / "cam0/sensor.yaml", sensor)
        return root / name

    return write


@pytest.fixture(scope="session")
def write_cityscapes() -> Callable[..., Path]:
    return _write_cityscapes


def _write_cityscapes(
    root: Path, name: str, clip: Clip, split: str = "val", turn_rad_s: float | None = None
) -> Path:
    """Write a clip as a snippet, the last frame being repeated; return the path of no file.

    Frames are cropped to twice their height. With a yaw rate, the car drives 8.5 m/s.
    """
    sequence, annotated = name.rsplit("_", 1)
    inner = Path(split, sequence.split("_")[0])
    left, camera, vehicle = (
        root / kind / inner for kind in ("leftImg8bit_sequence", "camera", "vehicle_sequence")
    )
    for folder in (left, camera, vehicle):
        folder.mkdir(parents=True, exist_ok=True)
    size = clip.intrinsics
    top_px = (size.height_px - size.width_px // 2) // 2
    rows = slice(top_px, top_px + size.width_px // 2)
    for step in range(30):
        frame = clip.frames[min(step, len(clip.frames) - 1), rows]
        stem = f"{sequence}_{int(annotated) - 19 + step:06d}"
        cv2.imwrite(str(left / f"{stem}_leftImg8bit.png"), frame[..., ::-1])
        if turn_rad_s is not None:
            reading = {"gpsHeading": 118, "speed": 8.5, "yawRate": turn_rad_s}
            (vehicle / f"{stem}_vehicle.json").write_text(json.dumps(reading))
    scale = 2048 / size.width_px  # pixel (0, 0) is the centre of a pixel
    intrinsic = {
        "fx": scale * size.fx_px,
        "fy": scale * size.fy_px,
        "u0": scale * (size.cx_px + 0.5) - 0.5,
        "v0": scale * (size.cy_px - top_px + 0.5) - 0.5,
    }
    extrinsic = {"baseline": 0.209313, "pitch": 0.038, "roll": 0.01, "yaw": -0.0195}
    extrinsic |= {"x": 1.7, "y": 0.1, "z": 1.22}
    table = {"extrinsic": extrinsic, "intrinsic": intrinsic}
    (camera / f"{name}_camera.json").write_text(json.dumps(table))
    return left / name


@pytest.fixture(scope="session")
def write_colmap() -> Callable[..., Path]:
    """Return a function that writes a clip as images and model; `lost` images have no pose."""

    def write(
        root: Path, name: str, clip: Clip, lost: Sequence[int] = (), text: bool = False
    ) -> Path:
        import pycolmap

        folder = root / name
        (folder / "images").mkdir(parents=True)
        camera = clip.intrinsics
        params = [camera.fx_px, camera.cx_px + 0.5, camera.cy_px + 0.5, 0.0]
        size = {"width": camera.width_px, "height": camera.height_px}
        lens = pycolmap.Camera(model="SIMPLE_RADIAL", params=params, camera_id=1, **size)
        model = pycolmap.Reconstruction()
        model.add_camera_with_trivial_rig(lens)
        for step, frame in enumerate(clip.frames):
            cv2.imwrite(str(folder / f"images/im{step}.png"), frame[..., ::-1])
            if step not in lost:
                cam_from_world = np.linalg.inv(clip.trajectory.world_from_cam[step])
                image = pycolmap.Image(name=f"im{step}.png", camera_id=1, image_id=100 - step)
                model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(cam_from_world[:3]))
        sparse = folder / "sparse/0"
        sparse.mkdir(parents=True)
        (model.write_text if text else model.write_binary)(str(sparse))
        return folder

    return write


@pytest.fixture(scope="session")
def write_rosbag() -> Callable[..., Path]:
    """Return a function that writes a clip as the bag `root/name`, of the kind of its ending.

    The kinds are ROS 1 (`.bag`), and folders of ROS 2 with MCAP (`mcap`) or SQLite.
    """
    pytest.importorskip("rosbags", reason="needs the extra 'rosbag'")
    return bag_files.write


@pytest.fixture(scope="session")
def write_onnx() -> Callable[..., Path]:
    return _write_onnx


def _write_onnx(path: Path, inputs: dict[str, list[Any]], mean_axis: int = 1) -> Path:
    """Write a network of an "image", or of a "mask" and an "image" that are added up.

    The output is the mean over the image's channels, or the image plus 0.2 in the mask.
    """
    onnx = pytest.importorskip("onnx", reason="needs the extra 'onnx'")
    node = onnx.helper.make_node
    nodes = [node("ReduceMean", ["image"], ["out"], axes=[mean_axis], keepdims=1)]
    if "mask" in inputs:
        nodes = [
            node("Mul", ["mask", "level"], ["paint"]),
            node("Add", ["image", "paint"], ["out"]),
        ]
    tensor = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        nodes,
        "tiny",
        [tensor(name, onnx.TensorProto.FLOAT, shape) for name, shape in inputs.items()],
        [tensor("out", onnx.TensorProto.FLOAT, None)],
        [onnx.numpy_helper.from_array(np.float32(0.2), "level")],
    )
    opset = onnx.helper.make_opsetid("", 17)
    onnx.save(onnx.helper.make_model(graph, opset_imports=[opset], ir_version=10), path)
    return path


@pytest.fixture(scope="session")
def write_huggingface() -> Callable[[Path], Path]:
    return _write_huggingface


def _write_torchscript(path: Path) -> Path:
    """Write a network that returns the mean of each channel."""
    torch = pytest.importorskip("torch", reason="needs the extra 'learned'")
    pooling = torch.nn.AdaptiveAvgPool1d(1)
    layers = torch.nn.Sequential(torch.nn.Flatten(2), pooling, torch.nn.Flatten())
    torch.jit.script(layers).save(str(path))
    return path


def _write_huggingface(folder: Path) -> Path:
    """Write Depth Anything with 2 layers of 16 channels, and the settings of its image processor."""
    torch = pytest.importorskip("torch", reason="needs the extra 'pretrained'")
    transformers = pytest.importorskip("transformers", reason="needs the extra 'pretrained'")
    torch.manual_seed(0)
    backbone = transformers.Dinov2Config(
        hidden_size=16,
        num_hidden_layers=2,
        num_attention_heads=2,
        mlp_ratio=1,
        image_size=56,
        patch_size=14,
        out_features=["stage1", "stage2"],
        apply_layernorm=True,
        reshape_hidden_states=False,
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=16,
        reassemble_factors=[2, 1],
        neck_hidden_sizes=[8, 8],
        fusion_hidden_size=8,
        head_hidden_size=8,
    )
    transformers.DepthAnythingForDepthEstimation(config).save_pretrained(folder)
    processor = {
        "size": {"height": 56, "width": 56},
        "keep_aspect_ratio": True,
        "ensure_multiple_of": 14,
        "image_mean": [0.485, 0.456, 0.406],
        "image_std": [0.229, 0.224, 0.225],
    }
    (folder / "preprocessor_config.json").write_text(json.dumps(processor))
    return folder
