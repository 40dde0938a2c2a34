"""Triangles of the street: areas, footprints of pixels, and where the ground lies."""

import numpy as np
import pytest

from geovp_classic.data.synthetic import objects
from geovp_classic.data.synthetic.images import TILE_M, Texture
from geovp_classic.data.synthetic.mesh import Surfaces, box, joined, lathe, sheet, triangles
from geovp_classic.data.synthetic.roads import (
    CORNER_RADIUS_M,
    HALF_WIDTH_M,
    JUNCTION_M,
    KERB_HEIGHT_M,
    ZEBRA_M,
    Roads,
    Terrain,
    ground,
    straight,
)
from geovp_classic.geometry import se3

FLAT = Terrain(np.zeros(1), np.zeros((1, 2)), np.zeros(1))
CROSSING = Roads(
    [straight((0.0, -80.0), 0.0, 160.0), straight((-80.0, 0.0), np.pi / 2, 160.0)], (80.0, 80.0)
)


def normals(corners: np.ndarray) -> np.ndarray:
    """Unit normals [N, 3]."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return cross / np.linalg.norm(cross, axis=-1, keepdims=True)


def area(corners: np.ndarray) -> float:
    """The area of triangles [N, 3, 2 or 3]."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = (
        np.cross(a, b)
        if corners.shape[-1] == 3
        else (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])[:, None]
    )
    return float(0.5 * np.linalg.norm(cross, axis=-1).sum())


def test_a_box_has_four_walls_and_a_lid_that_face_outward() -> None:
    corners = box((0, -2, 0), (3, 0, 1), Texture.PLAIN).corners  # 3 m wide, 2 m high, 1 m deep
    assert area(corners) == pytest.approx(2 * (3 * 2 + 1 * 2) + 3 * 1)
    corners = corners[
        np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1
        )
        > 0
    ]
    side = (normals(corners) * (corners.mean(axis=1) - [1.5, -1.0, 0.5])).sum(axis=-1)
    assert (np.sign(side) == np.sign(side[0])).all()


def test_round_things_have_round_areas() -> None:
    """A tube of radius 0.5 m and length 2 m, a disc of radius 0.5 m and a ball of radius 1 m."""
    tube = sheet(lathe((0, 0, 0), (0, -2, 0), [(0, 0.5), (1, 0.5)], 64), Texture.PLAIN)
    disc = sheet(lathe((1, 2, 3), (2, 2, 3), [(0, 0.5), (0, 0.0)], 64), Texture.PLAIN)
    angle_rad = np.linspace(0, np.pi, 65)
    profile = np.stack([0.5 - 0.5 * np.cos(angle_rad), np.sin(angle_rad)], axis=-1)
    ball = sheet(lathe((0, 1, 0), (0, -1, 0), profile, 64), Texture.PLAIN)
    for mesh, expected in ((tube, 2 * np.pi), (disc, np.pi / 4), (ball, 4 * np.pi)):
        assert area(mesh.corners) == pytest.approx(expected, rel=3e-3)


def test_moving_a_mesh_moves_its_corners_only() -> None:
    mesh = triangles(np.eye(3)[None], Texture.PLAIN)
    moved = mesh.moved(se3.compose(np.eye(3), np.array([0.0, 0.0, 7.0])), scale=2.0)
    np.testing.assert_allclose(moved.corners, 2 * np.eye(3)[None] + [0, 0, 7])
    np.testing.assert_array_equal(moved.uv, mesh.uv)
    assert len(joined([mesh, moved]).corners) == 2


def test_textures_keep_their_size_on_upright_and_flat_triangles() -> None:
    wall = np.array([[(0, 0, 0), (2, 0, 0), (0, 3, 0)]], dtype=float)
    floor = np.array([[(0, 0, 0), (2, 0, 0), (0, 0, 3)]], dtype=float)
    for corners in (wall, floor):
        uv = triangles(corners, Texture.BRICK).uv
        assert area(uv) * TILE_M[Texture.BRICK] ** 2 == pytest.approx(3.0, rel=1e-5)


