"""Pixel strata in a world small enough to work out: a wall at 10 m, a square at 5 m in front of it,
and sky above.
"""

from dataclasses import replace

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.metrics.strata import strata
from geovp_classic.types import BoolArray, Context, FloatArray, Intrinsics, Target, Trajectory

CAMERA = Intrinsics(64.0, 64.0, 31.5, 31.5, 64, 64)  # sees 5 m of the wall to either side
WALL_M, SQUARE_M, HALF_SIDE_M, WALL_TOP_M = 10.0, 5.0, 1.0, -2.0


def look(world_from_cam: FloatArray) -> FloatArray:
    """Depth [T, H, W] of wall, square and sky; cameras look along z or turned about y."""
    depths = []
    for pose in world_from_cam:
        directions = pinhole.rays(CAMERA) @ pose[:3, :3].T
        centre = pose[:3, 3]
        at_wall, wall_depth = cross(centre, directions, WALL_M)
        at_square, square_depth = cross(centre, directions, SQUARE_M)
        on_square = (np.abs(at_square[..., :2]) <= HALF_SIDE_M).all(-1) & (square_depth > 0)
        on_wall = (at_wall[..., 1] >= WALL_TOP_M) & (wall_depth > 0)
        depths.append(np.where(on_square, square_depth, np.where(on_wall, wall_depth, np.inf)))
    return np.stack(depths).astype(np.float32)


def cross(
    centre: FloatArray, directions: FloatArray, plane_z_m: float
) -> tuple[FloatArray, FloatArray]:
    """Points and depths where rays cross the plane z = plane_z_m; rays have z = 1 in the camera, so
    scale is depth.
    """
    depth = (plane_z_m - centre[2]) / directions[..., 2]
    return centre + depth[..., None] * directions, depth


def at(x_m: float = 0.0, z_m: float = 0.0, yaw_deg: float = 0.0) -> FloatArray:
    turn = se3.exp(np.array([0, 0, 0, 0, np.deg2rad(yaw_deg), 0]))
    return se3.compose(np.eye(3), np.array([x_m, 0.0, z_m])) @ turn


def clip(
    past: list[FloatArray], future: list[FloatArray], moving: BoolArray | None = None
) -> tuple[Context, Target]:
    poses = np.stack(past + future)
    times_s = 0.1 * np.arange(len(poses))
    frames = np.zeros((len(poses), 64, 64, 3), dtype=np.uint8)
    trajectory, cut = Trajectory(poses, times_s, is_metric=True), len(past)
    depths = look(poses)
    context = Context(
        frames[:cut], times_s, CAMERA, trajectory[:cut], trajectory[cut:], depths[:cut], 1.65
    )
    return context, Target(frames[cut:], trajectory[cut:], depths[cut:], moving)


def wall_points(target: Target) -> FloatArray:
    """World x, y of every pixel's point on the wall's plane [H, W, 2] in the first future frame."""
    pose = target.trajectory.world_from_cam[0]
    return cross(pose[:3, 3], pinhole.rays(CAMERA) @ pose[:3, :3].T, WALL_M)[0][..., :2]


def test_a_step_to_the_side_discloses_hidden_pixels_and_shows_new_ones() -> None:
    context, target = clip([at()], [at(x_m=1.0)])
    masks = strata(context, target)
    x_m, y_m = np.moveaxis(wall_points(target), -1, 0)
    on_wall = target.depths[0] == WALL_M
    hidden_before = (
        on_wall & (np.abs(x_m) < 2.0) & (np.abs(y_m) < 2.0)
    )  # the square's shadow: twice its size
    assert hidden_before.sum() > 100
    pixel_m = WALL_M / CAMERA.fx_px
    core = hidden_before & (np.abs(x_m) < 2.0 - 1.5 * pixel_m) & (np.abs(y_m) < 2.0 - 1.5 * pixel_m)
    clear = (
        on_wall
        & (np.abs(x_m) < 4.0)
        & ((np.abs(x_m) > 2.0 + 1.5 * pixel_m) | (np.abs(y_m) > 2.0 + 1.5 * pixel_m))
    )
    assert masks["disoccluded"][0][core].all()
    assert masks["seen"][0][clear].all()
    assert masks["seen"][0][target.depths[0] == SQUARE_M].all()
    beyond = on_wall & (x_m > 5.0)  # the first camera saw up to 64 px / 2 = 5 m
    assert beyond.sum() > 100
    assert not masks["seen"][0][beyond].any()


