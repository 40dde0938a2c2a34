"""Trees, bushes and hedges: lumpy crowns covered with loose sprays of leaves."""

from __future__ import annotations

import numpy as np

from geovp_classic.data.synthetic.mesh import Colour, Material, Soup, cylinder, icosphere, joined, soup_of
from geovp_classic.data.synthetic.textures import TILE_M, Texture
from geovp_classic.types import FloatArray

LEAF_GREEN: Colour = (0.62, 0.72, 0.55)
BARK = Material(Texture.BARK, (0.8, 0.78, 0.74))


def tree(rng: np.random.Generator, height_m: float, num_splits: int = 2) -> Soup:
    """A broad-leaved tree that stands on the origin."""
    crown_m = height_m * float(rng.uniform(0.26, 0.34))
    fork_m = height_m - 2.1 * crown_m
    parts = [cylinder((0, 0.3, 0), (0.1, -fork_m - 0.6 * crown_m, 0.05), (0.028 * height_m, 0.016 * height_m), BARK)]
    middle = np.array([0.0, -(fork_m + crown_m), 0.0])
    for _ in range(4):
        direction = rng.normal(size=3) * [1.0, 0.7, 1.0]
        centre = middle + direction / np.linalg.norm(direction) * crown_m * rng.uniform(0.3, 0.55)
        parts.append(_crown(rng, centre, crown_m * rng.uniform(0.55, 0.8), num_splits))
    return joined(parts)


def bush(rng: np.random.Generator, radius_m: float) -> Soup:
    """A bush that stands on the origin."""
    return _crown(rng, np.array([0.0, -0.75 * radius_m, 0.0]), radius_m, 2)


def hedge(rng: np.random.Generator, length_m: float, height_m: float = 1.1, depth_m: float = 0.7) -> Soup:
    """A clipped hedge along x from the origin."""
    columns, rows = max(2, round(length_m / 0.6)), 7
    along = np.linspace(0.0, length_m, columns)
    outline = np.array([(0, 0), (0, 0.5), (0, 0.95), (0.5, 1.0), (1, 0.95), (1, 0.5), (1, 0)])  # depth, height
    rings = np.zeros((columns, rows, 3))
    rings[..., 0] = along[:, None]
    rings[..., 1] = -outline[:, 1] * height_m
    rings[..., 2] = outline[:, 0] * depth_m
    rings[:, 1:-1] += rng.normal(0, 0.05, (columns, rows - 2, 3))
    quads = np.stack([rings[:-1, :-1], rings[:-1, 1:], rings[1:, 1:], rings[1:, :-1]], axis=2).reshape(-1, 4, 3)
    corners = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    shade = np.clip(0.45 + 0.55 * -corners[..., 1] / height_m, 0, 1)
    return soup_of(corners, Material(Texture.LEAVES, (0.5, 0.62, 0.46)), None, shade)


def _crown(rng: np.random.Generator, centre: FloatArray, radius_m: float, num_splits: int) -> Soup:
    """A lump of leaves: a dented ball and sprays that stick out of it."""
    points, faces = icosphere(num_splits)
    waves, phases = rng.normal(0, 3.2, (3, 8)), rng.uniform(0, 2 * np.pi, 8)
    dents = 1 + 0.07 * np.sin(points @ waves + phases).sum(axis=-1) / 2
    ball = points * dents[:, None]
    core = ball[faces] * radius_m
    sprays = _sprays(rng, ball, radius_m, num=30 * num_splits**2)
    corners = np.concatenate([core, sprays])
    lit = np.clip(0.62 - 0.42 * corners[..., 1] / radius_m, 0.3, 1.0)
    lit[len(core) :] += rng.normal(0, 0.10, (len(sprays), 1))
    tint = np.asarray(LEAF_GREEN)
    uv = corners[..., :2] / TILE_M[Texture.LEAVES] + rng.uniform(0, 1, (len(corners), 1, 2))
    uv[: len(core)] = _wrapped(core) / TILE_M[Texture.LEAVES]
    return soup_of(corners + centre, Material(Texture.LEAVES, tuple(tint)), uv, np.clip(lit, 0.2, 1.1))


def _sprays(rng: np.random.Generator, ball: FloatArray, radius_m: float, num: int) -> FloatArray:
    """Triangles [num, 3, 3] that stick out of a ball at random."""
    root = ball[rng.integers(0, len(ball), num)] + rng.normal(0, 0.12, (num, 3))
    outward = root / np.linalg.norm(root, axis=-1, keepdims=True)
    size = rng.uniform(0.35, 0.6, (num, 1)) / radius_m
    side = np.cross(outward, rng.normal(size=(num, 3)))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    tip = root + size * (0.6 * outward + rng.normal(0, 0.35, (num, 3)))
    return np.stack([root - 0.5 * size * side, root + 0.5 * size * side, tip], axis=1) * radius_m


def _wrapped(corners: FloatArray) -> FloatArray:
    """Metres [N, 3, 2] over the two axes that a triangle faces least."""
    middle = np.abs(corners.mean(axis=1))
    columns = np.array([[2, 1], [0, 2], [0, 1]])[middle.argmax(axis=-1)]
    return np.take_along_axis(corners, np.repeat(columns[:, None], 3, axis=1), axis=-1)