def test_hits_equal_their_slow_twin() -> None:
    """Place, uv and what changes to the next pixel, against rays through the next pixels cut with
    the same plane.
    """
    rng = np.random.default_rng(4)
    corners = np.array([0.0, 0.0, 9.0]) + rng.normal(size=(40, 3, 3))
    mesh = triangles(
        corners, Texture.PLAIN, uv=rng.normal(size=(40, 3, 2)), ambient=rng.uniform(size=(40, 3))
    )
    eye = np.array([0.3, -0.2, 0.1])
    towards = corners.mean(axis=1) - eye
    rays, depths = (towards / towards[:, 2:]).astype(np.float32), towards[:, 2].astype(np.float32)
    pixel_steps = np.array([[1e-4, 0, 0], [0, 1e-4, 0]])
    hits = Surfaces(mesh).hits(eye, rays, depths, np.arange(40), pixel_steps)
    np.testing.assert_allclose(hits.points, corners.mean(axis=1), atol=1e-5)
    np.testing.assert_allclose(hits.uv, mesh.uv.mean(axis=1), atol=1e-4)
    np.testing.assert_allclose(hits.ambient, mesh.ambient.mean(axis=1), atol=1e-4)
    assert ((hits.normal * rays).sum(axis=-1) < 0).all()
    facing = normals(corners)
    flat = (
        np.abs((facing * rays).sum(axis=-1)) > 0.2
    )  # a finite step is no derivative at grazing angles
    for k, step in enumerate(pixel_steps):
        depth = (facing * (corners[:, 0] - eye)).sum(axis=-1) / (facing * (rays + step)).sum(
            axis=-1
        )
        moved = eye + depth[:, None] * (rays + step) - corners.mean(axis=1)
        np.testing.assert_allclose(
            hits.sizes_m[flat, k], np.linalg.norm(moved[flat], axis=-1), rtol=1e-2
        )
        for i in np.nonzero(flat)[0]:
            edges = np.stack(
                [corners[i, 1] - corners[i, 0], corners[i, 2] - corners[i, 0]], axis=1
            )  # [3, 2]
            share = np.linalg.lstsq(edges, moved[i], rcond=None)[0]
            expected = share @ (mesh.uv[i, 1:] - mesh.uv[i, :1])
            np.testing.assert_allclose(hits.uv_steps[i, k], expected, rtol=2e-2, atol=2e-4)


def test_a_triangle_without_area_has_constant_values() -> None:
    table = Surfaces(triangles(np.zeros((1, 3, 3)), Texture.PLAIN, uv=np.ones((1, 3, 2)))).table
    np.testing.assert_array_equal(table[0, 3:], 0.0)
    assert np.isfinite(table).all()


def test_rays_find_the_nearest_triangle_and_the_sun() -> None:
    near, far = (
        triangles(np.array([[(-9, -9, z), (9, -9, z), (0, 9, z)]], dtype=float), Texture.PLAIN)
        for z in (5, 7)
    )
    surfaces = Surfaces(joined([far, near]))
    depths, which = surfaces.cast(
        np.zeros(3), np.array([[0.0, 0.0, 1.0], [0.0, 9.0, 1.0]], dtype=np.float32)
    )
    np.testing.assert_allclose(depths, [5.0, np.inf])
    assert which[0] == 1
    between = np.array([[0.0, 0.0, 6.0], [0.0, 0.0, 8.0]], dtype=np.float32)
    assert surfaces.blocks(between, np.array([0.0, 0.0, 1.0])).tolist() == [True, False]


def test_the_kerb_of_a_straight_road_is_half_a_width_away() -> None:
    roads = Roads([straight((0.0, 0.0), 0.0, 100.0)])
    places = np.array([[0.0, 50.0], [HALF_WIDTH_M, 50.0], [-HALF_WIDTH_M - 3.0, 50.0]])
    np.testing.assert_allclose(roads.distance_m(places), [-HALF_WIDTH_M, 0.0, 3.0], atol=1e-9)


def test_corners_of_a_junction_are_rounded() -> None:
    """The kerb's arc touches the middle between its centre and the corner where the straight kerbs
    would meet.
    """
    on_arc = HALF_WIDTH_M + CORNER_RADIUS_M * (1 - 0.5**0.5)
    places = np.array([[on_arc, on_arc], [HALF_WIDTH_M, HALF_WIDTH_M], [HALF_WIDTH_M, 30.0]])
    expected = [0.0, -CORNER_RADIUS_M * (2**0.5 - 1), 0.0]
    np.testing.assert_allclose(CROSSING.distance_m(places), expected, atol=1e-6)


@pytest.mark.parametrize("roads", [CROSSING, Roads([straight((0.0, -80.0), 0.0, 160.0)])])
def test_kerbs_lie_where_the_distance_is_zero_and_point_away_from_the_road(roads: Roads) -> None:
    for line, away in roads.kerbs():
        inside = np.abs(line).max(axis=-1) < 75
        assert inside.sum() > 50
        np.testing.assert_allclose(roads.distance_m(line[inside]), 0.0, atol=0.01)
        np.testing.assert_allclose(roads.distance_m((line + away)[inside]), 1.0, atol=0.01)


