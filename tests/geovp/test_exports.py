"""Exported files are read back by other programs."""

import runpy
import sys
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest

from geovp.prediction import exports
from geovp.prediction.colmap_model import build_model
from geovp_classic import colmap_library
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, Intrinsics, Views

CAMERA = Intrinsics(50.0, 40.0, 15.5, 11.5, 32, 24)
POSES = se3.exp(np.array([[1.0, 2.0, 3.0, 0.1, -0.2, 0.3], [1.0, 2.0, 4.0, 0.1, 0.4, 0.3]]))


def views_of(depths: FloatArray, covered: FloatArray | None = None) -> Views:
    frames = np.full((*depths.shape, 3), [200, 100, 50], np.uint8)
    return Views(frames, depths > 0 if covered is None else covered, depths.astype(np.float32))


def model_of(depths: FloatArray) -> pycolmap.Reconstruction:
    poses = POSES[: len(depths)]
    return build_model(CAMERA, ["a.png", "b.png"][: len(depths)], poses, views_of(depths))


def test_sky_and_uncovered_pixels_give_no_points_and_double_points_are_merged() -> None:
    depths = np.full((2, 24, 32), 5.0)
    depths[:, :12] = np.inf
    covered = np.ones(depths.shape, bool)
    covered[:, :, :16] = False
    views = views_of(depths, covered)
    model = build_model(CAMERA, ["a.png", "b.png"], POSES[[0, 0]], views)
    assert model.num_points3D() == 12 * 16
    assert model_of(np.full((2, 24, 32), np.inf)).num_points3D() == 0


def test_what_the_motion_does_not_show_gives_no_points() -> None:
    """A camera moves by 1 to the right: a wall at 5 turns by 11 degrees, one at 200 by 0.3."""
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 1.0
    depths = np.full((2, 24, 32), 200.0)
    depths[:, 12:] = 5.0
    model = build_model(CAMERA, ["a.png", "b.png"], poses, views_of(depths))
    assert {round(point.xyz[2]) for point in model.points3D.values()} == {5}


def test_colmap_projects_a_point_to_the_same_pixel_and_tracks_it(tmp_path: Path) -> None:
    """The second view shows a farther wall where the point would be."""
    depths = np.stack([np.zeros((24, 32)), np.full((24, 32), 50.0)])
    depths[0, 9, 18] = 5.0
    model_of(depths).write_binary(str(tmp_path))
    model = pycolmap.Reconstruction(str(tmp_path))
    assert model.num_images() == 2
    image = model.find_image_with_name("a.png")
    matrix = image.cam_from_world().matrix()
    np.testing.assert_allclose(matrix, se3.inverse(POSES[0])[:3], atol=1e-9)
    (keypoint,) = image.points2D
    np.testing.assert_allclose(keypoint.xy, [18.5, 9.5], atol=1e-6)
    stored = model.points3D[keypoint.point3D_id]
    assert stored.color.tolist() == [200, 100, 50]
    np.testing.assert_allclose(image.project_point(stored.xyz), [18.5, 9.5], atol=1e-6)
    assert (matrix @ [*stored.xyz, 1])[2] == pytest.approx(5)
    assert [element.image_id for element in stored.track.elements] == [image.image_id]


def test_an_interrupted_import_of_pycolmap_is_an_interrupt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library raises RuntimeError from ImportError from the interrupt."""
    lines = "try:\n  try: {}\n  except {}\nexcept {}"
    (tmp_path / "pycolmap.py").write_text(
        lines.format(
            "raise KeyboardInterrupt",
            "BaseException as error: raise ImportError from error",
            "ImportError as error: raise RuntimeError from error",
        )
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pycolmap")
    with pytest.raises(KeyboardInterrupt):
        runpy.run_path(colmap_library.__file__)


def written_depths(folder: Path, depth: FloatArray, *, is_metric: bool) -> FloatArray:
    exports.write_depths(folder, ["depth.png"], depth[None], is_metric=is_metric)
    return cv2.imread(str(folder / "depth.png"), cv2.IMREAD_UNCHANGED)


def test_depth_maps_have_the_values_of_kitti(tmp_path: Path) -> None:
    depth = np.array([[0.0, 1.0], [np.inf, 300.0], [0.001, 10.5]])
    values = written_depths(tmp_path / "depths", depth, is_metric=True)
    assert values.dtype == np.uint16
    assert values.tolist() == [[0, 256], [65535, 65535], [1, 2688]]


def test_depths_without_a_unit_are_scaled_by_their_median(tmp_path: Path) -> None:
    depth = np.array([[0.0, 0.01, 0.02, 0.03, np.inf]])
    values = written_depths(tmp_path / "depths", depth, is_metric=False)
    assert values.tolist() == [[0, 8192, 16384, 24576, 65535]]
    assert f"value / {16384 / 0.02:.9g}, in the unit" in (tmp_path / "depths/scale.txt").read_text()
