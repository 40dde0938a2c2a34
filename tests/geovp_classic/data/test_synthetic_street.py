"""How a street is furnished: what stands where, and that the same seed builds the same street."""

import dataclasses

import numpy as np
import pytest

from geovp_classic.data.synthetic.drive import Manoeuvre, plan
from geovp_classic.data.synthetic.images import Texture
from geovp_classic.data.synthetic.mesh import TriangleMesh
from geovp_classic.data.synthetic.objects import DARK, car
from geovp_classic.data.synthetic.roads import Roads
from geovp_classic.data.synthetic.street import Street, build_street
from geovp_classic.types import FloatArray

SEED = 11
WALLS = (Texture.PLASTER_WINDOWS, Texture.BRICK_WINDOWS)
ROAD = (Texture.ASPHALT, Texture.ROAD, Texture.ZEBRA)


@pytest.fixture(scope="module")
def street() -> Street:
    return build_street(SEED, Manoeuvre.GENTLE_CURVE)


@pytest.fixture(scope="module")
def crossing() -> Street:
    return build_street(SEED, Manoeuvre.LEFT_TURN)


def roads_of(manoeuvre: Manoeuvre) -> Roads:
    rng = np.random.default_rng([SEED, list(Manoeuvre).index(manoeuvre)])
    return plan(manoeuvre, rng)[0]


def corners_of(world: Street, *textures: Texture) -> FloatArray:
    """Corners [N, 3] of all triangles of these textures, heights above the ground below them."""
    corners = (
        world.static.corners[np.isin(world.static.texture, textures)]
        .reshape(-1, 3)
        .astype(np.float64)
    )
    corners[:, 1] = -corners[:, 1] - world.terrain.height_m(corners[:, [0, 2]])
    return corners


def test_the_same_seed_builds_the_same_street(crossing: Street) -> None:
    again = build_street(SEED, Manoeuvre.LEFT_TURN)
    for part in dataclasses.fields(TriangleMesh):
        np.testing.assert_array_equal(
            getattr(again.static, part.name), getattr(crossing.static, part.name)
        )
    assert len(again.traffic) == len(crossing.traffic)
    np.testing.assert_array_equal(again.weather.to_sun, crossing.weather.to_sun)


def test_another_seed_or_manoeuvre_builds_another_street(street: Street, crossing: Street) -> None:
    assert len(street.static.texture) != len(crossing.static.texture)
    other = build_street(SEED + 1, Manoeuvre.GENTLE_CURVE)
    assert len(other.static.texture) != len(street.static.texture)


def test_every_number_is_finite(street: Street, crossing: Street) -> None:
    for world in (street, crossing):
        for part in dataclasses.fields(TriangleMesh):
            assert np.isfinite(getattr(world.static, part.name)).all(), part.name


def test_nothing_but_cars_stands_on_the_carriageway(street: Street, crossing: Street) -> None:
    for world, manoeuvre in ((street, Manoeuvre.GENTLE_CURVE), (crossing, Manoeuvre.LEFT_TURN)):
        roads = roads_of(manoeuvre)
        low = corners_of(world, *WALLS, Texture.PLASTER, Texture.BRICK, Texture.LEAVES)
        low = low[low[:, 1] < 1.5]  # crowns may hang over the road
        near = low[np.abs(low[:, 0]) + np.abs(low[:, 2]) < 400]
        assert len(near) > 5000
        assert roads.distance_m(near[::5, [0, 2]]).min() > 0.4


def test_houses_keep_their_distance_from_the_pavement(street: Street) -> None:
    walls = corners_of(street, *WALLS)
    assert (
        roads_of(Manoeuvre.GENTLE_CURVE).distance_m(walls[:, [0, 2]]).min() > 2.2
    )  # behind the pavement