def test_pavements_lie_a_kerb_above_the_road() -> None:
    mesh = ground(
        Roads([straight((0.0, -40.0), 0.0, 120.0)]), FLAT, np.zeros(2), np.random.default_rng(0)
    )
    for texture, height_m in ((Texture.ROAD, 0.0), (Texture.PAVEMENT, KERB_HEIGHT_M)):
        np.testing.assert_allclose(
            mesh.corners[mesh.texture == texture][..., 1], -height_m, atol=1e-6
        )
    road = mesh.corners[mesh.texture == Texture.ROAD]
    assert np.abs(road[..., 0]).max() == pytest.approx(HALF_WIDTH_M, abs=0.03)
    assert area(road) == pytest.approx(2 * HALF_WIDTH_M * 120.0, rel=0.01)


def test_zebra_crossings_lie_before_all_four_arms_of_a_junction() -> None:
    mesh = ground(CROSSING, FLAT, np.zeros(2), np.random.default_rng(0))
    zebra = mesh.corners[mesh.texture == Texture.ZEBRA]
    assert area(zebra) == pytest.approx(4 * ZEBRA_M * 2 * HALF_WIDTH_M, rel=0.02)
    reach_m = np.abs(zebra[..., [0, 2]]).max(axis=-1)
    assert reach_m.min() == pytest.approx(JUNCTION_M, abs=1e-3)
    assert reach_m.max() == pytest.approx(JUNCTION_M + ZEBRA_M, abs=1e-3)


def test_hills_stand_300_m_away_all_around() -> None:
    """The grass before them is at most 0.25 m below the datum."""
    mesh = ground(CROSSING, FLAT, np.array([10.0, -5.0]), np.random.default_rng(0))
    far = mesh.corners[mesh.texture == Texture.GRASS].reshape(-1, 3)
    reach_m = np.hypot(far[:, 0] - 10.0, far[:, 2] + 5.0)
    assert reach_m.max() == pytest.approx(450.0, abs=0.1)
    assert far[reach_m < 280, 1].max() < 0.26
    assert (-far[reach_m > 440, 1]).min() > 10.0


def test_cars_have_the_size_of_cars_and_wheels_on_the_ground() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        corners = objects.car(rng).corners.reshape(-1, 3)
        size_m = np.ptp(corners, axis=0)
        assert 1.6 < size_m[0] < 2.1
        assert 1.3 < size_m[1] < 2.1
        assert 3.9 < size_m[2] < 5.1
        assert corners[:, 1].max() == pytest.approx(0.0, abs=1e-3)  # y points down


def test_houses_stand_behind_their_front_and_have_a_roof() -> None:
    for seed in range(6):
        house, (width_m, depth_m) = objects.house(np.random.default_rng(seed), garden_m=4.0)
        walls = house.corners[
            np.isin(house.texture, (Texture.PLASTER_WINDOWS, Texture.BRICK_WINDOWS))
        ].reshape(-1, 3)
        np.testing.assert_allclose(walls[:, 0].max(), width_m / 2, atol=1e-3)
        np.testing.assert_allclose(
            [walls[:, 2].min(), walls[:, 2].max()], [0.0, depth_m], atol=1e-3
        )
        top_m = -house.corners[..., 1].min()
        assert top_m > -walls[:, 1].min() + 1.0
        assert (
            house.corners[house.texture == Texture.LEAVES][..., 2].max(initial=-4.0) < -2.0
        )  # the hedge


def test_trees_are_as_tall_as_asked_and_lit_from_above() -> None:
    tree = objects.tree(np.random.default_rng(2), 9.0, 2)
    assert -tree.corners[..., 1].min() == pytest.approx(9.0, rel=0.25)
    assert tree.corners[..., 1].max() <= 0.31  # rooted
    crown = tree.texture == Texture.LEAVES
    assert 0 <= tree.ambient.min() <= tree.ambient.max() < 1.2
    height_m = -tree.corners[crown][..., 1].mean(axis=1)
    upper = height_m > np.median(height_m)
    assert tree.ambient[crown][upper].mean() > tree.ambient[crown][~upper].mean()


def test_lamps_reach_over_the_road() -> None:
    corners = objects.lamp().corners
    assert -corners[..., 1].min() == pytest.approx(6.0, abs=0.1)
    assert corners[..., 2].min() == pytest.approx(-1.9)
