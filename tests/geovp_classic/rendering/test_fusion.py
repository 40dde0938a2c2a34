"""The fused cloud: the last frame stays, and earlier ones add what it does not show."""

from typing import Any

import numpy as np
import pytest

from geovp_classic.depth.given import Given
from geovp_classic.geometry import se3
from geovp_classic.inpainters.blank import Blank
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.rendering.fusion import close_cracks, fuse, hidden_from, smooth
from geovp_classic.rendering.patches import PatchModel
from geovp_classic.rendering.rasterizer import NO_INDEX
from geovp_classic.rendering.source import Source
from tests.geovp_classic.rendering.wall import CAMERA, at, past_of, wall

PLAIN: dict[str, Any] = {
    "inpainter": Blank(),
    "detail": None,
    "exposure": None,
}


def test_a_wall_is_seen_from_nearer() -> None:
    scene = DepthFusion(Given(), **PLAIN).reconstruct(*past_of(at((0, 0), (0, 0.5), (0, 1))))
    pose = at((0, 2))
    views = scene.view(pose, np.array([0.3]), CAMERA)
    assert views.covered.all()
    np.testing.assert_allclose(views.depths[0], 6.0, rtol=1e-4)
    assert np.abs(views.frames[0].astype(int) - wall(pose[0])[0]).mean() < 1.5


def test_an_earlier_frame_shows_what_left_the_last_one() -> None:
    # The camera slides 3 m to the right and back: 3 m at 8 m are 22.5 of the 64 columns.
    past = past_of(at((0, 0), (3, 0)))
    back = at((0, 0))
    views = {}
    for num_frames in (1, 2):
        scene = DepthFusion(Given(), **PLAIN, num_frames=num_frames).reconstruct(*past)
        views[num_frames] = scene.view(back, np.array([0.2]), CAMERA)
    assert views[2].covered.all()
    assert views[1].covered.mean() == pytest.approx(1 - 22.5 / 64, abs=0.02)
    assert np.abs(views[2].frames[0].astype(int) - wall(back[0])[0]).mean() < 1.5


@pytest.mark.parametrize(("factor", "is_added"), [(2, False), (1, False), (0.5, True)])
def test_earlier_surfaces_are_added_only_behind_later_ones(factor: float, is_added: bool) -> None:
    image, depth = wall(np.eye(4))
    sources = [Source(image, CAMERA, np.eye(4))] * 2
    is_known = np.ones((2, *depth.shape), bool)
    is_known[1, 1, 2:4] = False  # pixels of the last frame that may not become patches
    inverse_depths = np.stack([factor / depth, 1 / depth])
    cloud, used = fuse(sources, inverse_depths, is_known, 0.1, PatchModel())
    assert len(cloud.source) == (1 + is_added) * depth.size - 2
    assert used == ([1, 0] if is_added else [1])
    columns, rows = cloud.pixels[cloud.source == 0].astype(int).T
    assert not ((rows == 1) & (columns >= 2) & (columns < 4)).any()


def test_points_in_the_plane_of_a_camera_are_hidden_from_it() -> None:
    """Their depth in the later frame, which stands where they are, is exactly 0."""
    frame = np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.uint8)
    source, later = (Source(frame, CAMERA, pose) for pose in at((0.0, 0.0), (0.0, 2.0)))
    inverse_depth = np.full(frame.shape[:2], 0.5, np.float32)
    with np.errstate(invalid="raise"):
        assert hidden_from(later, inverse_depth, source, inverse_depth, 0.1).all()


@pytest.mark.parametrize("turn_deg", [40, 48])
def test_a_hardly_covered_view_is_the_last_frame(turn_deg: float) -> None:
    # Half the image is 32 px wide, which is 28.07 degrees at a focal length of 60 px. Turned by 40,
    # the view shows the wall in 32 + 60 tan(28.07 - 40) = 19 of 64 columns, by 48 in 10. Part of
    # the rows lies outside of the last frame.
    context, past = past_of(at((0, 0)))
    scene = DepthFusion(Given(), exposure=None).reconstruct(context, past)
    turn = se3.exp(np.array([[0, 0, 0, 0, np.radians(turn_deg), 0]]))
    views = scene.view(turn, np.array([0.1]), CAMERA)
    is_last = np.array_equal(views.frames[0], context.frames[-1])
    if turn_deg == 40:
        assert 0.2 < views.covered.mean() < 19.5 / 64
        assert not is_last
    else:
        assert not views.covered.any()
        assert (views.depths == 0).all()
        assert is_last


def test_smoothing_removes_dots_and_keeps_lines() -> None:
    inverse_depth = np.full((20, 30), 0.1, np.float32)
    inverse_depth[:, 20:22] = 0.4  # a pole
    index = np.zeros((20, 30), np.int32)
    index[12:, 12:] = 1  # another source
    index[:3, :3] = NO_INDEX
    inverse_depth[2, 2] = -1
    inverse_depth[13, 12] = 0.3  # beside pixels of the other source
    expected = inverse_depth.copy()
    for row, column in ((5, 5), (9, 8), (10, 9), (15, 14)):
        inverse_depth[row, column] = 0.11
    np.testing.assert_array_equal(smooth(inverse_depth, index), expected)


@pytest.mark.parametrize(("gap_px", "is_closed"), [(5, True), (7, False)])
def test_narrow_gaps_are_closed_from_both_sides(gap_px: int, is_closed: bool) -> None:
    left, right = 10, 10 + gap_px
    depth = np.full((20, 30), -1, np.float32)
    depth[:, :left] = 0.5
    depth[:, right:] = 0.1
    index = np.full((20, 30), NO_INDEX, np.int32)
    index[:, :left] = 1
    index[:, right:] = 2
    closed_depth, closed_index = close_cracks(depth, index, crack_px=3)
    if is_closed:
        depth[:, left : left + 2] = 0.5
        depth[:, left + 2 : right] = 0.1  # the middle pixel belongs to the farther side
        index = np.where(depth > 0.2, 1, 2).astype(np.int32)
    np.testing.assert_array_equal(closed_depth, depth)
    np.testing.assert_array_equal(closed_index, index)
