"""Own velocities: exact from exact flow, and found again from images when they begin a fifth wrong."""

from typing import Any

import numpy as np

from geovp_classic.dynamic_objects import segmentation, velocity
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, FloatArray

STEPS = (1, 2, 3)


def flow_pixels_of(
    velocity: FloatArray, depth: float, observed: segmentation.Observations
) -> FloatArray:
    """Where a thing at the depth was in earlier frames, by walking it back in the world."""
    points = depth * pinhole.rays(observed.camera)
    poses, times_s = observed.past.world_from_cam, observed.past.times_s
    back = [
        se3.transform(
            se3.inverse(poses[-1 - k]) @ poses[-1],
            points - (times_s[-1] - times_s[-1 - k]) * velocity,
        )
        for k in STEPS
    ]
    return np.stack([pinhole.project(there, observed.camera)[0] for there in back])


def body_of(traffic: Any) -> BoolArray:
    inner = traffic.mask.copy()
    for axis in (0, 1):
        inner &= np.roll(traffic.mask, 2, axis) & np.roll(traffic.mask, -2, axis)
    return np.asarray(inner)


def test_exact_flow_gives_the_velocity_exactly(
    traffic: Any, observed: segmentation.Observations
) -> None:
    true = np.array([1.2, 0.0, 5.0])
    flow_pixels = flow_pixels_of(true, 8.0, observed)
    np.testing.assert_allclose(
        velocity.from_flow(traffic.mask, 8.0, flow_pixels, STEPS, observed), true, atol=1e-9
    )


def test_a_sixth_of_wrong_flow_is_outvoted(
    traffic: Any, observed: segmentation.Observations
) -> None:
    true = np.array([1.2, 0.0, 5.0])
    flow_pixels = flow_pixels_of(true, 8.0, observed)
    rows = np.flatnonzero(traffic.mask.any(axis=1))
    flow_pixels[:, rows[: len(rows) // 6]] += 6.0
    np.testing.assert_allclose(
        velocity.from_flow(traffic.mask, 8.0, flow_pixels, STEPS, observed), true, atol=0.02
    )


def test_a_depth_wrong_by_a_factor_scales_the_velocity_against_the_camera(
    traffic: Any, observed: segmentation.Observations
) -> None:
    # The camera drives at 4 m/s; halved, everything against it is half: (0.6, 0, 0.5) + (0, 0, 4).
    flow_pixels = flow_pixels_of(np.array([1.2, 0.0, 5.0]), 8.0, observed)
    halved = velocity.from_flow(traffic.mask, 4.0, flow_pixels, STEPS, observed)
    np.testing.assert_allclose(halved, [0.6, 0.0, 4.5], atol=1e-9)


def test_following_mends_a_velocity_that_is_a_fifth_wrong(
    traffic: Any, observed: segmentation.Observations
) -> None:
    found = velocity.tracked(np.array([1.0, 0.0, 4.8]), body_of(traffic), 8.0, observed)
    np.testing.assert_allclose(found, [1.2, 0.0, 5.0], atol=0.03)


def test_following_stays_where_nothing_is_to_be_seen(
    traffic: Any, observed: segmentation.Observations
) -> None:
    blank = segmentation.Observations(
        np.full_like(traffic.images, 90.0),
        observed.camera,
        observed.past,
        observed.inverse_depth,
        observed.road,
    )
    start = np.array([1.0, 0.0, 4.0])
    np.testing.assert_allclose(
        velocity.tracked(start, body_of(traffic), 8.0, blank), start, atol=1e-9
    )


def test_one_earlier_frame_is_enough_to_follow(
    traffic: Any, observed: segmentation.Observations
) -> None:
    short = segmentation.Observations(
        traffic.images[-2:],
        observed.camera,
        traffic.past[-2:],
        observed.inverse_depth,
        observed.road,
    )
    found = velocity.tracked(np.array([1.1, 0.0, 4.9]), body_of(traffic), 8.0, short)
    np.testing.assert_allclose(found, [1.2, 0.0, 5.0], atol=0.3)


def test_directions_lie_in_the_road() -> None:
    normal = np.array([0.1, 0.97, -0.2])
    normal /= np.linalg.norm(normal)
    directions = velocity.along_road(normal)
    np.testing.assert_allclose(normal @ directions, 0, atol=1e-12)
    np.testing.assert_allclose(directions.T @ directions, np.eye(2), atol=1e-12)
