"""How many points a second the splat draws, beside Open3D's projection and a z-buffer in numpy, in the same run.

`python -m benchmarks.performance.splat [ROUNDS]`: the cloud of three frames of 256x256 with depth, seen from 20 poses
ahead. All draw the same points from the same poses, in turns, so that a busy machine slows all of them; the processor's
time of all threads stands beside the clock's. Linear algebra, which numpy's z-buffer needs, has one thread: that is as
fast for it, and idle ones would slow the two others. The splat draws surfaces, each point as a square of its own size;
the other two set one pixel a point. The first drawing of a process that finds no compiled code, and of the next one,
say what compiling costs and that its result is kept.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.commands import command, whole_numbers
from geovp_classic.geometry import pinhole, se3
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.render import patches
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

CAMERA = Intrinsics(480.0, 480.0, 127.5, 127.5, 256, 256)
NUM_SOURCES, NUM_VIEWS, STEP_M = 3, 20, 1.0
HEIGHT_M, HALF_WIDTH_M, FARTHEST_M = 1.65, 6.0, 80.0
FIRST_IMAGES = """
import time
from benchmarks.performance import splat
scene, poses = splat.street()
start = time.perf_counter()
splat.draw_splat(scene, poses)
print(time.perf_counter() - start)
"""


@dataclass(frozen=True)
class Street:
    """A cloud in the three shapes that the three ways of drawing need."""

    cloud: patches.Patches
    sources: list[patches.Source]
    points_world: FloatArray  # [N, 3]
    colours: ByteArray  # [N, 3]


@dataclass(frozen=True)
class Timing:
    """What the runs took."""

    num_points: int
    seconds: dict[str, FloatArray]  # [rounds, 2], all views by the clock and of the processor, by name
    first_s: tuple[float, float]  # the first drawing of a process without compiled code, and of the next one

    def points_per_s(self, name: str) -> float:
        """Points times views by the median time."""
        return self.num_points * NUM_VIEWS / float(np.median(self.seconds[name][:, 0]))

    def lines(self) -> list[str]:
        """The result in words."""
        told = [f"{self.num_points} points, {NUM_VIEWS} views of {CAMERA.width_px}x{CAMERA.height_px}"]
        for name, taken in self.seconds.items():
            clock_ms, processor_ms = 1e3 * np.median(taken, axis=0)
            speed = f"{self.points_per_s(name) / 1e6:.1f} million points/s"
            told.append(f"{name}: {speed}, {clock_ms:.0f} ms, of the processor {processor_ms:.0f} ms")
        return [*told, f"first drawing of a process: {self.first_s[0]:.1f} s, of the next one {self.first_s[1]:.2f} s"]


def street() -> tuple[Street, FloatArray]:
    """A road between walls, seen by three frames, and the poses [F, 4, 4] to draw it from."""
    track = se3.compose(np.eye(3), np.outer(np.arange(NUM_SOURCES + NUM_VIEWS) * STEP_M, [0.0, 0.0, 1.0]))
    rays = pinhole.rays(CAMERA)
    road, wall = rays[..., 1] / HEIGHT_M, np.abs(rays[..., 0]) / HALF_WIDTH_M
    inverse_depth = np.maximum(np.maximum(road, wall), 1 / FARTHEST_M).astype(np.float32)
    colours = np.random.default_rng(0).integers(0, 256, (*inverse_depth.shape, 3), dtype=np.uint8)
    sources = [patches.Source(colours, CAMERA, pose) for pose in track[:NUM_SOURCES]]
    known = np.ones(inverse_depth.shape, dtype=bool)
    cloud = patches.concatenate([patches.from_depth_map(inverse_depth, known, number) for number in range(NUM_SOURCES)])
    points_cam = (rays / inverse_depth[..., None]).reshape(-1, 3)
    points_world = np.concatenate([se3.transform(pose, points_cam) for pose in track[:NUM_SOURCES]])
    return Street(cloud, sources, points_world, np.tile(colours.reshape(-1, 3), (NUM_SOURCES, 1))), track[NUM_SOURCES:]


def draw_splat(scene: Street, world_from_cam: FloatArray) -> FloatArray:
    """Inverse depth [F, H, W] by our splat."""
    return patches.rasterise(scene.cloud, scene.sources, world_from_cam, CAMERA)[0]


def draw_numpy(scene: Street, world_from_cam: FloatArray) -> FloatArray:
    """Inverse depth [F, H, W] by a z-buffer in numpy: far points are written first, near ones over them."""
    drawn = np.full((len(world_from_cam), CAMERA.height_px, CAMERA.width_px), -1.0)
    for view, cam_from_world in zip(drawn, se3.inverse(world_from_cam), strict=True):
        points_cam = se3.transform(cam_from_world, scene.points_world)
        pixels, z = pinhole.project(points_cam, CAMERA)
        column, row = np.floor(np.nan_to_num(pixels, nan=-1) + 0.5).astype(np.int64).T
        seen = np.flatnonzero((z > 0) & (column >= 0) & (column < view.shape[1]) & (row >= 0) & (row < view.shape[0]))
        seen = seen[np.argsort(-z[seen])]
        view[row[seen], column[seen]] = 1 / z[seen]
    return drawn


def draw_open3d(scene: Street, world_from_cam: FloatArray) -> FloatArray:
    """Inverse depth [F, H, W] by Open3D's projection of a coloured cloud."""
    import open3d as o3d

    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor.from_numpy(scene.points_world.astype(np.float32)))
    cloud.point.colors = o3d.core.Tensor.from_numpy(scene.colours.astype(np.float32) / 255)
    matrix = o3d.core.Tensor.from_numpy(CAMERA.matrix)
    drawn = []
    for cam_from_world in se3.inverse(world_from_cam):
        extrinsic = o3d.core.Tensor.from_numpy(cam_from_world)
        size = (CAMERA.width_px, CAMERA.height_px)
        image = cloud.project_to_rgbd_image(*size, matrix, extrinsic, depth_scale=1.0, depth_max=10 * FARTHEST_M)
        depth = image.depth.as_tensor().numpy()[..., 0]
        drawn.append(np.where(depth > 0, 1 / np.where(depth > 0, depth, 1), -1.0))
    return np.stack(drawn)


WAYS: dict[str, Callable[[Street, FloatArray], FloatArray]] = {
    "splat": draw_splat,
    "Open3D project_to_rgbd_image": draw_open3d,
    "numpy z-buffer": draw_numpy,
}


@single_threaded_blas
def measure(rounds: int) -> Timing:
    """Time all ways in turns, once each before the clock runs."""
    scene, world_from_cam = street()
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in WAYS}
    for count in range(rounds + 1):
        for name, draw in WAYS.items():
            clock, processor = time.perf_counter(), time.process_time()
            draw(scene, world_from_cam)
            if count:
                taken[name].append((time.perf_counter() - clock, time.process_time() - processor))
    seconds = {name: np.array(times) for name, times in taken.items()}
    with tempfile.TemporaryDirectory() as folder:
        return Timing(len(scene.points_world), seconds, (_first_s(folder), _first_s(folder)))


def _first_s(cache: str) -> float:
    """Seconds of the first drawing of a process that keeps compiled code in the folder."""
    command, environment = [sys.executable, "-c", FIRST_IMAGES], {**os.environ, "NUMBA_CACHE_DIR": cache}
    return float(subprocess.run(command, check=True, env=environment, capture_output=True, text=True).stdout)


@command
def main(arguments: Sequence[str]) -> str:
    """The timing in words."""
    (rounds,) = whole_numbers(arguments, (10,), "[ROUNDS]")
    return "\n".join(measure(rounds).lines())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
