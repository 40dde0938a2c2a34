"""Paths, roads, speeds and manoeuvres."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.data.synthetic.roads import Journey, from_bends
from geovp_classic.data.synthetic.street import MANOEUVRES, plan

TIMES_S = np.arange(60) * 0.1


def test_a_straight_path_continues_beyond_its_ends() -> None:
    path = from_bends(
        [(10.0, 0.0)], start=(1.0, 2.0), start_yaw_deg=90.0
    )  # towards +x; right of it is -z
    places, yaw_rad = path.at(np.array([-3.0, 4.0, 15.0]), right_m=3.0)
    np.testing.assert_allclose(places, [-2 - 1j, 5 - 1j, 16 - 1j], atol=1e-9)
    np.testing.assert_allclose(yaw_rad, np.pi / 2)


@given(along_m=st.floats(1.0, 99.0), right_m=st.floats(-8.0, 8.0))
def test_places_beside_a_path_are_recovered(along_m: float, right_m: float) -> None:
    path = from_bends([(40.0, 0.0), (30.0, 0.8), (30.0, 0.0)])
    place, _ = path.at(np.array([along_m]), right_m)
    located_m = path.locate(place)[0][0]
    assert located_m.real == pytest.approx(right_m, abs=0.01)
    assert located_m.imag == pytest.approx(along_m, abs=0.03)  # 8 m * curvature * half a step


def test_distances_are_integrals_of_the_speed() -> None:
    path = from_bends([(100.0, 0.0)])
    steady = Journey(path, 0.0, 0.0, [12.0]).travelled_m(np.array([-1.0, 0.0, 2.5]))
    np.testing.assert_allclose(steady, [-12.0, 0.0, 30.0], atol=1e-9)
    # 4 m/s2: 12 m at full speed, then 18 m of braking
    braking = Journey(path, 0.0, 0.0, [12.0, 0.0], [1.0, 4.0])
    np.testing.assert_allclose(braking.travelled_m(np.array([6.0, 8.0])), 30.0, atol=0.01)
    travelled_m = braking.travelled_m(np.array([2.3, 2.5, 2.7]))
    assert np.diff(travelled_m, n=2)[0] / 0.2**2 == pytest.approx(-4.0, abs=0.01)


@pytest.mark.parametrize("manoeuvre", list(MANOEUVRES))
def test_manoeuvres_have_their_turn_and_speed(manoeuvre: str) -> None:
    for seed in range(5):
        _, (ego, *_) = plan(manoeuvre, np.random.default_rng(seed))
        places, yaw_rad = ego.place_at(TIMES_S)
        turned_deg = np.rad2deg(yaw_rad - yaw_rad[0])
        speeds_m_s = np.abs(np.diff(places)) / 0.1
        assert speeds_m_s.max() < 15.0
        match manoeuvre:
            case "left-turn" | "right-turn":
                side = 1 if manoeuvre == "right-turn" else -1
                assert turned_deg[-1] == pytest.approx(side * 90.0, abs=1.0)
                assert abs(turned_deg[3]) < 10 < 45 < abs(turned_deg[29])
            case "gentle-curve" | "winding":
                assert 15.0 < np.ptp(turned_deg) < 70.0
            case "brake":
                assert speeds_m_s[0] > 9.0 > 0.05 > speeds_m_s[-1]
            case "accelerate":
                assert speeds_m_s[0] < 0.6 < 9.0 < speeds_m_s[-1]
            case "stand":
                assert speeds_m_s.max() == 0.0
            case "straight":
                assert np.ptp(turned_deg) < 1.0


@pytest.mark.parametrize("manoeuvre", list(MANOEUVRES))
def test_cars_do_not_collide(manoeuvre: str) -> None:
    for seed in range(6):
        _, journeys = plan(manoeuvre, np.random.default_rng(seed))
        places = np.stack([journey.place_at(TIMES_S)[0] for journey in journeys])
        gaps_m = np.abs(places[:, None] - places)
        gaps_m[np.diag_indices(len(places))] = np.inf
        assert gaps_m[0].min() > 2.6, f"seed {seed}: the camera's car"
        assert gaps_m.min() > 2.4, f"seed {seed}"
