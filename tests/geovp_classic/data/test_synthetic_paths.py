"""Paths, hills and speeds: what a map and a clock say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.data.synthetic.drive import Journey, Manoeuvre, Speed, plan
from geovp_classic.data.synthetic.roads import Terrain, from_bends, rolling, straight

FLAT = Terrain(np.zeros(1), np.zeros((1, 2)), np.zeros(1))


def test_a_straight_path_goes_where_it_points() -> None:
    path = straight((1.0, 2.0), np.pi / 2, 10.0)  # towards +x
    place, yaw_rad = path.at(4.0, right_m=3.0)  # right of +x is -z
    np.testing.assert_allclose(place, [5.0, -1.0], atol=1e-9)
    assert yaw_rad == pytest.approx(np.pi / 2)


def test_a_path_goes_straight_on_beyond_its_ends() -> None:
    path = straight((0.0, 0.0), 0.0, 10.0)
    place, _ = path.at(np.array([-3.0, 15.0]))
    np.testing.assert_allclose(place, [[0.0, -3.0], [0.0, 15.0]], atol=1e-9)


@pytest.mark.parametrize("turn_rad", [-np.pi / 2, 0.3, np.pi / 2])
def test_bends_turn_by_what_they_say(turn_rad: float) -> None:
    path = from_bends([(30.0, 0.0), (20.0, turn_rad), (30.0, 0.0)])
    assert path.yaw_rad[-1] == pytest.approx(turn_rad, abs=1e-6)
    assert path.length_m == pytest.approx(80.0)
    steps_m = np.linalg.norm(np.diff(path.points, axis=0), axis=-1)
    np.testing.assert_allclose(steps_m, 0.25, atol=1e-9)


def test_a_quarter_turn_ends_one_radius_ahead_and_beside() -> None:
    radius_m = 40.0
    path = from_bends([(radius_m * np.pi / 2, np.pi / 2)], easing_m=0.25)
    np.testing.assert_allclose(path.points[-1], [radius_m, radius_m], atol=0.3)


@given(along_m=st.floats(1.0, 99.0), right_m=st.floats(-8.0, 8.0))
def test_places_beside_a_path_are_found_there(along_m: float, right_m: float) -> None:
    path = from_bends([(40.0, 0.0), (30.0, 0.8), (30.0, 0.0)])
    place, _ = path.at(along_m, right_m)
    assert path.right_m(place[None])[0] == pytest.approx(right_m, abs=0.01)


def slope_of(terrain: Terrain, places: np.ndarray) -> np.ndarray:
    """The gradient [N, 2] of the height by central differences."""
    steps = 1e-4 * np.eye(2)
    return (
        np.stack(
            [terrain.height_m(places + step) - terrain.height_m(places - step) for step in steps],
            -1,
        )
        / 2e-4
    )


@given(seed=st.integers(0, 1000))
def test_hills_are_gentle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slope = slope_of(rolling(rng, steepest=0.025), rng.uniform(-300, 300, (200, 2)))
    assert np.linalg.norm(slope, axis=-1).max() < 0.025 * 1.4 + 1e-7


def test_a_vehicle_stands_on_the_ground_along_its_heading() -> None:
    terrain = rolling(np.random.default_rng(1), steepest=0.03)
    places, yaw_rad = np.array([[3.0, 40.0], [-20.0, 9.0]]), np.array([0.4, -2.0])
    world_from_vehicle = terrain.world_from_vehicle(places, yaw_rad)
    rotation = world_from_vehicle[:, :3, :3]
    np.testing.assert_allclose(
        rotation @ rotation.swapaxes(-1, -2), np.tile(np.eye(3), (2, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    np.testing.assert_allclose(world_from_vehicle[:, 1, 3], -terrain.height_m(places))
    ahead = rotation[:, :, 2]
    np.testing.assert_allclose(np.arctan2(ahead[:, 0], ahead[:, 2]), yaw_rad, atol=1e-3)
    rise = -ahead[:, 1] / np.hypot(ahead[:, 0], ahead[:, 2])  # per metre ahead
    expected = (
        slope_of(terrain, places) * np.stack([np.sin(yaw_rad), np.cos(yaw_rad)], axis=-1)
    ).sum(axis=-1)
    np.testing.assert_allclose(rise, expected, atol=1e-4)


def test_constant_speed_travels_speed_times_time() -> None:
    speed = Speed([0.0], [12.0])
    np.testing.assert_allclose(
        speed.travelled_m(np.array([-1.0, 0.0, 2.5])), [-12.0, 0.0, 30.0], atol=1e-9
    )


def test_braking_travels_half_speed_times_time_and_then_stands() -> None:
    speed = Speed([1.0, 4.0], [12.0, 0.0])  # 4 m/s2: 12 m at full speed, then 18 m of braking
    np.testing.assert_allclose(speed.travelled_m(np.array([6.0, 8.0])), 30.0, atol=0.01)
    travelled_m = speed.travelled_m(np.array([2.3, 2.5, 2.7]))
    assert np.diff(travelled_m, n=2)[0] / 0.2**2 == pytest.approx(-4.0, abs=0.01)


def test_the_lane_on_the_left_leads_back() -> None:
    journey = Journey(straight((0.0, 0.0), 0.0, 100.0), Speed([0.0], [5.0]), 60.0, right_m=-2.0)
    place, yaw_rad = journey.place_at(np.array([0.0, 4.0]))
    np.testing.assert_allclose(place, [[-2.0, 60.0], [-2.0, 40.0]], atol=1e-9)
    np.testing.assert_allclose(yaw_rad, np.pi)
    ahead = FLAT.world_from_vehicle(*journey.place_at(np.array([0.0])))[0, :3, 2]
    np.testing.assert_allclose(ahead, [0.0, 0.0, -1.0], atol=1e-9)


TIMES_S = np.arange(60) * 0.1


def _ego(manoeuvre: Manoeuvre, seed: int) -> tuple[np.ndarray, np.ndarray]:
    return plan(manoeuvre, np.random.default_rng(seed))[1].place_at(TIMES_S)


@pytest.mark.parametrize(
    ("manoeuvre", "turn_deg"), [(Manoeuvre.LEFT_TURN, -90.0), (Manoeuvre.RIGHT_TURN, 90.0)]
)
def test_turns_are_quarter_turns_that_fall_into_the_first_three_seconds(
    manoeuvre: Manoeuvre, turn_deg: float
) -> None:
    for seed in range(5):
        _, yaw_rad = _ego(manoeuvre, seed)
        turned_deg = np.rad2deg(yaw_rad - yaw_rad[0])
        assert turned_deg[-1] == pytest.approx(turn_deg, abs=1.0)
        assert abs(turned_deg[3]) < 10 < 45 < abs(turned_deg[29])


def test_speeds_are_those_of_a_town() -> None:
    for manoeuvre in Manoeuvre:
        place, _ = _ego(manoeuvre, 0)
        speeds_m_s = np.linalg.norm(np.diff(place, axis=0), axis=-1) / 0.1
        assert speeds_m_s.max() < 15.0
        if manoeuvre is Manoeuvre.STAND:
            assert speeds_m_s.max() == 0.0
        if manoeuvre is Manoeuvre.BRAKE:
            assert speeds_m_s[0] > 9.0
            assert speeds_m_s[-1] < 0.05
        if manoeuvre is Manoeuvre.ACCELERATE:
            assert speeds_m_s[0] < 0.6
            assert speeds_m_s[-1] > 9.0


def test_curves_turn_and_straights_do_not() -> None:
    turned_deg = {kind: np.ptp(np.rad2deg(_ego(kind, 1)[1])) for kind in Manoeuvre}
    assert turned_deg[Manoeuvre.STRAIGHT] < 1.0
    assert 15.0 < turned_deg[Manoeuvre.GENTLE_CURVE] < 70.0
    assert turned_deg[Manoeuvre.WINDING] > 15.0


@pytest.mark.parametrize("manoeuvre", list(Manoeuvre))
def test_nobody_crashes(manoeuvre: Manoeuvre) -> None:
    """The ego car and all others stay a car's width apart, for several seeds."""
    for seed in range(6):
        _, ego, traffic = plan(manoeuvre, np.random.default_rng(seed))
        places = np.stack([journey.place_at(TIMES_S)[0] for journey in (ego, *traffic)])
        gaps_m = np.linalg.norm(places[:, None] - places[None], axis=-1)
        gaps_m[np.arange(len(places)), np.arange(len(places))] = np.inf
        assert gaps_m[0].min() > 2.6, f"seed {seed}: the camera's car"
        assert gaps_m.min() > 2.4, f"seed {seed}"
