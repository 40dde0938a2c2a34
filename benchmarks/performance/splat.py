"""Points per second of the splat, compared with Open3D's projection and a z-buffer in numpy.

`PYTHONPATH=benchmarks python -m performance.splat [ROUNDS]`

The cloud of three 256x256 frames with depth is rendered at 20 poses ahead. All three render the
same points at the same poses, alternately, so that other load slows all of them; CPU time of all
threads is shown beside wall-clock time. BLAS, which numpy's z-buffer needs, runs on one thread:
that is as fast for it, and idle BLAS threads would slow the others. The splat renders surfaces,
each point as a square of its own size; the other two set one pixel per point.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.parallel import single_threaded_blas
from geovp_classic.rendering.patches import Patches, PatchModel, concatenate
from geovp_classic.rendering.source import Source
from geovp_classic.types import ByteArray, FloatArray, Intrinsics
from performance import Seconds, rounds_parser, timed

CAMERA = Intrinsics(480.0, 480.0, 127.5, 127.5, 256, 256)
NUM_SOURCES, NUM_VIEWS, STEP_M = 3, 20, 1.0
HEIGHT_M, HALF_WIDTH_M, FARTHEST_M = 1.65, 6.0, 80.0


@dataclass(frozen=True)
class Street:
    """A cloud in the forms that the three renderers need."""

    cloud: Patches
    sources: list[Source]
    points_world: FloatArray  # [N, 3]
    colours: ByteArray  # [N, 3]


def lines(
    seconds: Mapping[str, FloatArray],  # [rounds, 2] by name, all views, wall clock and CPU
    num_points: int,
) -> list[str]:
    """Medians over rounds, as lines of text."""
    found = [f"{num_points} points, {NUM_VIEWS} views of {CAMERA.width_px}x{CAMERA.height_px}"]
    for name, taken in seconds.items():
        clock_s, processor_s = np.median(taken, axis=0)
        speed = f"{num_points * NUM_VIEWS / clock_s / 1e6:.1f} million points/s"
        found.append(
            f"{name}: {speed}, {1e3 * clock_s:.0f} ms, of the processor {1e3 * processor_s:.0f} ms"
        )
    return found


def street() -> tuple[Street, FloatArray]:
    """A road between walls, observed by three frames, and the poses [F, 4, 4] to render."""
    track = se3.compose(
        np.eye(3), np.outer(np.arange(NUM_SOURCES + NUM_VIEWS) * STEP_M, [0.0, 0.0, 1.0])
    )
    rays = pinhole.rays(CAMERA)
    road, wall = rays[..., 1] / HEIGHT_M, np.abs(rays[..., 0]) / HALF_WIDTH_M
    inverse_depth = np.maximum(np.maximum(road, wall), 1 / FARTHEST_M).astype(np.float32)
    colours = np.random.default_rng(0).integers(0, 256, (*inverse_depth.shape, 3), dtype=np.uint8)
    sources = [Source(colours, CAMERA, pose) for pose in track[:NUM_SOURCES]]
    known = np.ones(inverse_depth.shape, dtype=bool)
    model = PatchModel()
    cloud = concatenate(
        [model.from_depth_map(inverse_depth, known, number) for number in range(NUM_SOURCES)]
    )
    points_cam = (rays / inverse_depth[..., None]).reshape(-1, 3)
    points_world = np.concatenate([se3.transform(pose, points_cam) for pose in track[:NUM_SOURCES]])
    return Street(
        cloud, sources, points_world, np.tile(colours.reshape(-1, 3), (NUM_SOURCES, 1))
    ), track[NUM_SOURCES:]


def draw_splat(scene: Street, world_from_cam: FloatArray) -> FloatArray:
    """Inverse depth [F, H, W] by our splat."""
    return PatchModel().rasterise(scene.cloud, scene.sources, world_from_cam, CAMERA)[0]


def draw_numpy(scene: Street, world_from_cam: FloatArray) -> FloatArray:
    """Inverse depth [F, H, W] by a z-buffer in numpy: the painter's algorithm, far points first."""
    drawn = np.full((len(world_from_cam), CAMERA.height_px, CAMERA.width_px), -1.0)
    for view, cam_from_world in zip(drawn, se3.inverse(world_from_cam), strict=True):
        points_cam = se3.transform(cam_from_world, scene.points_world)
        pixels, z = pinhole.project(points_cam, CAMERA)
        column, row = np.floor(np.nan_to_num(pixels, nan=-1) + 0.5).astype(np.int64).T
        seen = np.flatnonzero(
            (z > 0) & (column >= 0) & (column < view.shape[1]) & (row >= 0) & (row < view.shape[0])
        )
        seen = seen[np.argsort(-z[seen])]
        view[row[seen], column[seen]] = 1 / z[seen]
    return drawn


def draw_open3d(scene: Street, world_from_cam: FloatArray) -> FloatArray:
    """Inverse depth [F, H, W] by Open3D's projection of a coloured cloud."""
    import open3d as o3d

    cloud = o3d.t.geometry.PointCloud(
        o3d.core.Tensor.from_numpy(scene.points_world.astype(np.float32))
    )
    cloud.point.colors = o3d.core.Tensor.from_numpy(scene.colours.astype(np.float32) / 255)
    matrix = o3d.core.Tensor.from_numpy(CAMERA.matrix)
    drawn = []
    for cam_from_world in se3.inverse(world_from_cam):
        extrinsic = o3d.core.Tensor.from_numpy(cam_from_world)
        size = (CAMERA.width_px, CAMERA.height_px)
        image = cloud.project_to_rgbd_image(
            *size, matrix, extrinsic, depth_scale=1.0, depth_max=10 * FARTHEST_M
        )
        depth = image.depth.as_tensor().numpy()[..., 0]
        drawn.append(np.where(depth > 0, 1 / np.where(depth > 0, depth, 1), -1.0))
    return np.stack(drawn)


RENDERERS: dict[str, Callable[[Street, FloatArray], FloatArray]] = {
    "splat": draw_splat,
    "Open3D project_to_rgbd_image": draw_open3d,
    "numpy z-buffer": draw_numpy,
}


@single_threaded_blas
def measure(rounds: int) -> list[str]:
    """Time all renderers alternately, after one round of warm-up."""
    scene, world_from_cam = street()
    taken: dict[str, list[Seconds]] = {name: [] for name in RENDERERS}
    for _ in range(rounds + 1):
        for name, draw in RENDERERS.items():
            taken[name].append(timed(functools.partial(draw, scene, world_from_cam))[1])
    return lines(
        {name: np.array(times[1:]) for name, times in taken.items()}, len(scene.points_world)
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the timing."""
    parser = rounds_parser(
        "performance.splat", "Points per second of three ways to render a point cloud.", 10
    )
    print(*measure(parser.parse_args(arguments).rounds), sep="\n")


if __name__ == "__main__":
    main()
