"""Meshes of the street: areas, sizes of objects, roads and the ground."""

import numpy as np
import pytest

from geovp_classic.data.synthetic import objects
from geovp_classic.data.synthetic.mesh import box, lathe, sheet, triangles
from geovp_classic.data.synthetic.roads import Roads, straight
from geovp_classic.data.synthetic.terrain import Terrain, ground
from geovp_classic.data.synthetic.textures import TILE_M, Texture
from geovp_classic.types import FloatArray

FLAT = Terrain(np.zeros(1), np.zeros((1, 2)), np.zeros(1))
ROAD = Roads([straight((0.0, -80.0), 0.0, 160.0)])
CROSSING = Roads([*ROAD.paths, straight((-80.0, 0.0), np.pi / 2, 160.0)], (80.0, 80.0))


def crosses(corners: FloatArray) -> FloatArray:
    """Return twice the area vectors [N, 3] of triangles [N, 3, 3]."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def area(corners: FloatArray) -> float:
    return float(0.5 * np.linalg.norm(crosses(corners), axis=-1).sum())


def ground_of(roads: Roads, texture: Texture) -> FloatArray:
    """Return the corners [N, 3, 3] of one texture on flat ground."""
    mesh = ground(roads, FLAT, np.array([10.0, -5.0]), np.random.default_rng(0))
    return mesh.corners[mesh.texture == texture]


def test_a_box_has_four_walls_and_a_lid_that_face_outward() -> None:
    corners = box((0, -1, 0), (1.5, 1, 0.5), Texture.PLAIN).corners
    assert area(corners) == pytest.approx(2 * (3 * 2 + 1 * 2) + 3 * 1)
    outward = corners.mean(axis=1) - [0.0, -1.0, 0.0]
    sides = (crosses(corners) * outward).sum(axis=-1)
    assert (sides >= 0).all() or (sides <= 0).all()


def test_round_objects_have_the_area_of_a_tube_a_disc_and_a_ball() -> None:
    tube = lathe((0, 0, 0), (0, -2, 0), [(0, 0.5), (1, 0.5)], 64)
    disc = lathe((1, 2, 3), (2, 2, 3), [(0, 0.5), (0, 0.0)], 64)
    angle_rad = np.linspace(0, np.pi, 65)
    profile = np.stack([0.5 - 0.5 * np.cos(angle_rad), np.sin(angle_rad)], axis=-1)
    ball = lathe((0, 1, 0), (0, -1, 0), profile, 64)
    for rings, expected in ((tube, 2 * np.pi), (disc, np.pi / 4), (ball, 4 * np.pi)):
        assert area(sheet(rings, Texture.PLAIN).corners) == pytest.approx(expected, rel=3e-3)


def test_textures_keep_their_size_on_upright_and_flat_triangles() -> None:
    wall = np.array([[(0, 0, 0), (2, 0, 0), (0, 3, 0)]], dtype=float)
    floor = np.array([[(0, 0, 0), (2, 0, 0), (0, 0, 3)]], dtype=float)
    for corners in (wall, floor):
        uv = triangles(corners, Texture.BRICK).uv * TILE_M[Texture.BRICK]
        assert area(np.pad(uv, ((0, 0), (0, 0), (0, 1)))) == pytest.approx(3.0)


def test_distances_from_the_kerb_are_signed_and_corners_are_rounded() -> None:
    width_m, radius_m = ROAD.half_width_m, ROAD.corner_radius_m
    places = np.array([[0.0, 50.0], [width_m, 50.0], [-width_m - 3.0, 50.0]])
    np.testing.assert_allclose(ROAD.distance_m(places), [-width_m, 0.0, 3.0], atol=1e-9)
    on_arc = width_m + radius_m * (1 - 0.5**0.5)
    places = np.array([[on_arc, on_arc], [width_m, width_m], [width_m, 30.0]])
    expected = [0.0, -radius_m * (2**0.5 - 1), 0.0]
    np.testing.assert_allclose(CROSSING.distance_m(places), expected, atol=1e-6)


@pytest.mark.parametrize("roads", [CROSSING, ROAD])
def test_kerbs_lie_at_distance_zero_with_the_road_on_their_left(roads: Roads) -> None:
    for kerb in roads.kerbs():
        inside = np.abs(kerb).max(axis=-1) < 75
        assert inside.sum() > 50
        np.testing.assert_allclose(roads.distance_m(kerb[inside]), 0.0, atol=0.01)
        along = np.gradient(kerb, axis=0)
        right = along[:, ::-1] * [1, -1] / np.linalg.norm(along, axis=-1, keepdims=True)
        np.testing.assert_allclose(roads.distance_m((kerb + right)[inside]), 1.0, atol=0.02)


def test_pavements_lie_a_kerb_above_the_road() -> None:
    road, pavement = (ground_of(ROAD, texture) for texture in (Texture.ROAD, Texture.PAVEMENT))
    np.testing.assert_allclose(road[..., 1], 0.0, atol=1e-6)
    np.testing.assert_allclose(pavement[..., 1], -ROAD.kerb_height_m, atol=1e-6)
    assert area(road) == pytest.approx(2 * ROAD.half_width_m * 160.0, rel=0.01)


def test_zebra_crossings_lie_before_all_four_arms_of_a_junction() -> None:
    zebra = ground_of(CROSSING, Texture.ZEBRA)
    assert area(zebra) == pytest.approx(4 * CROSSING.zebra_m * 2 * CROSSING.half_width_m, rel=0.02)
    reach_m = np.abs(zebra[..., [0, 2]]).max(axis=-1)
    assert reach_m.min() == pytest.approx(CROSSING.junction_m)
    assert reach_m.max() == pytest.approx(CROSSING.junction_m + CROSSING.zebra_m)


def test_hills_rise_beyond_300_m_on_all_sides() -> None:
    far = ground_of(CROSSING, Texture.GRASS).reshape(-1, 3)
    reach_m = np.hypot(far[:, 0] - 10.0, far[:, 2] + 5.0)
    assert reach_m.max() == pytest.approx(450.0)
    assert far[reach_m < 280, 1].max() < 0.26
    assert (-far[reach_m > 440, 1]).min() > 10.0


def test_cars_have_usual_sizes_and_wheels_on_the_ground() -> None:
    rng = np.random.default_rng(0)
    cars = [objects.car(rng) for _ in range(30)]
    sizes_m = np.array([np.ptp(car.corners.reshape(-1, 3), axis=0) for car in cars])
    assert (sizes_m.min(axis=0) > [1.6, 1.3, 3.9]).all()
    assert (sizes_m.max(axis=0) < [2.1, 2.1, 5.1]).all()
    np.testing.assert_allclose([car.corners[..., 1].max() for car in cars], 0.0, atol=1e-3)
    assert len(set(sizes_m[:, 2].round(3))) == 3
    assert len({tuple(car.tint[0]) for car in cars}) >= 6


def test_houses_lie_behind_their_front_and_have_a_roof() -> None:
    for seed in range(6):
        house, (width_m, depth_m) = objects.house(np.random.default_rng(seed), garden_m=4.0)
        is_wall = np.isin(house.texture, (Texture.PLASTER_WINDOWS, Texture.BRICK_WINDOWS))
        walls = house.corners[is_wall].reshape(-1, 3)
        low, high = walls.min(axis=0), walls.max(axis=0)
        np.testing.assert_allclose([high[0], low[2], high[2]], [width_m / 2, 0.0, depth_m])
        assert house.corners[..., 1].min() < low[1] - 1.0
        hedge = house.corners[house.texture == Texture.LEAVES]
        assert hedge[..., 2].max(initial=-4.0) < -2.0


def test_trees_have_their_height_and_are_lit_from_above() -> None:
    tree = objects.tree(np.random.default_rng(2), 9.0, 2)
    y = tree.corners[..., 1]
    assert -y.min() == pytest.approx(9.0, rel=0.25)
    assert y.max() <= 0.31  # rooted
    is_leaf = tree.texture == Texture.LEAVES
    height_m = -y[is_leaf].mean(axis=1)
    ambient = tree.ambient[is_leaf].mean(axis=1)
    assert np.corrcoef(height_m, ambient)[0, 1] > 0.5
