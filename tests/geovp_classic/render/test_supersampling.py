"""Views that are drawn finer and averaged."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.render.supersampling import Supersampled
from geovp_classic.types import FloatArray, Intrinsics, Views

CAMERA = Intrinsics(20, 20, 7.5, 5.5, 16, 12)


@dataclass
class Slope:
    """White left of a slanted edge at depth 2, black behind it at depth 5, nothing at the right; seen at pixels."""

    asked: list[Intrinsics] = field(default_factory=list)

    def view(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> Views:
        self.asked.append(intrinsics)
        v, u = np.mgrid[: intrinsics.height_px, : intrinsics.width_px]
        x, y = (u - intrinsics.cx_px) / intrinsics.fx_px, (v - intrinsics.cy_px) / intrinsics.fy_px
        near, covered = x < 0.3 * y, x < 0.3
        frame = np.where(near[..., None], np.uint8(255), np.uint8(0)) * np.ones(3, np.uint8)
        depths = np.where(covered, np.where(near, 2.0, 5.0), 0.0).astype(np.float32)
        count = len(world_from_cam)
        return Views(*(np.repeat(one[None], count, axis=0) for one in (frame, covered, depths)))


def test_an_edge_is_as_grey_as_the_share_of_the_pixel_that_is_white() -> None:
    exact = Supersampled(Slope(), 16).view(np.eye(4)[None], CAMERA).frames.astype(float)
    errors = [np.abs(Supersampled(Slope(), n).view(np.eye(4)[None], CAMERA).frames - exact).mean() for n in (1, 2, 4)]
    assert errors[0] > 1.8 * errors[1] > 1.8**2 * errors[2]


def test_one_sample_is_the_scene_itself() -> None:
    one, plain = (scene.view(np.tile(np.eye(4), (2, 1, 1)), CAMERA) for scene in (Supersampled(Slope(), 1), Slope()))
    for name in ("frames", "covered", "depths"):
        np.testing.assert_array_equal(getattr(one, name), getattr(plain, name))


def test_samples_lie_inside_their_pixel() -> None:
    scene = Slope()
    Supersampled(scene, 2).view(np.eye(4)[None], CAMERA)
    (fine,) = scene.asked
    assert (fine.width_px, fine.height_px, fine.fx_px) == (32, 24, 40)
    # the four samples around a pixel's centre are a quarter of a pixel away from it
    np.testing.assert_allclose([(fine.cx_px - 15) / 2, (fine.cy_px - 11) / 2], [0.25, 0.25])


def test_depth_is_that_of_a_surface_never_between_two() -> None:
    views = Supersampled(Slope(), 2).view(np.eye(4)[None], CAMERA)
    assert set(np.unique(views.depths)) == {0.0, 2.0, 5.0}
    np.testing.assert_array_equal(views.depths > 0, views.covered)
    mixed = (views.frames[..., 0] > 0) & (views.frames[..., 0] < 255)
    assert mixed.any()
    assert (views.depths[mixed] == 2).all()
