"""COLMAP model of a reconstructed scene: camera, poses, and a coloured point cloud with tracks."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics, Views


def build_model(
    camera: Intrinsics,
    names: Sequence[str],  # T image files
    world_from_cam: FloatArray,  # [T, 4, 4]
    views: Views,  # [P <= T], of the first images
    max_depth_difference: float = 0.02,  # relative, between a point and a view that shows it
) -> Any:
    """Return a pycolmap.Reconstruction with the points of the views.

    The track of a point holds the views with its depth. COLMAP's pixel coordinates start at the
    image's corner, ours at the first pixel's centre: they are 0.5 larger.
    """
    from geovp_classic.colmap_library import pycolmap

    points, colours = _cloud(views, world_from_cam, camera)
    model = pycolmap.Reconstruction()
    params = [camera.fx_px, camera.fy_px, camera.cx_px + 0.5, camera.cy_px + 0.5]
    size_px = (camera.width_px, camera.height_px)
    lens = pycolmap.Camera(camera_id=1, model="PINHOLE", params=params)
    lens.width, lens.height = size_px
    model.add_camera_with_trivial_rig(lens)
    tracks = [pycolmap.Track() for _ in points]
    for number, (name, pose) in enumerate(zip(names, se3.inverse(world_from_cam), strict=True)):
        pixels, depth = pinhole.project(se3.transform(pose, points), camera)
        visible = np.zeros(0, int)
        if number < len(views.depths):
            is_inside = (pixels > -0.5) & (pixels < np.array(size_px) - 0.5)
            visible = np.flatnonzero(is_inside.all(axis=1))
            column, row = np.rint(pixels[visible]).astype(int).T
            shown = np.where(views.covered[number], views.depths[number], 0.0)[row, column]
            is_shown = np.abs(shown / depth[visible] - 1) < max_depth_difference
            visible = visible[is_shown]
        for keypoint, point in enumerate(visible):
            tracks[point].add_element(number + 1, keypoint)
        image = pycolmap.Image(name=name, keypoints=pixels[visible] + 0.5, camera_id=1)
        image.image_id = number + 1
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    for point, track, colour in zip(points, tracks, colours, strict=True):
        model.add_point3D(point, track, colour)
    return model


def _cloud(
    views: Views,  # [P]
    world_from_cam: FloatArray,  # [T, 4, 4]
    camera: Intrinsics,
    max_median_depths: float = 10.0,  # farther points are sky
    voxels_per_median_depth: float = 200.0,
) -> tuple[FloatArray, ByteArray]:
    """Return points [N, 3] in the world and colours [N, 3] of covered pixels, one per voxel."""
    is_surface = views.covered & np.isfinite(views.depths) & (views.depths > 0)
    median = np.median(views.depths[is_surface]) if is_surface.any() else 1.0
    is_surface &= views.depths <= max_median_depths * median
    view, row, column = np.nonzero(is_surface)
    pixels = np.stack([column, row], axis=1).astype(float)
    points = pinhole.unproject(pixels, views.depths[is_surface].astype(float), camera)
    for number, pose in enumerate(world_from_cam):
        points[view == number] = se3.transform(pose, points[view == number])
    grid = (points - points.min(axis=0, initial=0.0)) * voxels_per_median_depth / median
    voxels = tuple(grid.astype(int).T)
    keys = np.ravel_multi_index(voxels, tuple(axis.max(initial=0) + 1 for axis in voxels))
    _, first = np.unique(keys, return_index=True)
    return points[first], views.frames[is_surface][first]
