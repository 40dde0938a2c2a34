"""The volume shows walls where they are, in any unit, with the far plane behind them."""

import numpy as np
import pytest

from geovp_classic.depth.given import Given
from geovp_classic.inpainters.blank import Blank
from geovp_classic.renderers.volume_fusion import VolumeFusion, close_gaps
from geovp_classic.types import Context, FloatArray, Trajectory, Views
from tests.geovp_classic.rendering.wall import CAMERA, at, past_of, wall

RENDERER = VolumeFusion(Given(), inpainter=Blank())


def view(past: tuple[Context, Trajectory], pose: FloatArray, renderer: VolumeFusion) -> Views:
    return renderer.reconstruct(*past).view(pose, np.zeros(1), CAMERA)


def test_the_unit_of_the_poses_makes_no_difference() -> None:
    small = view(past_of(at((0, 0), (0, 1))), at((0, 2)), RENDERER)
    large = view(past_of(at((0, 0), (0, 1e3)), 8e3), at((0, 2e3)), RENDERER)
    assert small.covered.mean() > 0.99
    np.testing.assert_allclose(large.depths, 1e3 * small.depths, rtol=1e-3)
    assert np.abs(large.frames.astype(int) - small.frames).mean() < 0.5


def test_an_earlier_frame_shows_what_left_the_last_one() -> None:
    past = past_of(at((0, 0), (3, 0)))
    back = at((0, 0))
    both = view(past, back, RENDERER)
    last = view(past, back, VolumeFusion(Given(), inpainter=Blank(), num_frames=1))
    assert both.covered[0, 2:-2, 2:-2].all()
    # 3 m at 8 m are 22.5 of the 64 columns; a voxel on the rim lacks neighbours.
    assert last.covered.mean() == pytest.approx(1 - 22.5 / 64, abs=0.05)
    difference = np.abs(both.frames[0].astype(int) - wall(back[0])[0])
    assert difference[both.covered[0]].mean() < 5  # the colours of voxels are blurred


def test_surfaces_beyond_reach_do_not_come_nearer() -> None:
    context, past = past_of(at((0, 0), (0, 1)))
    depths = np.array(context.past_depths)
    depths[:, :24] = np.inf
    beyond = Context(context.frames, context.times_s, CAMERA, past, None, depths)
    views = view((beyond, past), at((0, 4)), RENDERER)
    # At 4 m of 8 the wall's upper edge rises to row 23.5 - 7 / 4 * 0.5.
    assert np.isinf(views.depths[0, :16]).all()
    np.testing.assert_array_equal(views.frames[0, :16], context.frames[1, :16])
    assert views.covered[0, :16].all()


def test_gaps_in_a_column_become_the_plane_between() -> None:
    column = np.array([0.1, np.nan, np.nan, 0.4, np.nan, np.nan, np.nan, 0.8, np.nan])[:, None]
    closed = close_gaps(column, 2)[:, 0]
    np.testing.assert_allclose(closed, [0.1, 0.2, 0.3, 0.4, np.nan, np.nan, np.nan, 0.8, np.nan])
    np.testing.assert_allclose(close_gaps(column, 3)[4:7, 0], [0.5, 0.6, 0.7])
