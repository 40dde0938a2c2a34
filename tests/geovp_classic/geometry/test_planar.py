"""Reduction to the vehicle's plane, and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.geometry import planar, se3

tilts = st.floats(-0.3, 0.3)
places = st.floats(-40, 40)
states = st.lists(st.tuples(places, places, st.floats(-3.1, 3.1)), min_size=1, max_size=6)
seeds = st.integers(0, 2**32 - 1)


def random_pose(seed: int) -> np.ndarray:
    return se3.exp(np.random.default_rng(seed).uniform(-1.5, 1.5, 6))


@given(states.map(np.array), seeds, tilts, tilts)
def test_reduce_undoes_lift(
    states: np.ndarray, seed: int, pitch_rad: float, roll_rad: float
) -> None:
    vehicle_from_cam = planar.level_vehicle_from_cam(pitch_rad, roll_rad)
    reference = random_pose(seed)
    several = np.stack([states, 0.5 * states])  # leading axes are kept
    lifted = planar.lift(several, reference, vehicle_from_cam)
    reduced = planar.reduce(lifted, reference, vehicle_from_cam)
    np.testing.assert_allclose(reduced, several, atol=1e-9)


def test_yaw_is_positive_to_the_right_and_height_is_dropped() -> None:
    level = planar.level_vehicle_from_cam()
    quarter_right = se3.exp(np.array([0, 0, 0, 0, np.pi / 2, 0]))  # about y (down): from z to x
    moved = se3.compose(quarter_right[:3, :3], np.array([3.0, -1.0, 4.0]))
    state = planar.reduce(moved[None], np.eye(4), level)[0]
    np.testing.assert_allclose(state, [3, 4, np.pi / 2], atol=1e-12)
    assert planar.lift(state[None], np.eye(4), level)[0, 1, 3] == pytest.approx(0)


def test_a_camera_that_looks_up_drives_on_the_level_ground() -> None:
    # It looks 0.1 rad above the road: ten metres ahead on it are 10 m * sin(0.1) below the axis.
    tilted = planar.level_vehicle_from_cam(pitch_rad=0.1)
    ahead = planar.lift(np.array([[0.0, 10, 0]]), np.eye(4), tilted)[0]
    np.testing.assert_allclose(ahead[:3, 3], [0, 10 * np.sin(0.1), 10 * np.cos(0.1)], atol=1e-12)
    np.testing.assert_allclose(ahead[:3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("speed", [0.8, -0.3])
def test_the_pitch_of_travel(speed: float) -> None:
    """The camera looks 6 degrees above the road, forwards and backwards, in a bend."""
    up = se3.exp(np.array([0, 0, 0, np.radians(6.0), 0, 0]))
    poses = se3.exp(speed * np.arange(10)[:, None] * np.array([0, 0, 1.0, 0, 0.05, 0])) @ up
    steps = (se3.inverse(poses[:-1]) @ poses[1:])[:, :3, 3]
    assert np.degrees(planar.travel_pitch_rad(steps)) == pytest.approx(6, abs=0.01)
    assert planar.travel_pitch_rad(steps[:0]) == 0
