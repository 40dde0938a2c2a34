"""Rays hit the nearest triangle, as a plain search over all triangles finds it."""

import numpy as np
import pytest

from geovp_classic.data.synthetic.ray_casting import TriangleTree
from geovp_classic.types import FloatArray


def searched(corners: FloatArray, origins: FloatArray, directions: FloatArray) -> FloatArray:
    """[rays, triangles], how far each ray goes to each triangle's plane, inf where it passes beside
    the triangle.
    """
    a, b, c = (corners[:, i] for i in range(3))
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = np.einsum("rtk,tk->rt", a - origins[:, None], normal) / (directions @ normal.T)
        points = origins[:, None] + lengths[..., None] * directions[:, None]
    edges = [(a, b), (b, c), (c, a)]
    inside = [np.einsum("rtk,tk->rt", np.cross(q - p, points - p), normal) >= 0 for p, q in edges]
    return np.where(np.all(inside, axis=0) & (lengths > 0), lengths, np.inf)


@pytest.mark.parametrize("count", [1, 3, 4, 5, 300])
def test_the_tree_finds_what_a_search_finds(count: int) -> None:
    random = np.random.default_rng(count)
    corners = (random.uniform(-5, 5, (count, 1, 3)) + random.normal(0, 1, (count, 3, 3))).astype(
        np.float32
    )
    origins = random.uniform(-8, 8, (400, 3)).astype(np.float32)
    directions = random.normal(0, 1, (400, 3)).astype(np.float32)
    directions[:100, 0] = 0  # along the sides of boxes
    directions[100:150, 1:] = 0
    directions[150:] = (
        corners.mean(axis=1)[random.integers(count, size=250)] - origins[150:]
    )  # these hit something
    expected = searched(corners.astype(float), origins.astype(float), directions.astype(float))
    tree = TriangleTree.of(corners)
    lengths, triangles = tree.cast(origins, directions)
    np.testing.assert_allclose(lengths, expected.min(axis=1), rtol=1e-4)
    hit = np.isfinite(lengths)
    assert hit[150:].all()
    np.testing.assert_array_equal(triangles[hit], expected[hit].argmin(axis=1))
    assert (triangles[~hit] == -1).all()
    np.testing.assert_array_equal(tree.blocks(origins, directions), hit)


def test_no_ray_slips_between_two_triangles_of_a_square() -> None:
    square = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], np.float32)
    ahead = np.stack([np.linspace(0.001, 0.999, 999)] * 2 + [np.zeros(999)], axis=1).astype(
        np.float32
    )
    tree = TriangleTree.of(square[[[0, 1, 2], [0, 2, 3]]])
    lengths, _ = tree.cast(
        ahead, np.tile(np.float32([0, 0, 2]), (999, 1))
    )  # along the diagonal; 1 is half of 2
    np.testing.assert_allclose(lengths, 0.5)
