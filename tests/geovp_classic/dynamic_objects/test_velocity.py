"""Own velocities: exact from exact flow, and found again from images when they begin a fifth wrong."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from geovp_classic.dynamic_objects import segmentation, velocity
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray

STEPS = (1, 2, 3)


@pytest.fixture(scope="module")
def traffic(drive_behind: Callable[..., Any]) -> Any:
    return drive_behind()


@pytest.fixture(scope="module")
def sight(traffic: Any) -> segmentation.Sight:
    return sight_of(traffic)


def sight_of(traffic: Any) -> segmentation.Sight:
    return segmentation.Sight(traffic.images, traffic.camera, traffic.past, traffic.inverse_depth, traffic.road)


def places_of(velocity: FloatArray, depth: float, sight: segmentation.Sight) -> FloatArray:
    """Where a thing at the depth was in earlier frames, by walking it back in the world."""
    points = depth * pinhole.rays(sight.camera)
    poses, times_s = sight.past.world_from_cam, sight.past.times_s
    back = [
        se3.transform(se3.inverse(poses[-1 - k]) @ poses[-1], points - (times_s[-1] - times_s[-1 - k]) * velocity)
        for k in STEPS
    ]
    return np.stack([pinhole.project(there, sight.camera)[0] for there in back])


def body_of(traffic: Any) -> BoolArray:
    inner = traffic.mask.copy()
    for axis in (0, 1):
        inner &= np.roll(traffic.mask, 2, axis) & np.roll(traffic.mask, -2, axis)
    return np.asarray(inner)


def test_exact_flow_gives_the_velocity_exactly(traffic: Any, sight: segmentation.Sight) -> None:
    true = np.array([1.2, 0.0, 5.0])
    places = places_of(true, 8.0, sight)
    np.testing.assert_allclose(velocity.by_flow(traffic.mask, 8.0, places, STEPS, sight), true, atol=1e-9)


def test_a_sixth_of_wrong_flow_is_outvoted(traffic: Any, sight: segmentation.Sight) -> None:
    true = np.array([1.2, 0.0, 5.0])
    places = places_of(true, 8.0, sight)
    rows = np.flatnonzero(traffic.mask.any(axis=1))
    places[:, rows[: len(rows) // 6]] += 6.0
    np.testing.assert_allclose(velocity.by_flow(traffic.mask, 8.0, places, STEPS, sight), true, atol=0.02)


def test_a_depth_wrong_by_a_factor_scales_the_velocity_against_the_camera(
    traffic: Any, sight: segmentation.Sight
) -> None:
    # The camera drives at 4 m/s; halved, everything against it is half: (0.6, 0, 0.5) + (0, 0, 4).
    places = places_of(np.array([1.2, 0.0, 5.0]), 8.0, sight)
    halved = velocity.by_flow(traffic.mask, 4.0, places, STEPS, sight)
    np.testing.assert_allclose(halved, [0.6, 0.0, 4.5], atol=1e-9)


def test_following_mends_a_velocity_that_is_a_fifth_wrong(traffic: Any, sight: segmentation.Sight) -> None:
    found = velocity.followed(np.array([1.0, 0.0, 4.8]), body_of(traffic), 8.0, sight)
    np.testing.assert_allclose(found, [1.2, 0.0, 5.0], atol=0.03)


def test_following_stays_where_nothing_is_to_be_seen(traffic: Any, sight: segmentation.Sight) -> None:
    blank = segmentation.Sight(
        np.full_like(traffic.images, 90.0), sight.camera, sight.past, sight.inverse_depth, sight.road
    )
    start = np.array([1.0, 0.0, 4.0])
    np.testing.assert_allclose(velocity.followed(start, body_of(traffic), 8.0, blank), start, atol=1e-9)


def test_one_earlier_frame_is_enough_to_follow(traffic: Any, sight: segmentation.Sight) -> None:
    short = segmentation.Sight(traffic.images[-2:], sight.camera, traffic.past[-2:], sight.inverse_depth, sight.road)
    found = velocity.followed(np.array([1.1, 0.0, 4.9]), body_of(traffic), 8.0, short)
    np.testing.assert_allclose(found, [1.2, 0.0, 5.0], atol=0.3)


def test_directions_lie_in_the_road() -> None:
    normal = np.array([0.1, 0.97, -0.2])
    normal /= np.linalg.norm(normal)
    directions = velocity.along_road(normal)
    np.testing.assert_allclose(normal @ directions, 0, atol=1e-12)
    np.testing.assert_allclose(directions.T @ directions, np.eye(2), atol=1e-12)
