"""Mixtures of forecast and true poses, on trajectories whose numbers can be worked out by hand."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.evaluation.budget.poses import (
    COMPONENTS,
    PAST,
    SCALE,
    TRUTH,
    ClipMotions,
    mixed,
)
from geovp_classic.forecasting.constant import ConstantVelocity
from geovp_classic.geometry import planar, se3
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.planar import Planar
from geovp_classic.pose_sources.refined import Refined
from geovp_classic.types import (
    BoolArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    PrivilegedInput,
    Trajectory,
)

YAW, PITCH, ROLL = np.deg2rad([10.0, 2.0, 3.0])


def straight(step_m: float, direction: tuple[float, float, float], count: int = 4) -> FloatArray:
    """last_from_cam [F, 4, 4] without a turn."""
    return se3.compose(np.eye(3), step_m * np.arange(1, count + 1)[:, None] * np.array(direction))


def turned_truth() -> FloatArray:
    """Steps of 2 m along (0.6, 0.8) on the plane, 0.2 m higher, turned by 10, 2 and 3 degrees."""
    yaw = np.array([[np.cos(YAW), 0, np.sin(YAW)], [0, 1, 0], [-np.sin(YAW), 0, np.cos(YAW)]])
    truth = straight(2.0, (0.6, 0.0, 0.8))
    truth[:, 1, 3] = -0.2
    truth[:, :3, :3] = yaw @ planar.level_vehicle_from_cam(PITCH, ROLL)[:3, :3]
    return truth


FORECAST, REAL = straight(1.0, (0.0, 0.0, 1.0)), turned_truth()


def test_all_six_components_give_the_truth_and_none_the_forecast() -> None:
    np.testing.assert_array_equal(mixed(FORECAST, REAL, frozenset(COMPONENTS)), REAL)
    np.testing.assert_array_equal(mixed(FORECAST, REAL, frozenset()), FORECAST)


@pytest.mark.parametrize(
    ("component", "axis", "points_to"),
    [
        ("yaw", 2, (np.sin(YAW), 0, np.cos(YAW))),  # the view, to the right
        ("pitch", 2, (0, -np.sin(PITCH), np.cos(PITCH))),  # the view, upwards
        ("roll", 0, (np.cos(ROLL), np.sin(ROLL), 0)),  # the image's right, downwards
    ],
)
def test_an_angle_turns_the_camera_where_it_is(
    component: str, axis: int, points_to: tuple[float, ...]
) -> None:
    swapped = mixed(FORECAST, REAL, frozenset({component}))
    np.testing.assert_allclose(swapped[:, :3, axis], np.tile(points_to, (4, 1)), atol=1e-12)
    np.testing.assert_array_equal(swapped[:, :3, 3], FORECAST[:, :3, 3])


def test_three_angles_are_the_rotation_and_three_the_position() -> None:
    turned = mixed(FORECAST, REAL, frozenset({"yaw", "pitch", "roll"}))
    np.testing.assert_allclose(turned, se3.compose(REAL[:, :3, :3], FORECAST[:, :3, 3]), atol=1e-12)
    moved = mixed(FORECAST, REAL, frozenset({"speed", "path", "height"}))
    np.testing.assert_allclose(moved, se3.compose(FORECAST[:, :3, :3], REAL[:, :3, 3]), atol=1e-12)


def test_speed_path_and_height_are_apart() -> None:
    # 2 m a step straight ahead: beyond the forecast's end at 4 m it goes on straight.
    fast = mixed(FORECAST, REAL, frozenset({"speed"}))[:, :3, 3]
    np.testing.assert_allclose(fast, [[0, 0, 2], [0, 0, 4], [0, 0, 6], [0, 0, 8]], atol=1e-12)
    aside = mixed(FORECAST, REAL, frozenset({"path"}))[:, :3, 3]  # 1 m a step along (0.6, 0.8)
    np.testing.assert_allclose(
        aside, [[0.6, 0, 0.8], [1.2, 0, 1.6], [1.8, 0, 2.4], [2.4, 0, 3.2]], atol=1e-12
    )
    higher = mixed(FORECAST, REAL, frozenset({"height"}))[:, :3, 3]
    np.testing.assert_allclose(
        higher, [[0, -0.2, 1], [0, -0.2, 2], [0, -0.2, 3], [0, -0.2, 4]], atol=1e-12
    )


@dataclass(frozen=True)
class HalfScale:
    """The recorded positions at half their size."""

    is_metric: bool = True
    needs = PrivilegedInput.PAST_POSES

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        assert context.past is not None
        assert context.future is None  # which it has not declared
        poses = context.past.world_from_cam.copy()
        poses[:, :3, 3] /= 2
        return Trajectory(poses, context.past.times_s, self.is_metric), np.ones(
            len(poses), dtype=bool
        )


SOURCE = Chained(HalfScale(), ConstantVelocity())


def context(source: Any) -> Context:
    """Five black frames, 1 m apart; then five 2 m apart. Black frames leave poses unrefined."""
    times_s = 0.1 * np.arange(10)
    z = np.array([*range(5), 6, 8, 10, 12, 14.0])
    poses = se3.compose(np.eye(3), z[:, None] * np.array([0, 0, 1.0]))
    frames = np.zeros((10, 48, 48, 3), np.uint8)
    camera = Intrinsics(90.0, 90.0, 23.5, 23.5, 48, 48)
    clip = Clip("road", frames, times_s, camera, Trajectory(poses, times_s, True))
    return clip.split(5, source.needs | TRUTH.needs)[0]


def ahead(motion: Motion) -> FloatArray:
    """Z of past and future cameras relative to the last observed one."""
    poses = np.concatenate([motion.past.world_from_cam, motion.futures[0]])
    return np.asarray(poses[:, 2, 3] - motion.past.world_from_cam[-1, 2, 3])


@pytest.mark.parametrize("source", [SOURCE, Refined(SOURCE, ()), Planar(SOURCE)])
def test_past_and_scale_give_a_new_forecast_in_their_unit(source: Chained) -> None:
    motions = ClipMotions(source, context(source))
    assert motions.scale == pytest.approx(2.0)
    half, whole = [-2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2, 2.5], [-4, -3, -2, -1, 0, 1, 2, 3, 4, 5]
    np.testing.assert_allclose(ahead(motions.motion(frozenset())), half, atol=1e-9)
    np.testing.assert_allclose(ahead(motions.motion(frozenset({SCALE}))), whole, atol=1e-9)
    np.testing.assert_allclose(ahead(motions.motion(frozenset({PAST}))), half, atol=1e-9)
    np.testing.assert_allclose(ahead(motions.motion(frozenset({PAST, SCALE}))), whole, atol=1e-9)


def test_true_positions_are_in_the_unit_of_the_past() -> None:
    motions = ClipMotions(SOURCE, context(SOURCE))
    fast = motions.motion(frozenset({"speed"}))  # 2 m a step are 1 unit
    np.testing.assert_allclose(ahead(fast)[5:], [1, 2, 3, 4, 5], atol=1e-9)
    everything = motions.motion(frozenset({PAST, SCALE, *COMPONENTS}))
    np.testing.assert_allclose(ahead(everything), [-4, -3, -2, -1, 0, 2, 4, 6, 8, 10], atol=1e-9)
