"""Trees, bushes and hedges: lumpy crowns with sprays of leaves that stick out."""

from __future__ import annotations

import numpy as np

from geovp_classic.data.synthetic.mesh import Colour, Material, Soup, cylinder, icosphere, joined, loft, soup_of
from geovp_classic.data.synthetic.textures import TILE_M, Texture
from geovp_classic.types import FloatArray

BARK = Material(Texture.BARK, (0.8, 0.78, 0.74))
GREENS: tuple[Colour, ...] = ((0.62, 0.72, 0.52), (0.70, 0.74, 0.48), (0.52, 0.66, 0.52), (0.60, 0.66, 0.42))
NEEDLES: Colour = (0.40, 0.54, 0.46)
HEDGE: Colour = (0.50, 0.62, 0.46)
SPRAYS = 40  # on every lump of a crown, times the square of its detail


def broadleaf(rng: np.random.Generator, height_m: float, detail: int) -> Soup:
    """A tree on the origin: a forked trunk, and a crown of lumps that is rounder or taller from tree to tree."""
    green = GREENS[rng.integers(len(GREENS))]
    crown_m = height_m * float(rng.uniform(0.25, 0.33))
    tall = float(rng.uniform(0.8, 1.5))
    middle_m = max(height_m - crown_m * (0.9 + 0.4 * tall), 2.2 + 0.6 * crown_m)
    parts = [cylinder((0, 0.3, 0), (0.1, -middle_m, 0.05), (0.026 * height_m, 0.013 * height_m), BARK)]
    for turn in range(6):
        angle_rad = 2.4 * turn + rng.uniform(-0.4, 0.4)
        out_m = crown_m * rng.uniform(0.45, 0.75) * (turn > 0)
        up_m = crown_m * tall * (rng.uniform(-0.35, 0.5) if turn else 0.45)
        centre = np.array([out_m * np.sin(angle_rad), -middle_m - up_m, out_m * np.cos(angle_rad)])
        parts.append(_lump(rng, centre, crown_m * rng.uniform(0.45, 0.68), detail, green))
        if turn:
            parts.append(cylinder((0.1, -0.7 * middle_m, 0.05), tuple(centre), (0.09, 0.03), BARK, 5))
    return joined(parts)


def conifer(rng: np.random.Generator, height_m: float) -> Soup:
    """A fir on the origin: ragged skirts of needles around a trunk."""
    parts = [cylinder((0, 0.3, 0), (0, -0.5 * height_m, 0), (0.16, 0.10), BARK)]
    num_skirts, num_points = 8, 14
    for skirt in range(num_skirts):
        low_m, high_m = height_m * (0.1 + 0.85 * np.array([skirt, skirt + 1.9]) / num_skirts)
        angle_rad = np.arange(num_points) * 2 * np.pi / num_points + rng.uniform(0, 6.3)
        ring = np.stack([np.sin(angle_rad), np.zeros(num_points), np.cos(angle_rad)], axis=-1)
        reach_m = height_m * 0.24 * (1 - skirt / num_skirts) + 0.25
        ragged = rng.uniform(0.7, 1.15, (num_points, 1))
        low, high = ring * reach_m * ragged, ring * reach_m * 0.2
        low[:, 1], high[:, 1] = -low_m + 0.3 * (ragged[:, 0] - 0.9), -min(high_m, height_m)
        shade = np.array([1.0, 0.5])
        parts.append(loft(np.stack([high, low]), Material(Texture.LEAVES, NEEDLES), shade[::-1].copy()))
    return joined(parts)


def bush(rng: np.random.Generator, radius_m: float) -> Soup:
    """A bush on the origin."""
    green = GREENS[rng.integers(len(GREENS))]
    return _lump(rng, np.array([0.0, -0.75 * radius_m, 0.0]), radius_m, 1, green)


def hedge(rng: np.random.Generator, length_m: float, height_m: float, depth_m: float = 0.7) -> Soup:
    """A clipped hedge along x from the origin."""
    columns = max(2, round(length_m / 0.6))
    outline = np.array([(0, 0), (0, 0.5), (0, 0.95), (0.5, 1.0), (1, 0.95), (1, 0.5), (1, 0)])  # depth, height
    rings = np.zeros((columns, len(outline), 3))
    rings[..., 0] = np.linspace(0.0, length_m, columns)[:, None]
    rings[..., 1] = -outline[:, 1] * height_m
    rings[..., 2] = outline[:, 0] * depth_m
    rings[:, 1:-1] += rng.normal(0, 0.05, (columns, len(outline) - 2, 3))
    quads = np.stack([rings[:-1, :-1], rings[:-1, 1:], rings[1:, 1:], rings[1:, :-1]], axis=2).reshape(-1, 4, 3)
    ends = rings[[0, 0, -1, -1]][[0, 2]][:, [[1, 2, 4, 5], [0, 1, 5, 6]]].reshape(-1, 4, 3)
    corners = np.concatenate([quads, ends])[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    shade = np.clip(0.45 + 0.55 * -corners[..., 1] / height_m, 0, 1)
    return soup_of(corners, Material(Texture.LEAVES, HEDGE), None, shade)


def _lump(rng: np.random.Generator, centre: FloatArray, radius_m: float, detail: int, green: Colour) -> Soup:
    """A lump of leaves: a dented ball and the sprays on it, darker below and inside."""
    points, faces = icosphere(detail)
    waves, phases = rng.normal(0, 3.0, (3, 8)), rng.uniform(0, 2 * np.pi, 8)
    ball = points * (1 + 0.045 * np.sin(points @ waves + phases).sum(axis=-1))[:, None]
    core = ball[faces] * radius_m
    sprays = _sprays(rng, ball, radius_m, SPRAYS * detail**2)
    corners = np.concatenate([core, sprays])
    lit = 0.62 - 0.40 * corners[..., 1] / radius_m
    lit[len(core) :] += 0.12 + rng.normal(0, 0.12, (len(sprays), 1))
    uv = _seen_along(corners) / TILE_M[Texture.LEAVES]
    uv[len(core) :] += rng.uniform(0, 1, (len(sprays), 1, 2))
    return soup_of(corners + centre, Material(Texture.LEAVES, green), uv, np.clip(lit, 0.22, 1.15))


def _sprays(rng: np.random.Generator, ball: FloatArray, radius_m: float, num: int) -> FloatArray:
    """Triangles [num, 3, 3] rooted inside a ball and sticking out of it by up to 0.3 m."""
    outward = rng.normal(size=(num, 3))
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    surface_m = radius_m * np.linalg.norm(ball[(outward @ ball.T).argmax(axis=-1)], axis=-1, keepdims=True)
    side = np.cross(outward, rng.normal(size=(num, 3)))
    side *= rng.uniform(0.10, 0.2, (num, 1)) / np.linalg.norm(side, axis=-1, keepdims=True)
    along = np.cross(outward, side) * rng.uniform(-1.5, 1.5, (num, 1))
    root = outward * surface_m * 0.9
    tip = outward * (surface_m + rng.uniform(0.05, 0.3, (num, 1))) + along
    return np.stack([root - side, root + side, tip], axis=1)


def _seen_along(corners: FloatArray) -> FloatArray:
    """Metres [N, 3, 2] across the axis along which a triangle lies from the origin."""
    columns = np.array([[2, 1], [0, 2], [0, 1]])[np.abs(corners.mean(axis=1)).argmax(axis=-1)]
    return np.take_along_axis(corners, np.repeat(columns[:, None], 3, axis=1), axis=-1)
