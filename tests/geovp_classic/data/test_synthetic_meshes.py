"""Triangles of the street: areas, normals, and where the ground lies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geovp_classic.data.synthetic import buildings, furniture, plants, vehicles
from geovp_classic.data.synthetic.ground import CORNER_RADIUS_M, KERB_HEIGHT_M, Roads, _split, ground
from geovp_classic.data.synthetic.mesh import (
    Builder,
    Material,
    cylinder,
    disc,
    icosphere,
    joined,
    normals,
    planar_uv,
    soup_of,
)
from geovp_classic.data.synthetic.paths import Terrain, straight
from geovp_classic.data.synthetic.surfaces import Rays, patches, surfaces_of
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.geometry import se3

FLAT = Terrain(np.zeros(1), np.zeros((1, 2)), np.zeros(1))
GREY = Material(Texture.PLAIN)


def area(corners: np.ndarray) -> float:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(a, b) if corners.shape[-1] == 3 else a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return float(0.5 * (np.linalg.norm(cross, axis=-1) if cross.ndim > 1 else np.abs(cross)).sum())


@pytest.mark.parametrize("num_splits", [0, 1, 2])
def test_an_icosphere_is_a_closed_ball(num_splits: int) -> None:
    points, faces = icosphere(num_splits)
    assert len(faces) == 20 * 4**num_splits
    assert len(points) - len(faces) * 3 // 2 + len(faces) == 2  # Euler: corners - edges + faces
    np.testing.assert_allclose(np.linalg.norm(points, axis=-1), 1.0)
    assert area(points[faces]) == pytest.approx(4 * np.pi, rel=0.25 / 2**num_splits)


def test_a_box_has_four_walls_and_a_lid_that_face_outward() -> None:
    builder = Builder()
    builder.box((0, -2, 0), (3, 0, 1), GREY)  # 3 m wide, 2 m high, 1 m deep
    soup = builder.soup()
    assert area(soup.corners) == pytest.approx(2 * (3 * 2 + 1 * 2) + 3 * 1)
    outward = soup.corners.mean(axis=1) - [1.5, -1.0, 0.5]
    side = (normals(soup.corners) * outward).sum(axis=-1)
    assert (np.sign(side) == np.sign(side[0])).all()


def test_round_things_have_round_areas() -> None:
    assert area(cylinder((0, 0, 0), (0, -2, 0), (0.5, 0.5), GREY, 64).corners) == pytest.approx(2 * np.pi, rel=2e-3)
    assert area(disc((1, 2, 3), 0.5, "x", GREY, 64).corners) == pytest.approx(np.pi / 4, rel=2e-3)


def test_moving_a_soup_moves_its_corners_only() -> None:
    soup = soup_of(np.eye(3)[None], GREY)
    moved = soup.moved(se3.compose(np.eye(3), np.array([0.0, 0.0, 7.0])), scale=2.0)
    np.testing.assert_allclose(moved.corners, 2 * np.eye(3)[None] + [0, 0, 7])
    np.testing.assert_array_equal(moved.uv, soup.uv)
    assert len(joined([soup, moved])) == 2


def test_recolouring_changes_one_tint() -> None:
    soup = joined([soup_of(np.eye(3)[None], GREY.tinted(tint)) for tint in ((1.0, 0.0, 1.0), (0.2, 0.2, 0.2))])
    np.testing.assert_allclose(soup.recoloured((1.0, 0.0, 1.0), (0.0, 0.5, 0.0)).tint, [(0, 0.5, 0), (0.2, 0.2, 0.2)])


def test_textures_keep_their_size_on_upright_and_flat_triangles() -> None:
    wall = np.array([[(0, 0, 0), (2, 0, 0), (0, 3, 0)]], dtype=float)
    floor = np.array([[(0, 0, 0), (2, 0, 0), (0, 0, 3)]], dtype=float)
    for corners in (wall, floor):
        assert area(planar_uv(corners)) == pytest.approx(3.0)


def test_surface_functions_meet_their_corners() -> None:
    """u, v and shade, linear over the triangle, take the given values at all three corners."""
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(5, 3, 3))
    soup = soup_of(corners, GREY, rng.normal(size=(5, 3, 2)), rng.uniform(size=(5, 3)))
    table = surfaces_of(soup)
    for k in range(3):
        offset = soup.corners[:, k] - table.corner
        values = table.at_corner + np.einsum("nkj,nj->nk", table.gradient, offset)
        np.testing.assert_allclose(values[:, :2], soup.uv[:, k], atol=1e-4)
        np.testing.assert_allclose(values[:, 4], soup.shade[:, k], atol=1e-4)


def test_patches_equal_their_slow_twin() -> None:
    """Place, uv and what changes to the next pixel, against rays through the next pixels cut with the same plane."""
    rng = np.random.default_rng(4)
    corners = np.array([0.0, 0.0, 9.0]) + rng.normal(size=(40, 3, 3))
    soup = soup_of(corners, GREY, rng.normal(size=(40, 3, 2)), rng.uniform(size=(40, 3)))
    table, eye = surfaces_of(soup), np.array([0.3, -0.2, 0.1])
    towards = corners.mean(axis=1) - eye
    directions = towards / towards[:, 2:]
    pixel_steps = np.array([[1e-4, 0, 0], [0, 1e-4, 0]])
    rays = Rays(eye, directions.astype(np.float32), towards[:, 2].astype(np.float32), np.arange(40), pixel_steps)
    seen = patches(table, rays)
    np.testing.assert_allclose(seen.points, corners.mean(axis=1), atol=1e-5)
    np.testing.assert_allclose(seen.uv, soup.uv.mean(axis=1), atol=1e-4)
    np.testing.assert_allclose(seen.around, soup.shade.mean(axis=1), atol=1e-4)
    assert ((seen.normal * directions).sum(axis=-1) < 0).all()
    gradient = table.gradient[:, :2].astype(np.float64)
    facing = normals(corners)
    for k, step in enumerate(pixel_steps):
        beside = directions + step
        depth = (facing * (corners[:, 0] - eye)).sum(axis=-1) / (facing * beside).sum(axis=-1)
        moved = eye + depth[:, None] * beside - corners.mean(axis=1)
        flat = np.abs((facing * directions).sum(axis=-1)) > 0.2  # a finite step is no derivative at grazing angles
        np.testing.assert_allclose(seen.sizes_m[flat, k], np.linalg.norm(moved[flat], axis=-1), rtol=5e-3)
        expected = np.einsum("nkj,nj->nk", gradient, moved)
        np.testing.assert_allclose(seen.uv_steps[flat, k], expected[flat], rtol=1e-2, atol=1e-4)


def test_a_triangle_without_area_has_constant_values() -> None:
    table = surfaces_of(soup_of(np.zeros((1, 3, 3)), GREY, np.ones((1, 3, 2))))
    np.testing.assert_array_equal(table.gradient, 0.0)
    assert np.isfinite(table.normal).all()


@given(seed=st.integers(0, 10_000), level_m=st.floats(-0.9, 0.9))
def test_cutting_triangles_loses_no_ground(seed: int, level_m: float) -> None:
    triangles = np.random.default_rng(seed).uniform(-1, 1, (6, 3, 3))
    below, above, cuts = _split(triangles, level_m)
    assert area(below[..., :2]) + area(above[..., :2]) == pytest.approx(area(triangles[..., :2]))
    assert (below[..., 2] <= level_m + 1e-9).all()
    assert (above[..., 2] >= level_m - 1e-9).all()
    np.testing.assert_allclose(cuts[..., 2], level_m, atol=1e-9)


def test_the_kerb_of_a_straight_road_is_half_a_width_away() -> None:
    roads = Roads([straight((0.0, 0.0), 0.0, 100.0)], half_width_m=4.0)
    np.testing.assert_allclose(roads.distance_m(np.array([[0.0, 50.0], [4.0, 50.0], [-7.0, 50.0]])), [-4.0, 0.0, 3.0])


def test_corners_of_a_junction_are_rounded() -> None:
    """The kerb's arc touches the middle between its centre at (10, 10) and the corner at (4, 4)."""
    roads = Roads([straight((0.0, -50.0), 0.0, 100.0), straight((-50.0, 0.0), np.pi / 2, 100.0)], half_width_m=4.0)
    on_arc = 4.0 + CORNER_RADIUS_M * (1 - 0.5**0.5)
    places = np.array([[on_arc, on_arc], [4.0, 4.0], [4.0, 30.0]])
    np.testing.assert_allclose(roads.distance_m(places), [0.0, -CORNER_RADIUS_M * (2**0.5 - 1), 0.0], atol=1e-6)
    along_m, right_m, street, painted = roads.lane(np.array([[1.0, 30.0], [1.0, 5.0]]))
    np.testing.assert_allclose(along_m, [80.0, 55.0])
    np.testing.assert_allclose(right_m, 1.0)
    assert street.tolist() == [0, 0]
    assert painted.tolist() == [True, False]  # no paint on the junction


