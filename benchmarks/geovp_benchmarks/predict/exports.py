"""Export of scenes: a coloured point cloud (PLY), a COLMAP model, and depth maps (16-bit PNG).

The cloud of a scene is unprojected from its views, so that all kinds of scenes have one.
"""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, FloatArray, IntArray, Intrinsics, Views


def cloud(
    views: Views,  # [F]
    world_from_cam: FloatArray,  # [F, 4, 4]
    camera: Intrinsics,
    max_median_depths: float = 10.0,  # farther points are sky
    voxels_per_median_depth: float = 400.0,  # points in one voxel are averaged
) -> tuple[FloatArray, ByteArray]:
    """Return the points [N, 3] in the world and colours [N, 3] of the covered pixels."""
    is_surface = views.covered & np.isfinite(views.depths) & (views.depths > 0)
    if not is_surface.any():
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    median = float(np.median(views.depths[is_surface]))
    is_surface &= views.depths <= max_median_depths * median
    grid = pinhole.pixel_grid(camera)
    points = []
    for mask, depth, pose in zip(is_surface, views.depths, world_from_cam, strict=True):
        points_cam = pinhole.unproject(grid[mask], depth[mask].astype(np.float64), camera)
        points.append(se3.transform(pose, points_cam))
    colours = views.frames[is_surface]
    return _average_voxels(np.concatenate(points), colours, median / voxels_per_median_depth)


def _average_voxels(
    points: FloatArray, colours: ByteArray, voxel: float
) -> tuple[FloatArray, ByteArray]:
    """Return the mean point [M, 3] and the mean colour [M, 3] of each occupied voxel."""
    grid = np.floor((points - points.min(axis=0)) / voxel).astype(np.int64)
    keys = np.ravel_multi_index(tuple(grid.T), tuple(grid.max(axis=0) + 1))
    _, voxels, counts = np.unique(keys, return_inverse=True, return_counts=True)
    columns = [*points.T, *colours.T]
    means = np.stack([np.bincount(voxels, column) / counts for column in columns], axis=1)
    return means[:, :3], np.rint(means[:, 3:]).astype(np.uint8)


def write_ply(path: Path, points: FloatArray, colours: ByteArray) -> None:
    """Write a binary PLY file of coloured points [N, 3]."""
    types = {"x": "<f8", "y": "<f8", "z": "<f8", "red": "u1", "green": "u1", "blue": "u1"}
    rows = np.rec.fromarrays([*points.T, *colours.T], dtype=list(types.items()))
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [
        f"property {'double' if kind == '<f8' else 'uchar'} {n}" for n, kind in types.items()
    ]
    header += ["end_header", ""]
    try:
        path.write_bytes("\n".join(header).encode() + rows.tobytes())
    except OSError as error:
        raise BadData(
            f"{path} cannot be written: give a folder that exists and has room"
        ) from error


def write_colmap(
    folder: Path,
    camera: Intrinsics,
    images: Mapping[str, ByteArray],  # T frames [H, W, 3] by file name
    world_from_cam: FloatArray,  # [T, 4, 4]
    points: FloatArray,  # [N, 3]
    colours: ByteArray,  # [N, 3]
    depths: FloatArray,  # [P <= T, H, W], of the first images, for the tracks
    max_points: int = 50_000,
) -> None:
    """Write `sparse/0` and `images`, the layout that nerfstudio and gsplat read.

    COLMAP's pixel coordinates start at the image's corner, ours at the first pixel's centre: its
    principal point is 0.5 larger. The track of a point holds the images with its depth there.
    """
    from geovp_classic.colmap_library import pycolmap

    for name, frame in images.items():
        write_png(folder / "images" / name, frame)
    subset = np.linspace(0, len(points) - 1, min(len(points), max_points)).astype(int)
    points, colours = points[subset], colours[subset]
    model = pycolmap.Reconstruction()
    params = [camera.fx_px, camera.fy_px, camera.cx_px + 0.5, camera.cy_px + 0.5]
    size = {"width": camera.width_px, "height": camera.height_px}
    lens = pycolmap.Camera(model="PINHOLE", params=params, camera_id=1, **size)
    model.add_camera_with_trivial_rig(lens)
    tracks = [pycolmap.Track() for _ in points]
    poses = se3.inverse(world_from_cam)
    for image_id, (name, pose) in enumerate(zip(images, poses, strict=True), 1):
        image = pycolmap.Image(name=name, camera_id=1, image_id=image_id)
        if image_id <= len(depths):
            visible, pixels = _visible(points, pose, camera, depths[image_id - 1])
            points_2d = [pycolmap.Point2D(pixel + 0.5) for pixel in pixels]
            image.points2D = pycolmap.Point2DList(points_2d)
            for index, point in enumerate(visible):
                tracks[point].add_element(image_id, index)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    for point, track, colour in zip(points, tracks, colours, strict=True):
        model.add_point3D(point, track, colour)
    sparse = folder / "sparse" / "0"
    sparse.mkdir(parents=True)
    model.write_binary(str(sparse))


def _visible(
    points: FloatArray,  # [N, 3]
    cam_from_world: FloatArray,  # [4, 4]
    camera: Intrinsics,
    depth: FloatArray,  # [H, W]
    max_depth_difference: float = 0.02,  # relative
) -> tuple[IntArray, FloatArray]:
    """Return the indices [M] and pixels [M, 2] of the points on the surface of a depth map."""
    points_cam = se3.transform(cam_from_world, points)
    indices = np.flatnonzero(points_cam[:, 2] > 0)
    pixels, _ = pinhole.project(points_cam[indices], camera)
    nearest = np.rint(pixels)
    is_inside = ((nearest >= 0) & (nearest < depth.shape[::-1])).all(axis=1)
    indices, pixels = indices[is_inside], pixels[is_inside]
    columns, rows = nearest[is_inside].astype(int).T
    ratios = depth[rows, columns] / points_cam[indices, 2]
    is_visible = np.abs(ratios - 1) < max_depth_difference
    return indices[is_visible], pixels[is_visible]


def depth_scale(
    depths: FloatArray,  # [...], 0 = unknown
    is_metric: bool,
) -> float:
    """Return the values of a 16-bit depth map per unit of length.

    Metric depths have 256 values per metre, as KITTI's; other depths have their median at 16384.
    """
    is_surface = np.isfinite(depths) & (depths > 0)
    if is_metric or not is_surface.any():
        return 256.0
    return float(16384 / np.median(depths[is_surface]))


def write_depth(path: Path, depth: FloatArray, scale: float) -> None:
    """Write a depth map [H, W] as a 16-bit PNG with values of depth * scale.

    The value is 0 where unknown, 1 or more where known, and 65535 beyond the range.
    """
    values = np.clip(np.rint(depth * scale), 1, 65535)
    values = np.where(depth > 0, values, 0).astype(np.uint16)
    path.write_bytes(cv2.imencode(".png", values)[1].tobytes())


def write_png(path: Path, image: ByteArray) -> None:
    """Write an image [H, W, 3] and the folder that it lies in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes())
