"""Ray casting: agreement with a plain search over all triangles, and footprints of pixels."""

import numpy as np
import pytest

from geovp_classic.data.synthetic.mesh import triangles
from geovp_classic.data.synthetic.ray_casting import RayCaster
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.types import FloatArray


def search(corners: FloatArray, origins: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the lengths [rays, triangles] at which rays meet triangles, inf for a miss."""
    a, b, c = (corners[:, i] for i in range(3))
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = np.einsum("rtk,tk->rt", a - origins[:, None], normal) / (directions @ normal.T)
        points = origins[:, None] + lengths[..., None] * directions[:, None]
    edges = [(a, b), (b, c), (c, a)]
    inside = [np.einsum("rtk,tk->rt", np.cross(q - p, points - p), normal) >= 0 for p, q in edges]
    return np.where(np.all(inside, axis=0) & (lengths > 0), lengths, np.inf)


@pytest.mark.parametrize("count", [1, 3, 4, 5, 300])
def test_rays_hit_the_nearest_triangle(count: int) -> None:
    rng = np.random.default_rng(count)
    corners = rng.uniform(-5, 5, (count, 1, 3)) + rng.normal(0, 1, (count, 3, 3))
    origins = rng.uniform(-8, 8, (400, 3))
    directions = rng.normal(0, 1, (400, 3))
    directions[:100, 0] = 0  # parallel to sides of boxes
    directions[100:150, 1:] = 0
    targets = corners.mean(axis=1)[rng.integers(count, size=250)]
    directions[150:] = targets - origins[150:]
    expected = search(corners, origins, directions)
    caster = RayCaster(triangles(corners, Texture.PLAIN))
    lengths, numbers = caster.cast(origins, directions)
    np.testing.assert_allclose(lengths, expected.min(axis=1), rtol=1e-9)
    is_hit = np.isfinite(lengths)
    assert is_hit[150:].all()
    nearest = corners[expected[is_hit].argmin(axis=1)]
    np.testing.assert_array_equal(caster.mesh.corners[numbers[is_hit]], nearest)
    assert (numbers[~is_hit] == -1).all()
    some_length, _ = caster.cast(origins, directions, stops_early=True)
    np.testing.assert_array_equal(np.isfinite(some_length), is_hit)


def test_no_ray_passes_between_two_triangles_with_a_common_edge() -> None:
    square = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float)
    caster = RayCaster(triangles(square[[[0, 1, 2], [0, 2, 3]]], Texture.PLAIN))
    diagonal = np.linspace(0.001, 0.999, 999)
    origins = np.stack([diagonal, diagonal, 0 * diagonal], axis=1)
    lengths, _ = caster.cast(origins, np.array([0.0, 0.0, 2.0]))
    np.testing.assert_allclose(lengths, 0.5)


def test_points_behind_a_triangle_are_in_its_shadow() -> None:
    shade = np.array([[(-9, -9, 7), (9, -9, 7), (0, 9, 7)]], dtype=float)
    caster = RayCaster(triangles(shade, Texture.PLAIN))
    points = np.array([[0.0, 0.0, 6.0], [0.0, 0.0, 8.0]])
    assert caster.is_blocked(points, np.array([0.0, 0.0, 1.0])).tolist() == [True, False]


def test_a_triangle_without_area_is_never_hit() -> None:
    caster = RayCaster(triangles(np.zeros((1, 3, 3)), Texture.PLAIN, uv=np.ones((1, 3, 2))))
    lengths, _ = caster.cast(np.array([[0.0, 0.0, -1.0]]), np.array([0.0, 0.0, 1.0]))
    assert np.isinf(lengths).all()


def test_footprints_are_differences_to_the_rays_of_the_next_pixels() -> None:
    rng = np.random.default_rng(4)
    corners = np.array([0.0, 0.0, 9.0]) + rng.normal(size=(40, 3, 3))
    uv = rng.normal(size=(40, 3, 2))
    mesh = triangles(corners, Texture.PLAIN, uv=uv, ambient=rng.uniform(size=(40, 3)))
    caster = RayCaster(mesh)
    mesh = caster.mesh
    eye = np.array([0.3, -0.2, 0.1])
    rays = mesh.corners.mean(axis=1) - eye
    rays /= rays[:, 2:]
    pixel_steps = np.array([[1e-6, 0, 0], [0, 1e-6, 0]])
    numbers = np.arange(len(rays))
    normal = np.cross(
        mesh.corners[:, 1] - mesh.corners[:, 0], mesh.corners[:, 2] - mesh.corners[:, 0]
    )
    height = np.einsum("nj,nj->n", mesh.corners[:, 0] - eye, normal)

    def hits(directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        lengths = height / np.einsum("nj,nj->n", directions, normal)
        found = caster.hits(eye, directions, lengths, numbers, pixel_steps)
        return found.points, found.uv

    lengths = height / np.einsum("nj,nj->n", rays, normal)
    found = caster.hits(eye, rays, lengths, numbers, pixel_steps)
    np.testing.assert_allclose(found.points, mesh.corners.mean(axis=1))
    np.testing.assert_allclose(found.uv, mesh.uv.mean(axis=1), atol=1e-9)
    np.testing.assert_allclose(found.ambient, mesh.ambient.mean(axis=1))
    assert ((found.normal * rays).sum(axis=-1) < 0).all()
    for k, step in enumerate(pixel_steps):
        points, uv = hits(rays + step)
        moved_m = np.linalg.norm(points - found.points, axis=-1)
        np.testing.assert_allclose(found.sizes_m[:, k], moved_m, rtol=1e-3)
        np.testing.assert_allclose(found.uv_steps[:, k], uv - found.uv, rtol=1e-3, atol=1e-9)