def test_pavements_lie_a_kerb_above_the_road() -> None:
    roads = Roads([straight((0.0, -40.0), 0.0, 120.0)])
    soup = ground(roads, FLAT, np.array([[0.0, 0.0], [0.0, 40.0]]), reach_m=10.0)
    for texture, height_m in ((Texture.ASPHALT, 0.0), (Texture.PAVEMENT, KERB_HEIGHT_M)):
        corners = soup.corners[soup.texture == texture]
        np.testing.assert_allclose(corners[..., 1], -height_m, atol=1e-6)
    road = soup.corners[soup.texture == Texture.ASPHALT]
    assert np.abs(road[..., 0]).max() == pytest.approx(roads.half_width_m, abs=1e-3)
    assert area(road) == pytest.approx(2 * roads.half_width_m * 60.0, rel=0.05)
    assert (soup.paint[soup.texture == Texture.ASPHALT] == Texture.ROAD_PAINT).all()


def test_zebra_crossings_lie_before_all_four_arms_of_a_junction() -> None:
    roads = Roads([straight((0.0, -80.0), 0.0, 160.0), straight((-80.0, 0.0), np.pi / 2, 160.0)], half_width_m=4.0)
    assert roads.zebras() == [(0, 90.5), (0, 66.5), (1, 90.5), (1, 66.5)]  # 10.5 m from the middle, 3 m long
    soup = ground(roads, FLAT, np.zeros((1, 2)), reach_m=20.0)
    zebra = soup.paint == Texture.ZEBRA
    middle = np.abs(soup.corners[zebra].mean(axis=1))
    assert 9.0 < middle[:, [0, 2]].max(axis=-1).min() < middle[:, [0, 2]].max(axis=-1).max() < 15.0
    assert 4 * 3.0 * 8.0 < area(soup.corners[zebra]) < 4 * 5.5 * 8.0


