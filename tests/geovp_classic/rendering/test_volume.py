"""The volume shows walls where they are, in any unit, with the far plane behind them."""

import numpy as np
import pytest

from geovp_classic.depth.given import Given
from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole, se3
from geovp_classic.inpainters.blank import Blank
from geovp_classic.renderers.volume_fusion import VolumeFusion
from geovp_classic.rendering import volume
from geovp_classic.types import Context, FloatArray, Intrinsics, Trajectory

CAMERA = Intrinsics(60, 60, 31.5, 23.5, 64, 48)
RENDERER = VolumeFusion(Given(), inpainter=Blank())


def wall(world_from_cam: FloatArray, distance: float) -> tuple[FloatArray, FloatArray]:
    """Image [H, W, 3] and depth [H, W] of a smoothly painted wall at z = distance."""
    directions = pinhole.rays(CAMERA) @ world_from_cam[:3, :3].T
    reach = (distance - world_from_cam[2, 3]) / directions[..., 2]
    place = (world_from_cam[:3, 3] + reach[..., None] * directions) * 8 / distance
    paint = 128 + 60 * np.sin(1.3 * place[..., 0]) + 50 * np.cos(1.7 * place[..., 1])
    return np.repeat(paint[..., None], 3, axis=2).astype(np.uint8), reach.astype(np.float32)


def drive(x: list[float], z: list[float]) -> FloatArray:
    return se3.compose(np.eye(3), np.stack([x, np.zeros_like(x), z], axis=-1))


def past_of(poses: FloatArray, distance: float = 8.0) -> tuple[Context, Trajectory]:
    images, depths = zip(*(wall(pose, distance) for pose in poses), strict=True)
    times_s = np.arange(len(poses) + 1) * 0.1
    past = Trajectory(poses, times_s[:-1], True)
    return Context(np.stack(images), times_s, CAMERA, past=past, past_depths=np.stack(depths)), past


def test_a_wall_is_seen_as_it_is_from_nearer() -> None:
    context, past = past_of(drive([0.0, 0.0], [0.0, 1.0]))
    ahead = drive([0.0], [2.0])
    views = RENDERER.reconstruct(context, past).view(ahead, np.zeros(len(ahead)), CAMERA)
    assert views.covered.mean() > 0.99
    np.testing.assert_allclose(views.depths[views.covered], 6.0, rtol=0.01)
    assert np.abs(views.frames[0].astype(int) - wall(ahead[0], 8.0)[0])[views.covered[0]].mean() < 2


def test_the_unit_of_the_poses_makes_no_difference() -> None:
    small = RENDERER.reconstruct(*past_of(drive([0.0, 0.0], [0.0, 1.0]))).view(
        drive([0.0], [2.0]), np.zeros(len(drive([0.0], [2.0]))), CAMERA
    )
    large = RENDERER.reconstruct(*past_of(drive([0.0, 0.0], [0.0, 1e3]), 8e3)).view(
        drive([0.0], [2e3]), np.zeros(len(drive([0.0], [2e3]))), CAMERA
    )
    assert small.covered.mean() > 0.99
    np.testing.assert_allclose(large.depths, 1e3 * small.depths, rtol=1e-3)
    assert np.abs(large.frames.astype(int) - small.frames).mean() < 0.5


def test_an_earlier_frame_shows_what_left_the_last_one() -> None:
    context, past = past_of(drive([0.0, 3.0], [0.0, 0.0]))
    back = drive([0.0], [0.0])
    both = RENDERER.reconstruct(context, past).view(back, np.zeros(len(back)), CAMERA)
    last = (
        VolumeFusion(Given(), inpainter=Blank(), num_frames=1)
        .reconstruct(context, past)
        .view(back, np.zeros(len(back)), CAMERA)
    )
    assert both.covered[0, 2:-2, 2:-2].all()
    # 3 m at 8 m are 22.5 of the 64 columns.
    assert last.covered.mean() == pytest.approx(
        1 - 22.5 / 64, abs=0.05
    )  # a voxel on the rim lacks neighbours
    off = np.abs(both.frames[0].astype(int) - wall(back[0], 8.0)[0])[both.covered[0]]
    assert off.mean() < 5  # the colours of voxels are blurred


def test_what_is_beyond_reach_turns_but_does_not_come_nearer() -> None:
    context, past = past_of(drive([0.0, 0.0], [0.0, 1.0]))
    depths = np.array(context.past_depths)
    depths[:, :24] = np.inf
    scene = RENDERER.reconstruct(
        Context(context.frames, context.times_s, CAMERA, past, None, depths), past
    )
    views = scene.view(drive([0.0], [4.0]), np.zeros(len(drive([0.0], [4.0]))), CAMERA)
    sky = views.frames[0, :16]  # at 4 m of 8 the wall's upper edge rises to row 23.5 - 7 / 4 * 0.5
    assert np.isinf(views.depths[0, :16]).all()
    np.testing.assert_array_equal(sky, context.frames[1, :16])
    assert views.covered[0, :16].all()


def test_nothing_is_covered_beside_and_behind() -> None:
    scene = RENDERER.reconstruct(*past_of(drive([0.0, 0.0], [0.0, 1.0])))
    about_turn = se3.exp(np.array([[0, 0, 0, 0, np.pi, 0.0]]))
    views = scene.view(about_turn, np.zeros(len(about_turn)), CAMERA)
    assert not views.covered.any()
    assert (views.depths == 0).all()


def test_frames_without_any_depth_leave_a_far_plane() -> None:
    context, past = past_of(drive([0.0, 0.0], [0.0, 1.0]))
    nothing = np.zeros((2, 48, 64))
    filled = volume.integrate(
        context.frames, nothing, nothing > 0, CAMERA, past.world_from_cam, 2.5, 5.0
    )
    colours, inverse_depth = filled.cast(past.world_from_cam[-1], CAMERA)
    assert np.isnan(inverse_depth).all()
    assert (colours == 0).all()


def test_gaps_in_a_column_become_the_plane_between() -> None:
    column = np.array([0.1, np.nan, np.nan, 0.4, np.nan, np.nan, np.nan, 0.8, np.nan])[:, None]
    closed = volume.close_gaps(column, 2)[:, 0]
    np.testing.assert_allclose(closed, [0.1, 0.2, 0.3, 0.4, np.nan, np.nan, np.nan, 0.8, np.nan])
    np.testing.assert_allclose(volume.close_gaps(column, 3)[4:7, 0], [0.5, 0.6, 0.7])


@pytest.mark.parametrize(
    "settings", [{"voxel_px": 0.0}, {"reach": 6.5}, {"agreement": 1.0}, {"num_frames": 0}]
)
def test_senseless_settings_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(BadData, match=r"expected 1 or more|must lie between"):
        VolumeFusion(**settings)  # type: ignore[arg-type]
