"""Furnished streets: the objects, their places, and the traffic."""

import numpy as np
import pytest

from geovp_classic.data.synthetic.manoeuvres import Manoeuvre, plan
from geovp_classic.data.synthetic.objects import TINTS
from geovp_classic.data.synthetic.roads import Roads
from geovp_classic.data.synthetic.street import Street, build_street
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.types import FloatArray

SEED = 11
WALLS = (Texture.PLASTER_WINDOWS, Texture.BRICK_WINDOWS)


@pytest.fixture(scope="module")
def street() -> Street:
    return build_street(SEED, Manoeuvre.GENTLE_CURVE)


@pytest.fixture(scope="module")
def crossing() -> Street:
    return build_street(SEED, Manoeuvre.LEFT_TURN)


def roads_of(manoeuvre: Manoeuvre) -> Roads:
    rng = np.random.default_rng([SEED, list(Manoeuvre).index(manoeuvre)])
    return plan(manoeuvre, rng).roads


def above_ground(street: Street, corners: FloatArray) -> FloatArray:
    """Return points [N, 3] as (x, height above the ground below, z)."""
    x, y, z = corners.reshape(-1, 3).T
    places = np.stack([x, z], axis=-1)
    return np.stack([x, -y - street.terrain.height_m(places), z], axis=-1)


def corners_of(street: Street, *textures: Texture) -> FloatArray:
    """Return the corners [N, 3] of all triangles of these textures, relative to the ground."""
    is_wanted = np.isin(street.static.texture, textures)
    return above_ground(street, street.static.corners[is_wanted])


def test_seed_and_manoeuvre_determine_the_street(street: Street, crossing: Street) -> None:
    again = build_street(SEED, Manoeuvre.LEFT_TURN)
    for name, values in vars(again.static).items():
        np.testing.assert_allclose(values, getattr(crossing.static, name), atol=1e-6)
        assert np.isfinite(values).all()
    other = build_street(SEED + 1, Manoeuvre.GENTLE_CURVE)
    counts = {len(world.static.texture) for world in (street, crossing, other)}
    assert len(counts) == 3


def test_only_cars_stand_on_the_carriageway(street: Street, crossing: Street) -> None:
    for world, manoeuvre in ((street, Manoeuvre.GENTLE_CURVE), (crossing, Manoeuvre.LEFT_TURN)):
        low = corners_of(world, *WALLS, Texture.PLASTER, Texture.BRICK, Texture.LEAVES)
        low = low[low[:, 1] < 1.5]  # crowns may hang over the road
        near = low[np.abs(low[:, 0]) + np.abs(low[:, 2]) < 400]
        assert len(near) > 5000
        assert roads_of(manoeuvre).distance_m(near[::5, [0, 2]]).min() > 0.4


def test_houses_keep_their_distance_from_the_pavement(street: Street) -> None:
    walls = corners_of(street, *WALLS)
    assert roads_of(Manoeuvre.GENTLE_CURVE).distance_m(walls[:, [0, 2]]).min() > 2.2


def test_parked_cars_leave_the_lanes_free(street: Street) -> None:
    is_plain = street.static.texture == Texture.PLAIN
    is_dark = np.abs(street.static.tint - TINTS["dark"]).max(axis=-1) < 1e-6
    wheels = above_ground(street, street.static.corners[is_plain & is_dark])
    from_kerb_m = roads_of(Manoeuvre.GENTLE_CURVE).distance_m(wheels[:, [0, 2]])
    assert len(wheels) > 500
    assert from_kerb_m.max() < 0.0  # not on the pavement
    assert from_kerb_m.min() > -2.2  # at least 2.4 m to the middle of the road
    assert wheels[:, 1].min() == pytest.approx(0.0, abs=0.08)  # the slope over a car's length


def test_a_street_has_houses_trees_cars_and_lamps(street: Street) -> None:
    count = np.bincount(street.static.texture, minlength=len(Texture))
    assert count[list(WALLS)].sum() / 8 > 15
    assert count[Texture.LEAVES] > 20_000
    assert count[Texture.CAR_WINDOW] / 16 > 10
    assert (corners_of(street, Texture.PLAIN)[:, 1] > 5.8).sum() > 20
    wall_tints = street.static.tint[np.isin(street.static.texture, WALLS)]
    assert len(np.unique(wall_tints.round(3), axis=0)) >= 5


def test_the_road_covers_the_drive_and_lies_on_the_hills(street: Street) -> None:
    np.testing.assert_allclose(corners_of(street, Texture.ROAD)[:, 1], 0.0, atol=1e-4)
    road = street.static.corners[street.static.texture == Texture.ROAD][..., [0, 2]]
    places, _ = street.ego.place_at(np.arange(0, 6, 0.2))
    for place in places:
        a, b, c = (road[:, k] - place for k in range(3))
        turns = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((a, b), (b, c), (c, a))]
        same_side = np.abs(np.sign(np.round(turns, 6)).sum(axis=0))
        assert same_side.max() >= 2  # in a triangle, or on its edge


def test_traffic_drives_along_its_journeys_on_the_road(crossing: Street) -> None:
    before, after = crossing.traffic_at(1.0), crossing.traffic_at(2.0)
    assert len(before) == len(crossing.traffic) > 0
    for (_, journey), first, second in zip(crossing.traffic, before, after, strict=True):
        moved_m = second.corners.mean(axis=(0, 1)) - first.corners.mean(axis=(0, 1))
        expected_m = np.diff(journey.place_at(np.array([1.0, 2.0]))[0], axis=0)[0]
        np.testing.assert_allclose(moved_m[[0, 2]], expected_m, atol=0.1)
        height_m = above_ground(crossing, first.corners)[:, 1]
        assert height_m.min() == pytest.approx(0.0, abs=0.08)
        assert 1.2 < height_m.max() < 2.2


def test_the_sun_is_30_to_55_degrees_high() -> None:
    for seed in range(3):
        to_sun = build_street(seed, Manoeuvre.STRAIGHT).weather.to_sun
        assert np.linalg.norm(to_sun) == pytest.approx(1.0)
        assert 30.0 <= np.rad2deg(np.arcsin(-to_sun[1])) <= 55.0  # y points down
