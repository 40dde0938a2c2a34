"""Scenes as files that other programs open: a coloured cloud (PLY), a COLMAP model, depth maps
(16-bit PNG).

The cloud of a scene is unprojected from its views, so that it exists for every kind of scene.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views

FARTHEST_MEDIANS = 10.0  # depths beyond this many medians are sky and give no points
POINTS_PER_MEDIAN = 400  # voxels per median depth; points in one voxel become one
METRIC_SCALE = 256.0  # as KITTI's depth maps: 1/256 m
FARTHEST_VALUE = 65535  # infinitely far, or beyond 16 bits
MEDIAN_VALUE = 16384.0  # of the median depth where the unit is unknown: a quarter of 16 bits


def cloud(
    views: Views,  # [F]
    world_from_cam: FloatArray,  # [F, 4, 4]
    camera: Intrinsics,
) -> tuple[FloatArray, ByteArray]:
    """Points [N, 3] in the world and colours [N, 3] of all that the views cover, thinned out; no
    sky.
    """
    known = views.covered & np.isfinite(views.depths) & (views.depths > 0)
    if not known.any():
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    median = float(np.median(views.depths[known]))
    known &= views.depths <= FARTHEST_MEDIANS * median
    grid, parts = pinhole.pixel_grid(camera), []
    for good, depth, pose in zip(known, views.depths, world_from_cam, strict=True):
        points_cam = pinhole.unproject(grid[good], depth[good].astype(np.float64), camera)
        parts.append(se3.transform(pose, points_cam))
    colours = np.concatenate([frame[good] for frame, good in zip(views.frames, known, strict=True)])
    return _thinned(np.concatenate(parts), colours, median / POINTS_PER_MEDIAN)


def _thinned(points: FloatArray, colours: ByteArray, voxel: float) -> tuple[FloatArray, ByteArray]:
    """The mean point [M, 3] and the mean colour [M, 3] of each voxel that holds some of the points
    [N, 3].
    """
    cells = np.floor((points - points.min(axis=0)) / voxel).astype(np.int64)
    keys = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, voxels, counts = np.unique(keys, return_inverse=True, return_counts=True)
    columns = [*points.T, *colours.T]
    means = np.stack([np.bincount(voxels, column) / counts for column in columns], axis=1)
    return means[:, :3], np.rint(means[:, 3:]).astype(np.uint8)


def write_ply(path: Path, points: FloatArray, colours: ByteArray) -> None:
    """A binary PLY file of coloured points [N, 3]."""
    names = [
        ("x", "<f8"),
        ("y", "<f8"),
        ("z", "<f8"),
        ("red", "u1"),
        ("green", "u1"),
        ("blue", "u1"),
    ]
    rows = np.rec.fromarrays([*points.T, *colours.T], dtype=names)
    kinds = {"<f8": "double", "u1": "uchar"}
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    lines += [*(f"property {kinds[kind]} {name}" for name, kind in names), "end_header", ""]
    try:
        path.write_bytes("\n".join(lines).encode() + rows.tobytes())
    except OSError as error:
        raise BadData(
            f"{path} cannot be written: give a folder that exists and has room"
        ) from error


def write_colmap(
    folder: Path,
    camera: Intrinsics,
    names: Sequence[str],  # T, of the images
    world_from_cam: FloatArray,  # [T, 4, 4]
    points: FloatArray,  # [N, 3]
    colours: ByteArray,  # [N, 3]
) -> None:
    """A COLMAP model as binary and as text files: one pinhole camera, a pose for every image, the
    points.

    COLMAP's pixel coordinates start at the image's corner, ours at the first pixel's centre: its
    principal point is 0.5 larger. Points have no tracks: they come from dense depth, not from
    matched features.
    """
    from geovp_classic.colmap_library import pycolmap

    model = pycolmap.Reconstruction()
    params = [camera.fx_px, camera.fy_px, camera.cx_px + 0.5, camera.cy_px + 0.5]
    size = {"width": camera.width_px, "height": camera.height_px}
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="PINHOLE", params=params, camera_id=1, **size)
    )
    for number, (name, cam_from_world) in enumerate(
        zip(names, se3.inverse(world_from_cam), strict=True), 1
    ):
        image = pycolmap.Image(name=name, camera_id=1, image_id=number)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(cam_from_world[:3, :3]), cam_from_world[:3, 3])
        model.add_image_with_trivial_frame(image, pose)
    for point, colour in zip(points, colours, strict=True):
        model.add_point3D(point, pycolmap.Track(), colour)
    folder.mkdir(parents=True, exist_ok=True)
    model.write_binary(str(folder))
    model.write_text(str(folder))


def depth_scale(
    depths: FloatArray,  # [...], 0 = unknown
    is_metric: bool,
) -> float:
    """Values of a 16-bit depth map per unit of length: 256 where that is the metre, else by the
    median depth.
    """
    known = np.isfinite(depths) & (depths > 0)
    if is_metric or not known.any():
        return METRIC_SCALE
    return float(MEDIAN_VALUE / np.median(depths[known]))


def write_depth(path: Path, depth: FloatArray, scale: float) -> None:
    """A 16-bit PNG of the depth map [H, W]: depth * scale, 0 where unknown, 65535 infinitely far or
    beyond.

    Depths that are known but nearer than one value are written as 1.
    """
    values = np.clip(np.rint(np.where(depth > 0, depth, 0) * scale), 1, FARTHEST_VALUE)
    values = np.where(depth > 0, values, 0).astype(np.uint16)
    path.write_bytes(cv2.imencode(".png", values)[1].tobytes())