def test_parked_cars_leave_the_lanes_free(street: Street) -> None:
    roads = roads_of(Manoeuvre.GENTLE_CURVE)
    dark = (street.static.texture == Texture.PLAIN) & (
        np.abs(street.static.tint - DARK).max(axis=-1) < 1e-6
    )
    wheels = street.static.corners[dark].reshape(-1, 3).astype(np.float64)
    wheels[:, 1] = -wheels[:, 1] - street.terrain.height_m(wheels[:, [0, 2]])
    inside_m = roads.distance_m(wheels[:, [0, 2]])
    assert len(wheels) > 500
    assert inside_m.max() < 0.0  # not on the pavement
    assert inside_m.min() > -2.2  # at least 2.4 m to the middle of the road
    assert wheels[:, 1].min() == pytest.approx(
        0.0, abs=0.08
    )  # on the ground, within the slope over a car's length


def test_a_street_has_houses_trees_cars_and_lamps(street: Street) -> None:
    count = np.bincount(street.static.texture, minlength=len(Texture))
    assert count[list(WALLS)].sum() / 8 > 15
    assert count[Texture.LEAVES] > 20_000
    assert count[Texture.CAR_WINDOW] / 16 > 10
    lamps = corners_of(street, Texture.PLAIN)
    assert (lamps[:, 1] > 5.8).sum() > 20


def test_colours_vary_from_house_to_house(street: Street) -> None:
    walls = street.static.tint[np.isin(street.static.texture, WALLS)]
    assert len(np.unique(walls.round(3), axis=0)) >= 5


def test_the_ground_has_no_hole_along_the_drive(street: Street) -> None:
    """Every place under the drive lies in a triangle of road."""
    mesh = street.static
    road = mesh.corners[np.isin(mesh.texture, ROAD)][..., [0, 2]].astype(np.float64)
    places, _ = street.ego.place_at(np.arange(0, 6, 0.2))
    for place in places:
        a, b, c = (road[:, k] - place for k in range(3))
        turns = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((a, b), (b, c), (c, a))]
        inside = np.all([turn >= -1e-6 for turn in turns], axis=0) | np.all(
            [turn <= 1e-6 for turn in turns], axis=0
        )
        assert inside.any()


def test_the_road_lies_on_the_hills(street: Street) -> None:
    np.testing.assert_allclose(corners_of(street, Texture.ROAD)[:, 1], 0.0, atol=1e-4)


def test_traffic_moves_as_its_journey_says(crossing: Street) -> None:
    before, after = crossing.traffic_at(1.0), crossing.traffic_at(2.0)
    assert len(before) == len(crossing.traffic) > 0
    for (_, journey), first, second in zip(crossing.traffic, before, after, strict=True):
        moved_m = second.corners.mean(axis=(0, 1)) - first.corners.mean(axis=(0, 1))
        expected_m = np.diff(journey.place_at(np.array([1.0, 2.0]))[0], axis=0)[0]
        np.testing.assert_allclose(moved_m[[0, 2]], expected_m, atol=0.1)


def test_traffic_stands_on_the_road(crossing: Street) -> None:
    for mesh in crossing.traffic_at(0.5):
        corners = mesh.corners.reshape(-1, 3).astype(np.float64)
        height_m = -corners[:, 1] - crossing.terrain.height_m(corners[:, [0, 2]])
        assert height_m.min() == pytest.approx(0.0, abs=0.08)
        assert 1.2 < height_m.max() < 2.2


def test_the_sun_is_up_on_every_day() -> None:
    for seed in range(3):
        to_sun = build_street(seed, Manoeuvre.STRAIGHT).weather.to_sun
        assert np.linalg.norm(to_sun) == pytest.approx(1.0)
        assert 30.0 <= np.rad2deg(np.arcsin(-to_sun[1])) <= 55.0  # y points down


def test_cars_come_in_several_kinds_and_colours() -> None:
    rng = np.random.default_rng(0)
    cars = [car(rng) for _ in range(30)]
    assert len({float(np.ptp(mesh.corners[..., 2]).round(3)) for mesh in cars}) == 3
    assert len({tuple(mesh.tint[0]) for mesh in cars}) >= 6
