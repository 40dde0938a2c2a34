"""How a street is furnished: what stands where, and that the same seed builds the same street."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geovp_classic.data.synthetic import Manoeuvre, World, build_world
from geovp_classic.data.synthetic.drive import plan
from geovp_classic.data.synthetic.furniture import draw_car
from geovp_classic.data.synthetic.ground import Roads
from geovp_classic.data.synthetic.mesh import Soup
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.data.synthetic.world import STEEPEST
from geovp_classic.types import FloatArray

SEED = 11
WALLS = (Texture.PLASTER, Texture.BRICK)


@pytest.fixture(scope="module")
def street() -> World:
    return build_world(SEED, Manoeuvre.GENTLE_CURVE)


@pytest.fixture(scope="module")
def crossing() -> World:
    return build_world(SEED, Manoeuvre.LEFT_TURN)


def roads_of(manoeuvre: Manoeuvre) -> Roads:
    rng = np.random.default_rng([SEED, list(Manoeuvre).index(manoeuvre)])
    return plan(manoeuvre, rng).roads


def corners_of(world: World, *textures: Texture) -> FloatArray:
    """Corners [N, 3] of all triangles of these textures, heights above the ground below them."""
    corners = world.static.corners[np.isin(world.static.texture, textures)].reshape(-1, 3).astype(np.float64)
    corners[:, 1] = -corners[:, 1] - world.terrain.height_m(corners[:, [0, 2]])
    return corners


def test_the_same_seed_builds_the_same_street(crossing: World) -> None:
    again = build_world(SEED, Manoeuvre.LEFT_TURN)
    for part in dataclasses.fields(Soup):
        np.testing.assert_array_equal(getattr(again.static, part.name), getattr(crossing.static, part.name))
    assert len(again.traffic) == len(crossing.traffic)
    np.testing.assert_array_equal(again.weather.to_sun, crossing.weather.to_sun)


def test_another_seed_or_manoeuvre_builds_another_street(street: World, crossing: World) -> None:
    assert len(street.static) != len(crossing.static)
    other = build_world(SEED + 1, Manoeuvre.GENTLE_CURVE)
    assert len(other.static) != len(street.static)


def test_every_number_is_finite(street: World, crossing: World) -> None:
    for world in (street, crossing):
        for part in dataclasses.fields(Soup):
            assert np.isfinite(getattr(world.static, part.name)).all(), part.name


def test_nothing_but_cars_stands_on_the_carriageway(street: World, crossing: World) -> None:
    for world, manoeuvre in ((street, Manoeuvre.GENTLE_CURVE), (crossing, Manoeuvre.LEFT_TURN)):
        roads = roads_of(manoeuvre)
        low = corners_of(world, *WALLS, Texture.BARK, Texture.LEAVES, Texture.WINDOW_CROSS)
        low = low[low[:, 1] < 1.5]  # crowns may hang over the road
        near = low[np.abs(low[:, 0]) + np.abs(low[:, 2]) < 400]
        assert roads.distance_m(near[:, [0, 2]]).min() > 0.4


def test_houses_keep_their_distance_from_the_pavement(street: World) -> None:
    walls = corners_of(street, *WALLS)
    assert roads_of(Manoeuvre.GENTLE_CURVE).distance_m(walls[:, [0, 2]]).min() > 2.2  # behind the pavement


def test_parked_cars_leave_the_lanes_free(street: World) -> None:
    roads = roads_of(Manoeuvre.GENTLE_CURVE)
    wheels = corners_of(street, Texture.WHEEL)
    inside_m = roads.distance_m(wheels[:, [0, 2]])
    assert len(wheels) > 500
    assert inside_m.max() < 0.0  # not on the pavement
    assert inside_m.min() > -2.2  # at least 2.4 m to the middle of the road
    assert wheels[:, 1].min() == pytest.approx(0.0, abs=0.08)  # on the ground, within the slope over a car's length


def test_a_street_has_houses_windows_trees_lamps_and_signs(street: World) -> None:
    count = np.bincount(street.static.texture, minlength=len(Texture))
    windows = count[[Texture.WINDOW_PLAIN, Texture.WINDOW_CURTAIN, Texture.WINDOW_CROSS]].sum() / 2
    assert windows > 200
    assert count[Texture.DOOR] / 2 > 15
    assert count[Texture.LEAVES] > 20_000
    assert count[Texture.SIGN_RING] + count[Texture.SIGN_BLUE] > 0
    lamps = corners_of(street, Texture.PLAIN)
    assert (lamps[:, 1] > 5.8).sum() > 20


def test_colours_vary_from_house_to_house(street: World) -> None:
    walls = street.static.tint[np.isin(street.static.texture, WALLS)]
    assert len(np.unique(walls.round(3), axis=0)) >= 5


def test_the_ground_has_no_hole_along_the_drive(street: World) -> None:
    """Every place under the drive lies in a triangle of asphalt or paint."""
    soup = street.static
    road = soup.corners[soup.texture == Texture.ASPHALT][..., [0, 2]].astype(np.float64)
    places, _ = street.ego.place_at(np.arange(0, 6, 0.2))
    for place in places:
        a, b, c = (road[:, k] - place for k in range(3))
        turns = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((a, b), (b, c), (c, a))]
        inside = np.all([turn >= -1e-6 for turn in turns], axis=0) | np.all([turn <= 1e-6 for turn in turns], axis=0)
        assert inside.any()


def test_the_road_lies_on_the_hills(street: World) -> None:
    road = corners_of(street, Texture.ASPHALT)
    np.testing.assert_allclose(road[:, 1], 0.0, atol=1e-4)
    places, _ = street.ego.place_at(np.arange(0, 6, 0.1))
    slope = np.linalg.norm(street.terrain.slope(places), axis=-1)
    assert slope.max() < 1.4 * STEEPEST


def test_traffic_moves_as_its_journey_says(crossing: World) -> None:
    before, after = crossing.traffic_at(1.0), crossing.traffic_at(2.0)
    assert len(before) == len(crossing.traffic) > 0
    for (_, journey), first, second in zip(crossing.traffic, before, after, strict=True):
        moved_m = second.corners.mean(axis=(0, 1)) - first.corners.mean(axis=(0, 1))
        expected_m = np.diff(journey.place_at(np.array([1.0, 2.0]))[0], axis=0)[0]
        np.testing.assert_allclose(moved_m[[0, 2]], expected_m, atol=0.1)


def test_traffic_stands_on_the_road(crossing: World) -> None:
    for soup in crossing.traffic_at(0.5):
        corners = soup.corners.reshape(-1, 3).astype(np.float64)
        height_m = -corners[:, 1] - crossing.terrain.height_m(corners[:, [0, 2]])
        assert height_m.min() == pytest.approx(0.0, abs=0.08)
        assert 1.2 < height_m.max() < 2.2


def test_the_sun_is_up_on_every_day() -> None:
    for seed in range(3):
        to_sun = build_world(seed, Manoeuvre.STRAIGHT).weather.to_sun
        assert np.linalg.norm(to_sun) == pytest.approx(1.0)
        assert 30.0 <= np.rad2deg(np.arcsin(-to_sun[1])) <= 55.0  # y points down


def test_cars_come_in_several_kinds_and_colours() -> None:
    rng = np.random.default_rng(0)
    cars = [draw_car(rng) for _ in range(30)]
    assert len({len(car) for car in cars} | {float(np.ptp(car.corners[..., 2])) for car in cars}) >= 3
    assert len({tuple(car.tint[0]) for car in cars}) >= 6
