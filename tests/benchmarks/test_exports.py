"""What is written is read back by other programs as what it was."""

from pathlib import Path

import cv2
import numpy as np
import open3d as o3d
import pycolmap
import pytest

from geovp_benchmarks import exports
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import FloatArray, Intrinsics, Views

CAMERA = Intrinsics(50.0, 40.0, 15.5, 11.5, 32, 24)
POSES = se3.exp(np.array([[1.0, 2.0, 3.0, 0.1, -0.2, 0.3], [1.0, 2.0, 4.0, 0.1, 0.4, 0.3]]))


def views_of(depths: FloatArray) -> Views:
    frames = np.full((*depths.shape, 3), [200, 100, 50], np.uint8)
    return Views(frames, depths > 0, depths.astype(np.float32))


def test_the_cloud_lies_where_the_surfaces_are() -> None:
    depths = np.zeros((2, 24, 32))
    depths[0, 5, 7], depths[1, 20, 30] = 4.0, 6.0
    points, colours = exports.cloud(views_of(depths), POSES, CAMERA)
    first = se3.transform(POSES[0], np.array([[4 * (7 - 15.5) / 50, 4 * (5 - 11.5) / 40, 4.0]]))[0]
    second = se3.transform(POSES[1], np.array([[6 * (30 - 15.5) / 50, 6 * (20 - 11.5) / 40, 6.0]]))[
        0
    ]
    found = points[np.argsort(np.linalg.norm(points - first, axis=1))]
    np.testing.assert_allclose(found, [first, second], atol=1e-6)
    assert colours.tolist() == [[200, 100, 50]] * 2


def test_sky_and_what_was_invented_give_no_points_and_doubles_become_one() -> None:
    depths = np.full((2, 24, 32), 5.0)
    depths[:, :12] = np.inf
    views = views_of(depths)
    covered = views.covered.copy()
    covered[:, :, :16] = False
    once = Views(views.frames, covered, views.depths)
    points, _ = exports.cloud(once, POSES[[0, 0]], CAMERA)
    assert len(points) == 12 * 16
    assert (
        points.shape
        == exports.cloud(Views(once.frames[:1], covered[:1], once.depths[:1]), POSES[:1], CAMERA)[
            0
        ].shape
    )


def test_a_scene_of_sky_has_an_empty_cloud() -> None:
    points, colours = exports.cloud(views_of(np.full((2, 24, 32), np.inf)), POSES, CAMERA)
    assert points.shape == colours.shape == (0, 3)


def test_open3d_reads_the_cloud(tmp_path: Path) -> None:
    points, colours = (
        np.array([[1.0, 2, 3], [4, 5, 6.5]]),
        np.array([[0, 128, 255], [1, 2, 3]], np.uint8),
    )
    exports.write_ply(tmp_path / "cloud.ply", points, colours)
    read = o3d.io.read_point_cloud(str(tmp_path / "cloud.ply"))
    np.testing.assert_allclose(np.asarray(read.points), points)
    np.testing.assert_allclose(np.asarray(read.colors) * 255, colours, atol=0.01)


def test_a_cloud_without_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadData, match="cannot be written"):
        exports.write_ply(
            tmp_path / "nowhere" / "cloud.ply", np.zeros((1, 3)), np.zeros((1, 3), np.uint8)
        )


@pytest.mark.parametrize("read", ["read_binary", "read_text"])
def test_colmap_projects_a_point_where_we_do(tmp_path: Path, read: str) -> None:
    point_cam = np.array([[0.3, -0.2, 5.0]])
    point = se3.transform(POSES[0], point_cam)
    exports.write_colmap(
        tmp_path, CAMERA, ["a.png", "b.png"], POSES, point, np.array([[9, 8, 7]], np.uint8)
    )
    model = pycolmap.Reconstruction()
    getattr(model, read)(str(tmp_path))
    image = model.find_image_with_name("a.png")
    assert model.num_images() == 2
    (found,) = model.points3D.values()
    assert found.color.tolist() == [9, 8, 7]
    ours, _ = pinhole.project(point_cam[0], CAMERA)
    np.testing.assert_allclose(image.project_point(found.xyz), ours + 0.5, atol=1e-6)
    np.testing.assert_allclose(
        image.cam_from_world().matrix(), se3.inverse(POSES[0])[:3], atol=1e-9
    )


def test_depth_maps_keep_a_256th_of_a_metre(tmp_path: Path) -> None:
    depth = np.array([[0.0, 1.0, 12.3456], [300.0, np.inf, 1e-4]], np.float32)
    scale = exports.depth_scale(depth, is_metric=True)
    assert scale == 256
    exports.write_depth(tmp_path / "depth.png", depth, scale)
    values = cv2.imread(str(tmp_path / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert values.dtype == np.uint16
    np.testing.assert_allclose(values[0] / 256, depth[0], atol=0.5 / 256)
    assert values[1].tolist() == [65535, 65535, 1]  # 300 m do not fit into 16 bits


def test_without_metres_the_median_depth_lies_at_a_quarter() -> None:
    depth = np.array([0.0, 0.01, 0.02, 0.03, np.inf])
    assert exports.depth_scale(depth, is_metric=False) == pytest.approx(16384 / 0.02)
