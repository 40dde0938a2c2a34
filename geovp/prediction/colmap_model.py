"""COLMAP model of a reconstructed scene: camera, poses, and a coloured point cloud with tracks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import ndimage

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views


def build_model(
    camera: Intrinsics,
    names: Sequence[str],  # T image files
    world_from_cam: FloatArray,  # [T, 4, 4]
    views: Views,  # [P <= T], of the first images
    max_difference: float = 0.02,  # relative, of the depths of a point and of the view that sees it
) -> Any:
    """Return a pycolmap.Reconstruction with the points of the views.

    The track of a point holds the views with its depth. COLMAP's pixel coordinates start at the
    image's corner, ours at the first pixel's centre: they are 0.5 larger.
    """
    from geovp_classic.colmap_library import pycolmap
    from geovp_classic.geometry.bundle_adjustment import reconstruction

    points, colours = _cloud(views, world_from_cam, camera)
    cam_from_world = se3.inverse(world_from_cam)
    pixels = np.full((len(names), len(points), 2), np.nan)
    for number, pose in enumerate(cam_from_world[: len(views.depths)]):
        projected, depth = pinhole.project(se3.transform(pose, points), camera)
        shown = np.where(views.covered[number], views.depths[number], 0.0)
        # 0 outside of the view
        seen = ndimage.map_coordinates(shown, projected.T[::-1], order=0, mode="grid-constant")
        is_visible = np.abs(seen / depth - 1) < max_difference
        pixels[number, is_visible] = projected[is_visible] + 0.5
    params = [camera.fx_px, camera.fy_px, camera.cx_px + 0.5, camera.cy_px + 0.5]
    pinhole_camera = pycolmap.Camera(
        camera_id=1, model="PINHOLE", params=params, width=camera.width_px, height=camera.height_px
    )
    model = reconstruction(cam_from_world, points, pixels, pinhole_camera)
    for number, name in enumerate(names, 1):
        model.image(number).name = name
    for number, colour in enumerate(colours, 1):
        model.point3D(number).color = colour
    return model


def _cloud(
    views: Views,  # [P]
    world_from_cam: FloatArray,  # [T, 4, 4]
    camera: Intrinsics,
    # Of the rays from a moving camera's first and last place: depth is then known to 5 % if pixels
    # are matched to a quarter, at a focal length of 600 px
    min_angle_deg: float = 0.5,
    voxels_per_median_depth: float = 200.0,
) -> tuple[FloatArray, ByteArray]:
    """Return points [N, 3] in the world and colours [N, 3] of covered pixels, one per voxel."""
    # All surfaces that the views show
    is_surface = views.covered & np.isfinite(views.depths) & (views.depths > 0)
    depths, colours = views.depths[is_surface].astype(float), views.frames[is_surface]
    view, row, column = np.nonzero(is_surface)
    points = pinhole.unproject(np.stack([column, row], axis=1).astype(float), depths, camera)
    for number, pose in enumerate(world_from_cam):
        points[view == number] = se3.transform(pose, points[view == number])
    # Those whose depth the motion of the camera shows
    first, last = world_from_cam[[0, len(views.depths) - 1], :3, 3]
    if not np.array_equal(first, last):
        is_measured = _angles_rad(points - first, points - last) >= np.radians(min_angle_deg)
        points, depths, colours = points[is_measured], depths[is_measured], colours[is_measured]
    # One for each voxel
    median = np.median(depths) if len(depths) else 1.0
    grid = (points - points.min(axis=0, initial=0.0)) * voxels_per_median_depth / median
    keys = grid.astype(np.int64) @ [1, 2**21, 2**42]
    _, numbers = np.unique(keys, return_index=True)
    return points[numbers], colours[numbers]


def _angles_rad(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles between vectors [N, 3]."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
