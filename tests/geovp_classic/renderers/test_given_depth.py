"""Recorded depth of the last frame, on a plain with a wall whose views are known exactly."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import planar, se3
from geovp_classic.inpainters.blank import Blank
from geovp_classic.inpainters.nearest_background import NearestBackground
from geovp_classic.renderers.given_depth import GivenDepth
from geovp_classic.types import Clip, Context, FloatArray, Intrinsics, Trajectory, Views

NUM_PAST = 6


def split(clip: Clip) -> tuple[Context, Trajectory]:
    assert clip.trajectory is not None
    return clip.split(NUM_PAST, GivenDepth().needs)[0], clip.trajectory[:NUM_PAST]


def predict(clip: Clip, renderer: GivenDepth | None = None) -> Views:
    context, past = split(clip)
    assert clip.trajectory is not None
    scene = (renderer or GivenDepth()).reconstruct(context, past)
    future = clip.trajectory.world_from_cam[NUM_PAST:]
    return scene.view(future, np.zeros(len(future)), clip.intrinsics)


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (-5.0, 8.0)])
def test_the_future_of_a_walled_plain_is_reproduced(
    plain: Any,
    walled_plain: Any,
    camera: Intrinsics,
    drive: FloatArray,
    pitch_deg: float,
    roll_deg: float,
) -> None:
    mounting = planar.level_vehicle_from_cam(np.deg2rad(pitch_deg), np.deg2rad(roll_deg))
    clip = walled_plain.clip(drive @ mounting, camera)
    views = predict(clip)
    depths = clip.depths[NUM_PAST:]
    assert views.covered.mean() > 0.9
    # Away from the outlines of the wall, and where the plain's pattern is not finer than pixels.
    inner = ndimage.binary_erosion(np.isinf(depths) | (depths < 10), np.ones((1, 5, 5)))
    wall = depths != plain.clip(drive @ mounting, camera).depths[NUM_PAST:]
    outline = ndimage.maximum_filter(wall, (1, 7, 7)) != ndimage.minimum_filter(wall, (1, 7, 7))
    counts = views.covered & inner & ~outline
    assert counts.mean() > 0.4
    assert np.abs(views.frames.astype(float) - clip.frames[NUM_PAST:])[counts].max() < 8
    np.testing.assert_allclose(views.depths[counts], depths[counts], rtol=1e-3)


def test_plain_behind_the_wall_is_uncovered(walled_plain: Any, camera: Intrinsics) -> None:
    # The camera steps 1 m aside: the wall at 12 m moves 10 pixels and uncovers a strip.
    poses = se3.compose(np.eye(3), np.array([[1.0 * (k >= NUM_PAST), 0, 0] for k in range(8)]))
    clip = walled_plain.clip(poses, camera)
    views = predict(clip)
    edge_px = camera.cx_px + camera.fx_px * (1.5 - 1.0) / 12  # the wall's right edge
    is_seen = views.depths[0, 56:60] > 0  # rows of the wall above the horizon
    for row in is_seen:
        np.testing.assert_allclose(np.flatnonzero(~row)[[0, -1]], [edge_px, edge_px + 10], atol=1.5)
        assert (~row).sum() in (9, 10, 11)
    assert not views.covered[0, 56:60][~is_seen].any()


def test_mixed_pixels_at_separated_edges_are_shown_but_uncovered(
    walled_plain: Any, camera: Intrinsics
) -> None:
    # At a step of d metres the wall at 12 m moves 10 d pixels, and the sky does not move.
    for step_m, is_separated in ((0.09, False), (0.11, True)):
        poses = se3.compose(
            np.eye(3), np.array([[step_m * (k >= NUM_PAST), 0, 0] for k in range(8)])
        )
        views = predict(walled_plain.clip(poses, camera))
        is_mixed = (views.depths[0, 57:60] > 0) & ~views.covered[0, 57:60]
        assert (is_mixed.any(axis=1) == is_separated).all()
        assert is_mixed.sum(axis=1).max() <= 4  # two pixels on either edge
        assert (views.frames[0, 57:60][is_mixed] > 0).all()


def test_a_stationary_camera_sees_the_last_frame(walled_plain: Any, camera: Intrinsics) -> None:
    clip = walled_plain.clip(np.tile(np.eye(4), (8, 1, 1)), camera)
    views = predict(clip)
    assert views.covered.all()
    np.testing.assert_array_equal(views.frames, clip.frames[NUM_PAST:])


def test_another_camera_sees_the_same_wall(
    walled_plain: Any, camera: Intrinsics, drive: FloatArray
) -> None:
    clip = walled_plain.clip(drive, camera)
    scene = GivenDepth().reconstruct(*split(clip))
    zoomed = replace(camera, fx_px=240.0, fy_px=236.0)
    pose = drive[NUM_PAST - 1]
    views = scene.view(pose[None], np.zeros(1), zoomed)
    expected, depth = walled_plain.draw(pose, zoomed)
    near = ndimage.binary_erosion(depth < 8, np.ones((5, 5)))
    assert near.sum() > 500
    assert np.abs(views.frames[0] - expected)[near].max() < 8


def test_pixels_of_unknown_depth_are_uncovered(plain: Any, camera: Intrinsics) -> None:
    clip = plain.clip(np.tile(np.eye(4), (8, 1, 1)), camera)
    depths = clip.depths.copy()
    depths[:, 80:90, 30:50] = 0
    views = predict(replace(clip, depths=depths))
    assert not views.covered[:, 81:89, 31:49].any()
    assert views.covered[:, :79].all()


def test_without_any_depth_the_last_frame_is_shown(
    plain: Any, camera: Intrinsics, drive: FloatArray
) -> None:
    clip = plain.clip(drive, camera)
    views = predict(
        replace(clip, depths=np.zeros_like(clip.depths)), GivenDepth(NearestBackground())
    )
    assert not views.covered.any()
    assert (views.frames == clip.frames[NUM_PAST - 1]).all()


def test_inpainting_keeps_covered_pixels(
    walled_plain: Any, camera: Intrinsics, drive: FloatArray
) -> None:
    clip = walled_plain.clip(drive, camera)
    blank = predict(clip, GivenDepth(Blank()))
    inpainted = predict(clip, GivenDepth(NearestBackground()))
    np.testing.assert_array_equal(inpainted.covered, blank.covered)
    covered = blank.covered
    np.testing.assert_array_equal(inpainted.frames[covered], blank.frames[covered])
    assert (inpainted.frames[~covered] > 0).any(axis=-1).mean() > 0.9


def test_missing_or_bad_inputs_are_refused(
    plain: Any, camera: Intrinsics, drive: FloatArray
) -> None:
    context, past = split(plain.clip(drive, camera))
    with pytest.raises(Incompatible, match="the clip has none"):
        GivenDepth().reconstruct(replace(context, past_depths=None), past)
    with pytest.raises(Incompatible, match="give the odometry a scale"):
        GivenDepth().reconstruct(context, replace(past, is_metric=False))
    assert context.past_depths is not None
    with pytest.raises(BadData, match="write 0 where it is unknown"):
        GivenDepth().reconstruct(replace(context, past_depths=-context.past_depths), past)
