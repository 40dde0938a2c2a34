"""The splat, next to Open3D's projection of the same points to the same poses.

The cloud of three 256x256 frames with depth is rendered at 20 poses ahead. The splat renders
surfaces, each point as a square of its own size; Open3D sets one pixel per point.
"""

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.rendering.patches import PatchModel, concatenate
from geovp_classic.rendering.source import Source
from geovp_classic.types import ByteArray, FloatArray, Intrinsics
from performance import Comparison


def comparison(num_views: int = 20) -> Comparison:
    """Return the comparison on a road between walls, observed by three frames, a metre apart."""
    camera = Intrinsics(480.0, 480.0, 127.5, 127.5, 256, 256)
    along = np.outer(np.arange(3.0 + num_views), [0.0, 0.0, 1.0])
    track = se3.compose(np.eye(3), along)
    past = track[:3]
    views = track[3:]
    rays = pinhole.rays(camera)
    road = rays[..., 1] / 1.65  # inverse depth, of a road 1.65 m below
    walls = np.abs(rays[..., 0]) / 6.0
    inverse_depth = np.maximum(np.maximum(road, walls), 1 / 80).astype(np.float32)
    colours = np.random.default_rng(0).integers(0, 256, (256, 256, 3), dtype=np.uint8)
    sources = [Source(colours, camera, pose) for pose in past]
    model = PatchModel()
    is_known = np.ones(inverse_depth.shape, dtype=bool)
    cloud = concatenate([model.from_depth_map(inverse_depth, is_known, n) for n in range(3)])
    in_camera = (rays / inverse_depth[..., None]).reshape(-1, 3)
    points = np.concatenate([se3.transform(pose, in_camera) for pose in past])
    point_colours = np.tile(colours.reshape(-1, 3), (3, 1))
    return Comparison(
        f"splat of {len(points)} points in {num_views} views",
        lambda: model.rasterise(cloud, sources, views, camera)[0],
        "Open3D",
        lambda: project_by_open3d(points, point_colours, views, camera),
    )


def project_by_open3d(
    points: FloatArray,  # [N, 3]
    colours: ByteArray,  # [N, 3]
    world_from_cam: FloatArray,  # [F, 4, 4]
    camera: Intrinsics,
) -> FloatArray:
    """Return inverse depth [F, H, W], 0 where there is no point."""
    import open3d as o3d

    def tensor(values: FloatArray) -> o3d.core.Tensor:
        return o3d.core.Tensor.from_numpy(values)

    cloud = o3d.t.geometry.PointCloud(tensor(points.astype(np.float32)))
    cloud.point.colors = tensor(colours.astype(np.float32) / 255)
    depths = []
    for cam_from_world in se3.inverse(world_from_cam):
        image = cloud.project_to_rgbd_image(
            camera.width_px,
            camera.height_px,
            tensor(camera.matrix),
            tensor(cam_from_world),
            depth_scale=1.0,
            depth_max=800.0,
        )
        depths.append(image.depth.as_tensor().numpy()[..., 0])
    depth = np.stack(depths)
    return np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
