"""Exported files are read back by other programs."""

from pathlib import Path

import cv2
import numpy as np
import open3d as o3d
import pycolmap
import pytest

from geovp_benchmarks.predict import exports
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics, Views

CAMERA = Intrinsics(50.0, 40.0, 15.5, 11.5, 32, 24)
POSES = se3.exp(np.array([[1.0, 2.0, 3.0, 0.1, -0.2, 0.3], [1.0, 2.0, 4.0, 0.1, 0.4, 0.3]]))


def views_of(depths: FloatArray, covered: FloatArray | None = None) -> Views:
    frames = np.full((*depths.shape, 3), [200, 100, 50], np.uint8)
    return Views(frames, depths > 0 if covered is None else covered, depths.astype(np.float32))


def test_points_of_the_cloud_lie_on_the_surfaces() -> None:
    depths = np.zeros((2, 24, 32))
    depths[0, 5, 7] = 4.0
    depths[1, 20, 30] = 6.0
    points, colours = exports.cloud(views_of(depths), POSES, CAMERA)
    points_cam = np.array([[(7 - 15.5) / 50, (5 - 11.5) / 40, 1], [14.5 / 50, 8.5 / 40, 1]])
    first = se3.transform(POSES[0], 4 * points_cam[:1])
    second = se3.transform(POSES[1], 6 * points_cam[1:])
    order = np.argsort(np.linalg.norm(points - first, axis=1))
    np.testing.assert_allclose(points[order], np.concatenate([first, second]), atol=1e-6)
    assert colours.tolist() == [[200, 100, 50]] * 2


def test_sky_and_uncovered_pixels_give_no_points_and_double_points_are_merged() -> None:
    depths = np.full((2, 24, 32), 5.0)
    depths[:, :12] = np.inf
    covered = np.ones(depths.shape, bool)
    covered[:, :, :16] = False
    points, _ = exports.cloud(views_of(depths, covered), POSES[[0, 0]], CAMERA)
    assert len(points) == 12 * 16
    points, colours = exports.cloud(views_of(np.full((2, 24, 32), np.inf)), POSES, CAMERA)
    assert points.shape == colours.shape == (0, 3)


def test_open3d_reads_the_cloud(tmp_path: Path) -> None:
    points = np.array([[1.0, 2, 3], [4, 5, 6.5]])
    colours = np.array([[0, 128, 255], [1, 2, 3]], np.uint8)
    exports.write_ply(tmp_path / "cloud.ply", points, colours)
    read = o3d.io.read_point_cloud(str(tmp_path / "cloud.ply"))
    np.testing.assert_allclose(np.asarray(read.points), points)
    np.testing.assert_allclose(np.asarray(read.colors) * 255, colours, atol=0.01)
    with pytest.raises(BadData, match="cannot be written"):
        exports.write_ply(tmp_path / "nowhere/cloud.ply", points, colours)


def test_colmap_projects_a_point_to_the_same_pixel_and_tracks_it(tmp_path: Path) -> None:
    point_cam = np.array([[0.3, -0.2, 5.0]])
    point = se3.transform(POSES[0], point_cam)
    colours = np.array([[9, 8, 7]], np.uint8)
    frame = np.full((24, 32, 3), [200, 100, 50], np.uint8)
    images = {"a.png": frame, "b.png": frame}
    depths = np.stack([np.full((24, 32), 5.0), np.full((24, 32), 50.0)])  # b shows a farther wall
    exports.write_colmap(tmp_path, CAMERA, images, POSES, point, colours, depths)
    assert (cv2.imread(str(tmp_path / "images" / "b.png"))[..., ::-1] == frame).all()
    model = pycolmap.Reconstruction(str(tmp_path / "sparse" / "0"))
    assert model.num_images() == 2
    (stored,) = model.points3D.values()
    assert stored.color.tolist() == [9, 8, 7]
    image = model.find_image_with_name("a.png")
    pixel, _ = pinhole.project(point_cam[0], CAMERA)
    np.testing.assert_allclose(image.project_point(stored.xyz), pixel + 0.5, atol=1e-6)
    matrix = image.cam_from_world().matrix()
    np.testing.assert_allclose(matrix, se3.inverse(POSES[0])[:3], atol=1e-9)
    (element,) = stored.track.elements
    assert element.image_id == image.image_id
    np.testing.assert_allclose(image.points2D[element.point2D_idx].xy, pixel + 0.5, atol=1e-6)


def test_depth_maps_have_the_values_of_kitti(tmp_path: Path) -> None:
    depth = np.array([[0.0, 1.0], [np.inf, 300.0], [0.001, 10.5]])
    scale = exports.depth_scale(depth, is_metric=True)
    exports.write_depth(tmp_path / "depth.png", depth, scale)
    values = cv2.imread(str(tmp_path / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert values.dtype == np.uint16
    assert values.tolist() == [[0, 256], [65535, 65535], [1, 2688]]


def test_depths_without_a_unit_are_scaled_by_their_median() -> None:
    depth = np.array([0.0, 0.01, 0.02, 0.03, np.inf])
    assert exports.depth_scale(depth, is_metric=False) == pytest.approx(16384 / 0.02)