@pytest.mark.parametrize("kind", list(vehicles.BODIES))
def test_cars_have_the_size_of_cars_and_wheels_on_the_ground(kind: str) -> None:
    corners = vehicles.car(kind, (0.3, 0.3, 0.3)).corners.reshape(-1, 3)
    size_m = np.ptp(corners, axis=0)
    assert 1.6 < size_m[0] < 2.1
    assert 1.3 < size_m[1] < 2.1
    assert 3.9 < size_m[2] < 5.1
    assert corners[:, 1].max() == pytest.approx(0.0, abs=1e-3)  # y points down


def test_a_car_takes_the_paint_that_it_is_given() -> None:
    tints = vehicles.car("saloon", (0.1, 0.2, 0.3)).tint
    assert (np.abs(tints - [0.1, 0.2, 0.3]).max(axis=-1) < 1e-6).mean() > 0.3
    assert not (np.abs(tints - vehicles.PAINT).max(axis=-1) < 1e-6).any()


def test_houses_have_the_size_of_their_plan() -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        house_plan = buildings.draw_plan(rng)
        corners = buildings.house(house_plan, rng).corners.reshape(-1, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        assert house_plan.width_m <= high[0] - low[0] < house_plan.width_m + 1.2
        assert -low[1] > house_plan.storeys * buildings.STOREY_M + 1.0  # the roof
        assert high[2] >= house_plan.depth_m


def test_trees_are_as_tall_as_asked_and_lit_from_above() -> None:
    rng = np.random.default_rng(2)
    for tree in (plants.broadleaf(rng, 9.0, 2), plants.conifer(rng, 9.0)):
        assert -tree.corners[..., 1].min() == pytest.approx(9.0, rel=0.25)
        assert tree.corners[..., 1].max() <= 0.31  # rooted
        assert 0 <= tree.shade.min() <= tree.shade.max() < 1.2
    hedge = plants.hedge(rng, 5.0, 1.2)
    assert np.ptp(hedge.corners[..., 0]) == pytest.approx(5.0, abs=0.4)


def test_the_skyline_is_far_away_all_around() -> None:
    soup = furniture.skyline(np.random.default_rng(0), np.array([10.0, -5.0]), FLAT)
    reach_m = np.hypot(soup.corners[..., 0] - 10.0, soup.corners[..., 2] + 5.0)
    assert 295.0 < reach_m.min() < reach_m.max() < 455.0
