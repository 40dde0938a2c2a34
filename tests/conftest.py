"""Settings of the whole suite: property tests never fail for slowness, only for being wrong. A
drive of KITTI raw.

Where CI is set, they try the same examples every time, so that a checkout passes or fails whenever
it is run; on a developer's machine they go on looking for new ones.
"""

import gc
import math
import os
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import geovp_classic
from geovp_benchmarks.contracts import street
from geovp_classic import registry
from geovp_classic.data import pose_files
from geovp_classic.errors import MissingExtra
from geovp_classic.types import Clip

settings.register_profile("geovp", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("geovp")


def pytest_configure(config: pytest.Config) -> None:
    """Prepare in the process that starts the workers, where there are any."""
    if hasattr(config, "workerinput"):
        return
    _forget_outdated_code()
    if config.getoption(
        "numprocesses", default=None
    ):  # workers and what they start fill the cores; see parallel.py
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        os.environ.setdefault(
            "NUMBA_THREADING_LAYER", "workqueue"
        )  # that of OpenMP gives torch all cores again


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Modules and tests stay to the end: the search for garbage among them took a quarter of the
    time of collecting.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(50_000, 20, 20)  # and of the search in what tests make themselves
        gc.enable()


def pytest_unconfigure() -> None:
    """Let everything go."""
    gc.unfreeze()


def _forget_outdated_code() -> None:
    """Forget compiled code that is older than any compiled source: numba's cache only knows a
    function's own file.
    """
    package = Path(geovp_classic.__file__).parent
    sources = [
        path for path in package.rglob("*.py") if "numba" in path.read_text(encoding="utf-8")
    ]
    newest = max(path.stat().st_mtime for path in sources)
    for index in package.rglob("*.nbi"):
        if index.stat().st_mtime < newest:
            index.unlink()


SETTINGS = {
    "planar": {"source": "ground-truth"},
    "refined": {"source": "ground-truth"},
    "geometric": {"pose_source": "ground-truth", "renderer": "given-depth"},
    "commanded": {"speed_m_s": 5.0, "turn_deg_s": 3.0},
    "dask": {"address": "tcp://127.0.0.1:8786"},
    "tum": {"intrinsics": [150.0, 150.0, 63.5, 63.5]},
    "folder": {"intrinsics": [150.0, 150.0, 63.5, 63.5]},
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
            settings |= {"num_clips": 1, "cache": str(tmp_path)}
        elif role == "datasets":
            settings["root"] = str(tmp_path)
            if name in ("kitti", "folder"):
                _write_kitti(tmp_path, clip)
            elif name == "kitti-raw":
                _write_kitti_raw(tmp_path, 1, clip)
            else:
                request.getfixturevalue(f"write_{name}")(tmp_path, "00", clip)
        if name == "folder":
            settings["path"] = settings.pop("root") + "/sequences/00/image_2"
        if name == "recorded":
            (tmp_path / clip.name).parent.mkdir()
            np.savez(tmp_path / f"{clip.name}.npz", frames=clip.frames[6:])
            settings["path"] = str(tmp_path)
        try:
            return registry.build(role, settings)
        except MissingExtra as missing:
            pytest.skip(str(missing))

    return build


def _write_kitti(root: Path, clip: Clip) -> None:
    """Write a clip as sequence 00 of KITTI odometry."""
    sequence = root / "sequences/00"
    (sequence / "image_2").mkdir(parents=True)
    for step, frame in enumerate(clip.frames):
        cv2.imwrite(str(sequence / f"image_2/{step:06d}.png"), frame[..., ::-1])
    projection = _text(np.column_stack([clip.intrinsics.matrix, np.zeros(3)]))
    calibration = "".join(f"P{camera}: {projection}\n" for camera in range(4))
    (sequence / "calib.txt").write_text(calibration)
    np.savetxt(sequence / "times.txt", clip.times_s)
    (root / "poses").mkdir()
    pose_files.write_kitti(root / "poses/00.txt", clip.trajectory)


# KITTI raw as a drive of it lies on disk, written from a clip; everything is worked out here anew.

LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M, EARTH_RADIUS_M = 49.0, 8.4, 115.0, 6378137.0
DATE, STAMP = "2011_09_26", np.datetime64("2011-09-26T13:02:25.964389445")
FROM_CAMERA = np.array(
    [[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]
)  # forward, left, up from right, down, forward
IMU_TO_VELO_T, VELO_TO_CAM_T = (-0.8, 0.3, -0.8), (0.0, -0.07, -0.27)
OFFSET_M = {0: 0.0, 2: 0.06}  # x of camera 0 as camera K sees it
RECT_RAD = (0.01, -0.02, 0.005)  # from camera 0 as it is mounted to the rectified one


@pytest.fixture(scope="session")
def write_kitti_raw() -> Callable[..., Path]:
    """A function that writes a clip as drive NNNN of a root and returns the drive's folder; see
    `_write_kitti_raw`.
    """
    return _write_kitti_raw


def _write_kitti_raw(
    root: Path, number: int, clip: Clip, camera: int = 2, with_poses: bool = True
) -> Path:
    """The clip's frames as `image_0K`, its poses as readings of GPS and IMU, with the date's
    calibration beside it.
    """
    drive = root / DATE / f"{DATE}_drive_{number:04d}_sync"
    images = drive / f"image_0{camera}"
    (images / "data").mkdir(parents=True)
    for step, frame in enumerate(clip.frames):
        cv2.imwrite(str(images / "data" / f"{step:010d}.png"), frame[..., ::-1])
    whole_ns = np.round((clip.times_s - clip.times_s[0]) * 1e9).astype("timedelta64[ns]")
    (images / "timestamps.txt").write_text(
        "".join(f"{str(STAMP + ns).replace('T', ' ')}\n" for ns in whole_ns)
    )
    rect_from_cam = Rotation.from_euler("xyz", RECT_RAD).as_matrix()
    _write_calibration(root / DATE, clip, camera, rect_from_cam)
    if not with_poses:
        return drive
    (drive / "oxts" / "data").mkdir(parents=True)
    cam_from_velo = _rigid(FROM_CAMERA.T, VELO_TO_CAM_T)
    rect_from_imu = (
        _rigid(rect_from_cam, (0, 0, 0)) @ cam_from_velo @ _rigid(np.eye(3), IMU_TO_VELO_T)
    )
    camera_from_rect = _rigid(np.eye(3), (OFFSET_M[camera], 0, 0))
    axes = _rigid(
        FROM_CAMERA, (0, 0, 0)
    )  # the clip's world has the camera's axes, the earth's x east, y north, z up
    for step, world_from_cam in enumerate(clip.trajectory.world_from_cam):
        earth_from_imu = axes @ world_from_cam @ camera_from_rect @ rect_from_imu
        numbers = [*_reading(earth_from_imu), *np.zeros(24)]
        (drive / "oxts" / "data" / f"{step:010d}.txt").write_text(
            " ".join(f"{n:.12g}" for n in numbers) + "\n"
        )
    return drive


def _reading(earth_from_imu: np.ndarray) -> list[float]:
    """Latitude, longitude, altitude, roll, pitch, yaw on the Mercator plane whose scale is that of
    LATITUDE_DEG.
    """
    scale_m = EARTH_RADIUS_M * math.cos(math.radians(LATITUDE_DEG))
    east_m, north_m, up_m = earth_from_imu[:3, 3]
    north_m += scale_m * math.atanh(math.sin(math.radians(LATITUDE_DEG)))
    latitude = math.degrees(math.asin(math.tanh(north_m / scale_m)))  # the Gudermann function
    r = earth_from_imu[:3, :3]
    angles = math.atan2(r[2, 1], r[2, 2]), -math.asin(r[2, 0]), math.atan2(r[1, 0], r[0, 0])
    return [latitude, LONGITUDE_DEG + math.degrees(east_m / scale_m), ALTITUDE_M + up_m, *angles]


def _write_calibration(date: Path, clip: Clip, camera: int, rect_from_cam: np.ndarray) -> None:
    projection = np.hstack(
        [clip.intrinsics.matrix, clip.intrinsics.matrix @ [[OFFSET_M[camera]], [0], [0]]]
    )
    size = f"{clip.intrinsics.width_px} {clip.intrinsics.height_px}"
    lines = {
        "calib_time": "09-Jan-2012 13:57:47",
        "corner_dist": "9.95e-02",
        "R_rect_00": _text(rect_from_cam),
    }
    lines |= {f"S_rect_0{camera}": size, f"P_rect_0{camera}": _text(projection)}
    (date / "calib_cam_to_cam.txt").write_text(
        "".join(f"{name}: {text}\n" for name, text in lines.items())
    )
    velo = f"calib_time: 25-May-2012 16:47:16\nR: {_text(np.eye(3))}\nT: {_text(IMU_TO_VELO_T)}\n"
    (date / "calib_imu_to_velo.txt").write_text(velo)
    cam = f"calib_time: 15-Mar-2012 11:37:16\nR: {_text(FROM_CAMERA.T)}\nT: {_text(VELO_TO_CAM_T)}\ndelta_f: 0 0\n"
    (date / "calib_velo_to_cam.txt").write_text(cam)


def _rigid(rotation: np.ndarray, translation: Sequence[float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def _text(numbers: ArrayLike) -> str:
    return " ".join(f"{number:.12g}" for number in np.ravel(numbers))


# TUM RGB-D, EuRoC and COLMAP as their files lie on disk, written from a clip; numbers are worked
# out here anew.

EUROC_START_NS = 1403636579763555584
BODY_FROM_CAM = np.array([[0.0, -1, 0, -0.02], [1, 0, 0, -0.06], [0, 0, 1, 0.01], [0, 0, 0, 1]])


def _quaternion(pose: np.ndarray) -> list[float]:
    """As x, y, z, w."""
    return Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()


@pytest.fixture(scope="session")
def write_tum() -> Callable[..., Path]:
    """A function that writes a clip as the sequence `root/name`, depths 6 ms before and poses 4 ms
    after the images.
    """

    def write(root: Path, name: str, clip: Clip) -> Path:
        folder = root / name
        lists: dict[str, list[str]] = {
            "rgb": ["# timestamp filename"],
            "depth": [],
            "groundtruth": [],
        }
        for kind in ("rgb", "depth"):
            (folder / kind).mkdir(parents=True)
        for step, time_s in enumerate(100 + clip.times_s):
            lists["rgb"].append(f"{time_s:.6f} rgb/{step}.png")
            cv2.imwrite(str(folder / "rgb" / f"{step}.png"), clip.frames[step][..., ::-1])
            if clip.depths is not None:
                lists["depth"].append(f"{time_s - 0.006:.6f} depth/{step}.png")
                depth = np.where(
                    clip.depths[step] < 13, clip.depths[step], 0
                )  # 16 bits end at 13.1 m
                cv2.imwrite(
                    str(folder / "depth" / f"{step}.png"), np.rint(5000 * depth).astype(np.uint16)
                )
            if clip.trajectory is not None:
                pose = clip.trajectory.world_from_cam[step]
                numbers = [time_s + 0.004, *pose[:3, 3], *_quaternion(pose)]
                lists["groundtruth"].append(" ".join(f"{number:.9f}" for number in numbers))
        for kind, lines in lists.items():
            if lines:
                (folder / f"{kind}.txt").write_text("\n".join(lines) + "\n")
        return folder

    return write


@pytest.fixture(scope="session")
def write_euroc() -> Callable[..., Path]:
    """A function that writes a clip as the sequence `root/name`, poses at the images' times and 2
    ms later.
    """

    def write(
        root: Path,
        name: str,
        clip: Clip,
        model: str = "radial-tangential",
        lens: Sequence[float] = (0,) * 4,
    ) -> Path:
        cam, truth = (
            root / name / "mav0" / "cam0",
            root / name / "mav0" / "state_groundtruth_estimate0",
        )
        (cam / "data").mkdir(parents=True)
        images, poses = (
            ["#timestamp [ns],filename"],
            ["#timestamp, p_RS_R_x [m], ..., q_RS_w [], q_RS_x [], ..."],
        )
        for step, time_s in enumerate(clip.times_s):
            stamp = EUROC_START_NS + round(float(time_s) * 1e9)
            images.append(f"{stamp},{stamp}.png")
            cv2.imwrite(str(cam / "data" / f"{stamp}.png"), clip.frames[step][..., 0])
            if clip.trajectory is not None:
                world_from_body = clip.trajectory.world_from_cam[step] @ np.linalg.inv(
                    BODY_FROM_CAM
                )
                x, y, z, w = _quaternion(world_from_body)
                numbers = ",".join(
                    f"{number:.9f}" for number in [*world_from_body[:3, 3], w, x, y, z, *[0] * 9]
                )
                poses += [f"{stamp},{numbers}", f"{stamp + 2_000_000},{numbers}"]
        (cam / "data.csv").write_text("\r\n".join(images) + "\r\n")
        if clip.trajectory is not None:
            truth.mkdir()
            (truth / "data.csv").write_text("\r\n".join(poses) + "\r\n")
        camera = clip.intrinsics
        numbers = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]
        transform = ", ".join(str(number) for number in BODY_FROM_CAM.ravel())
        (cam / "sensor.yaml").write_text(
            f"sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{transform}]\nrate_hz: 20\n"
            f"resolution: [{camera.width_px}, {camera.height_px}]\ncamera_model: pinhole\nintrinsics: {numbers}\n"
            f"distortion_model: {model}\ndistortion_coefficients: {list(lens)}\n"
        )
        return root / name

    return write


@pytest.fixture(scope="session")
def write_colmap() -> Callable[..., Path]:
    """A function that writes a clip as images and model of `root/name`, some images not registered."""

    def write(
        root: Path,
        name: str,
        clip: Clip,
        lost: Sequence[int] = (),
        distortion: float = 0.0,
        text: bool = False,
    ) -> Path:
        import pycolmap

        folder, camera, model = root / name, clip.intrinsics, pycolmap.Reconstruction()
        (folder / "images").mkdir(parents=True)
        params = [camera.fx_px, camera.cx_px + 0.5, camera.cy_px + 0.5, distortion]
        size = {"width": camera.width_px, "height": camera.height_px}
        lens = pycolmap.Camera(model="SIMPLE_RADIAL", params=params, camera_id=1, **size)
        model.add_camera_with_trivial_rig(lens)
        assert clip.trajectory is not None
        for step, frame in enumerate(clip.frames):
            cv2.imwrite(str(folder / "images" / f"im{step}.png"), frame[..., ::-1])
            if step not in lost:
                cam_from_world = np.linalg.inv(clip.trajectory.world_from_cam[step])
                pose = pycolmap.Rigid3d(
                    pycolmap.Rotation3d(cam_from_world[:3, :3]), cam_from_world[:3, 3]
                )
                image = pycolmap.Image(name=f"im{step}.png", camera_id=1, image_id=100 - step)
                model.add_image_with_trivial_frame(image, pose)
        (folder / "sparse" / "0").mkdir(parents=True)
        (model.write_text if text else model.write_binary)(str(folder / "sparse" / "0"))
        return folder

    return write