def test_sky_is_compared_by_direction() -> None:
    context, target = clip([at()], [at(x_m=0.0, yaw_deg=10.0)])
    masks, sky = strata(context, target), np.isinf(target.depths[0])
    column = np.broadcast_to(np.arange(64), (64, 64))
    was_in_view = (
        column < CAMERA.cx_px + 64 * np.tan(np.deg2rad(26.5651 - 10.0)) - 1
    )  # half the view is atan(0.5)
    assert sky.sum() > 500
    assert (
        masks["seen"][0][sky & was_in_view & (np.arange(64)[:, None] > 2)].mean() > 0.98
    )  # but for the wall's rim
    assert not masks["seen"][0][:, 60:].any()


def test_steep_ground_is_compared_by_interpolation() -> None:
    """Depth of a road grows by 5 % a pixel far away; interpolated inverse depth still agrees to the
    tolerance.
    """
    height_m = 1.65
    v = np.arange(64)[:, None]
    depth = np.where(v > 31.5, height_m * CAMERA.fy_px / np.maximum(v - 31.5, 1e-9), np.inf)
    depths = np.broadcast_to(depth, (2, 64, 64)).astype(np.float32)
    context, target = clip([at()], [at(z_m=0.7)])
    masks = strata(replace(context, past_depths=depths[:1]), replace(target, depths=depths[1:]))
    assert masks["seen"][0, 33:40].all()  # up to 68 m away


def test_moving_objects_are_a_separate_stratum() -> None:
    moving = np.zeros((1, 64, 64), dtype=bool)
    moving[0, 20:40, 20:40] = True
    masks = strata(*clip([at()], [at(x_m=0.5)], moving))
    assert set(masks) == {"seen", "disoccluded", "static", "moving"}
    np.testing.assert_array_equal(masks["moving"], moving)
    np.testing.assert_array_equal(masks["static"], ~moving)
    together = masks["seen"].astype(int) + masks["disoccluded"] + masks["moving"]
    assert all(mask.dtype == bool for mask in masks.values())
    np.testing.assert_array_equal(together, 1)  # every pixel is one of the three


def test_unknown_depth_is_neither_seen_nor_disoccluded() -> None:
    context, target = clip([at()], [at()])
    now, before = target.depths.copy(), context.past_depths.copy()
    now[0, :10], before[0, 50:] = 0.0, 0.0
    masks = strata(replace(context, past_depths=before), replace(target, depths=now))
    assert not masks["seen"][0, :10].any()
    assert not masks["disoccluded"][0, :10].any()
    assert masks["seen"][0, 10:50].all()
    assert masks["disoccluded"][0, 50:].all()  # nothing says that it was seen


def test_points_behind_an_observing_camera_are_not_seen() -> None:
    context, target = clip([at(z_m=7.0)], [at()])  # the past camera stands between square and wall
    masks = strata(context, target)
    assert not masks["seen"][0][look(at()[None])[0] == SQUARE_M].any()


@pytest.mark.parametrize("missing", ["past", "past_depths", "future_depths", "future", "metres"])
def test_clips_without_depth_or_metric_poses_have_no_strata(missing: str) -> None:
    context, target = clip([at()], [at()])
    unmetric = Trajectory(
        target.trajectory.world_from_cam, target.trajectory.times_s, is_metric=False
    )
    context = replace(context, **({missing: None} if missing in ("past", "past_depths") else {}))
    changes = {
        "future_depths": {"depths": None},
        "future": {"trajectory": None},
        "metres": {"trajectory": unmetric},
    }
    assert strata(context, replace(target, **changes.get(missing, {}))) == {}
