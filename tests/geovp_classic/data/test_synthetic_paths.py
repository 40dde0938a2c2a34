"""Paths, hills, speeds and manoeuvres."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.data.synthetic.manoeuvres import Journey, Manoeuvre, Speed, plan
from geovp_classic.data.synthetic.roads import from_bends, straight
from geovp_classic.data.synthetic.terrain import Terrain, rolling_hills
from geovp_classic.types import FloatArray

TIMES_S = np.arange(60) * 0.1


def test_a_straight_path_continues_beyond_its_ends() -> None:
    path = straight((1.0, 2.0), np.pi / 2, 10.0)  # towards +x; right of it is -z
    places, yaw_rad = path.at(np.array([-3.0, 4.0, 15.0]), right_m=3.0)
    np.testing.assert_allclose(places, [[-2.0, -1.0], [5.0, -1.0], [16.0, -1.0]], atol=1e-9)
    np.testing.assert_allclose(yaw_rad, np.pi / 2)


@pytest.mark.parametrize("turn_rad", [-np.pi / 2, 0.3, np.pi / 2])
def test_bends_have_their_turn_and_length(turn_rad: float) -> None:
    path = from_bends([(30.0, 0.0), (20.0, turn_rad), (30.0, 0.0)])
    assert path.yaw_rad[-1] == pytest.approx(turn_rad, abs=1e-6)
    assert path.length_m == pytest.approx(80.0)
    steps_m = np.linalg.norm(np.diff(path.points, axis=0), axis=-1)
    np.testing.assert_allclose(steps_m, 0.25, atol=1e-9)


@given(along_m=st.floats(1.0, 99.0), right_m=st.floats(-8.0, 8.0))
def test_the_distance_from_a_path_is_recovered(along_m: float, right_m: float) -> None:
    path = from_bends([(40.0, 0.0), (30.0, 0.8), (30.0, 0.0)])
    place, _ = path.at(along_m, right_m)
    assert path.right_m(place[None])[0] == pytest.approx(right_m, abs=0.01)


def slope_of(terrain: Terrain, places: FloatArray) -> FloatArray:
    """Return the gradient [N, 2] of the height by central differences."""
    rises = [terrain.height_m(places + d) - terrain.height_m(places - d) for d in 1e-4 * np.eye(2)]
    return np.stack(rises, axis=-1) / 2e-4


@given(seed=st.integers(0, 1000))
def test_hills_are_gentle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slope = slope_of(rolling_hills(rng, max_slope=0.025), rng.uniform(-300, 300, (200, 2)))
    assert np.linalg.norm(slope, axis=-1).max() < 0.025 * 1.4 + 1e-7


def test_a_vehicle_follows_the_ground_along_its_heading() -> None:
    terrain = rolling_hills(np.random.default_rng(1), max_slope=0.03)
    places, yaw_rad = np.array([[3.0, 40.0], [-20.0, 9.0]]), np.array([0.4, -2.0])
    world_from_vehicle = terrain.world_from_vehicle(places, yaw_rad)
    rotation = world_from_vehicle[:, :3, :3]
    np.testing.assert_allclose(rotation @ rotation.swapaxes(-1, -2), [np.eye(3)] * 2, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    np.testing.assert_allclose(world_from_vehicle[:, 1, 3], -terrain.height_m(places))
    x, y, z = rotation[:, :, 2].T
    np.testing.assert_allclose(np.arctan2(x, z), yaw_rad, atol=1e-3)
    heading = np.stack([np.sin(yaw_rad), np.cos(yaw_rad)], axis=-1)
    expected = (slope_of(terrain, places) * heading).sum(axis=-1)
    np.testing.assert_allclose(-y / np.hypot(x, z), expected, atol=1e-4)


def test_distances_are_integrals_of_the_speed() -> None:
    steady = Speed([12.0]).travelled_m(np.array([-1.0, 0.0, 2.5]))
    np.testing.assert_allclose(steady, [-12.0, 0.0, 30.0], atol=1e-9)
    braking = Speed([12.0, 0.0], [1.0, 4.0])  # 4 m/s2: 12 m at full speed, then 18 m of braking
    np.testing.assert_allclose(braking.travelled_m(np.array([6.0, 8.0])), 30.0, atol=0.01)
    travelled_m = braking.travelled_m(np.array([2.3, 2.5, 2.7]))
    assert np.diff(travelled_m, n=2)[0] / 0.2**2 == pytest.approx(-4.0, abs=0.01)


def test_the_left_lane_leads_back() -> None:
    journey = Journey(straight((0.0, 0.0), 0.0, 100.0), Speed([5.0]), 60.0, right_m=-2.0)
    places, yaw_rad = journey.place_at(np.array([0.0, 4.0]))
    np.testing.assert_allclose(places, [[-2.0, 60.0], [-2.0, 40.0]], atol=1e-9)
    np.testing.assert_allclose(yaw_rad, np.pi)


@pytest.mark.parametrize("manoeuvre", list(Manoeuvre))
def test_manoeuvres_have_their_turn_and_speed(manoeuvre: Manoeuvre) -> None:
    for seed in range(5):
        places, yaw_rad = plan(manoeuvre, np.random.default_rng(seed)).ego.place_at(TIMES_S)
        turned_deg = np.rad2deg(yaw_rad - yaw_rad[0])
        speeds_m_s = np.linalg.norm(np.diff(places, axis=0), axis=-1) / 0.1
        assert speeds_m_s.max() < 15.0
        match manoeuvre:
            case Manoeuvre.LEFT_TURN | Manoeuvre.RIGHT_TURN:
                side = 1 if manoeuvre is Manoeuvre.RIGHT_TURN else -1
                assert turned_deg[-1] == pytest.approx(side * 90.0, abs=1.0)
                assert abs(turned_deg[3]) < 10 < 45 < abs(turned_deg[29])
            case Manoeuvre.GENTLE_CURVE | Manoeuvre.WINDING:
                assert 15.0 < np.ptp(turned_deg) < 70.0
            case Manoeuvre.BRAKE:
                assert speeds_m_s[0] > 9.0 > 0.05 > speeds_m_s[-1]
            case Manoeuvre.ACCELERATE:
                assert speeds_m_s[0] < 0.6 < 9.0 < speeds_m_s[-1]
            case Manoeuvre.STAND:
                assert speeds_m_s.max() == 0.0
            case Manoeuvre.STRAIGHT:
                assert np.ptp(turned_deg) < 1.0


@pytest.mark.parametrize("manoeuvre", list(Manoeuvre))
def test_cars_do_not_collide(manoeuvre: Manoeuvre) -> None:
    for seed in range(6):
        _, ego, traffic = plan(manoeuvre, np.random.default_rng(seed))
        places = np.stack([journey.place_at(TIMES_S)[0] for journey in (ego, *traffic)])
        gaps_m = np.linalg.norm(places[:, None] - places, axis=-1)
        gaps_m[np.diag_indices(len(places))] = np.inf
        assert gaps_m[0].min() > 2.6, f"seed {seed}: the camera's car"
        assert gaps_m.min() > 2.4, f"seed {seed}"
