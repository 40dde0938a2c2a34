"""Cars and vans: a lofted body, glass, wheels and lights; the origin is on the ground below the middle, z ahead."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geovp_classic.data.synthetic.mesh import (
    Builder,
    Colour,
    Material,
    Point,
    Soup,
    cylinder,
    disc,
    joined,
    loft,
    soup_of,
)
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.types import FloatArray

PAINT: Colour = (1.0, 0.0, 1.0)  # stands for the paint until `car` replaces it
PAINTS: tuple[Colour, ...] = (
    (0.80, 0.81, 0.83),
    (0.86, 0.86, 0.85),
    (0.10, 0.10, 0.12),
    (0.30, 0.31, 0.34),
    (0.55, 0.08, 0.09),
    (0.10, 0.18, 0.42),
    (0.16, 0.30, 0.24),
    (0.62, 0.60, 0.54),
    (0.74, 0.30, 0.10),
)
GLASS = Material(Texture.CAR_GLASS, gloss=0.5)
TYRE = Material(Texture.PLAIN, (0.09, 0.09, 0.09))
UNDER = Material(Texture.PLAIN, (0.07, 0.07, 0.075))

# Every kind by stations from tail to nose: (z, half width, height of the shoulder), and the cabin's feet and roof in z.
BODIES: dict[str, tuple[tuple[tuple[float, float, float], ...], tuple[float, float, float, float], float]] = {
    "hatchback": (
        (
            (-2.0, 0.74, 0.78),
            (-1.93, 0.83, 0.90),
            (-1.2, 0.87, 0.92),
            (0.9, 0.87, 0.90),
            (1.7, 0.84, 0.78),
            (1.98, 0.72, 0.62),
        ),
        (-1.95, -1.55, 0.15, 1.0),
        1.48,
    ),
    "saloon": (
        (
            (-2.3, 0.74, 0.80),
            (-2.22, 0.84, 0.92),
            (-1.3, 0.89, 0.94),
            (0.9, 0.89, 0.91),
            (1.95, 0.85, 0.76),
            (2.28, 0.72, 0.60),
        ),
        (-1.75, -1.0, 0.1, 1.0),
        1.43,
    ),
    "van": (
        (
            (-2.45, 0.86, 1.0),
            (-2.4, 0.93, 1.08),
            (-1.3, 0.95, 1.08),
            (1.0, 0.95, 1.08),
            (2.0, 0.92, 1.0),
            (2.42, 0.80, 0.72),
        ),
        (-2.42, -2.35, 1.0, 1.75),
        1.98,
    ),
}


def car(kind: str, paint: Colour) -> Soup:
    """A car of a kind ("hatchback", "saloon", "van") in a colour."""
    return _model(kind).recoloured(PAINT, paint)


@functools.lru_cache(maxsize=8)
def _model(kind: str) -> Soup:
    stations, cabin, roof_m = BODIES[kind]
    return joined(
        [_body(np.array(stations)), _cabin(np.array(stations), cabin, roof_m), _wheels(stations), _trim(stations)]
    )


def _body(stations: FloatArray) -> Soup:
    """The lower body: rings of the shape of a flattened barrel, closed at tail and nose."""
    section = np.array([(0.0, 0.0), (0.86, 0.0), (0.98, 0.2), (1.0, 0.55), (0.96, 0.86), (0.82, 1.0), (0.0, 1.06)])
    outline = np.concatenate([section, section[-2::-1] * [-1, 1]])  # round once, from below
    z, half_m, shoulder_m = stations.T
    floor_m = 0.24
    rings = np.zeros((len(stations), len(outline), 3))
    rings[..., 0] = half_m[:, None] * outline[:, 0]
    rings[..., 1] = -(floor_m + (shoulder_m[:, None] - floor_m) * outline[:, 1])
    rings[..., 2] = z[:, None]
    paint = Material(Texture.PLAIN, PAINT, gloss=0.12)
    skin = loft(rings, paint, closed=False)
    height_m = -skin.corners[..., 1]
    length_m = z[-1] - z[0]
    along = (skin.corners[..., 2] - z[0]) / length_m
    across = 1 - (height_m - floor_m) / (shoulder_m.max() - floor_m)
    on_side = np.abs(skin.corners[..., 0]).min(axis=-1) > 0.68 * half_m.max()
    skin = replace(
        skin,
        shade=np.clip(0.5 + 0.65 * height_m, 0.4, 1.0),
        paint_uv=np.stack([along, np.clip(across, 0.01, 0.99)], axis=-1),
        paint=np.where(on_side, int(Texture.CAR_SIDE), skin.paint),
    )
    ends = [_cap(rings[0], paint), _cap(rings[-1], paint)]
    return joined([skin, *ends])


def _cap(ring: FloatArray, material: Material) -> Soup:
    """The lid over a ring of points [K, 3]."""
    middle = np.broadcast_to(ring.mean(axis=0), ring.shape)
    corners = np.stack([middle, ring, np.roll(ring, -1, axis=0)], axis=1)
    return soup_of(corners, material, None, np.clip(0.5 - 0.65 * corners[..., 1], 0.4, 1.0))


def _cabin(stations: FloatArray, feet: tuple[float, float, float, float], roof_m: float) -> Soup:
    """A painted cabin with panes set into all four sides."""
    tail, roof_tail, roof_nose, nose = feet
    half_m, low = stations[:, 1].max() * 0.92, 0.02 - stations[2:4, 2].mean()
    top_m, high = half_m * 0.82, -roof_m
    builder = Builder()
    paint = Material(Texture.PLAIN, PAINT, gloss=0.12)
    tail_left, tail_right = (-top_m, high, roof_tail), (top_m, high, roof_tail)
    nose_left, nose_right = (-top_m, high, roof_nose), (top_m, high, roof_nose)
    foot_tail_left, foot_tail_right = (-half_m, low, tail), (half_m, low, tail)
    foot_nose_left, foot_nose_right = (-half_m, low, nose), (half_m, low, nose)
    builder.quad([nose_left, nose_right, tail_right, tail_left], paint)
    for side, panes in (
        ([tail_left, tail_right, foot_tail_right, foot_tail_left], [(0.09, 0.91)]),
        ([nose_right, nose_left, foot_nose_left, foot_nose_right], [(0.05, 0.95)]),
        ([tail_right, nose_right, foot_nose_right, foot_tail_right], [(0.08, 0.46), (0.51, 0.92)]),
        ([nose_left, tail_left, foot_tail_left, foot_nose_left], [(0.08, 0.49), (0.54, 0.92)]),
    ):
        builder.quad(side, paint)
        for start, end in panes:
            builder.quad(_pane(side, start, end), GLASS, image=True)
    return builder.soup()


def _pane(side: Sequence[Point], start: float, end: float) -> list[Point]:
    """A window in a side [4 corners], between two fractions of its length, 1 cm outside."""
    a, b, c, d = (np.asarray(corner, dtype=np.float64) for corner in side)
    outward = np.cross(b - a, d - a)
    off = 0.01 * outward / np.linalg.norm(outward)
    off *= np.sign((off[[0, 2]] * (a + c - [0, 0, 0])[[0, 2]]).sum()) or 1.0

    def at(along: float, down: float) -> Point:
        top, foot = a + along * (b - a), d + along * (c - d)
        corner: list[float] = (top + down * (foot - top) + off).tolist()
        return corner

    return [at(start, 0.12), at(end, 0.12), at(end, 0.94), at(start, 0.94)]


def _wheels(stations: tuple[tuple[float, float, float], ...]) -> Soup:
    half_m = max(station[1] for station in stations)
    parts = []
    for z in (stations[0][0] + 0.78, stations[-1][0] - 0.82):
        for side in (-1.0, 1.0):
            outer, inner = side * (half_m + 0.01), side * (half_m - 0.2)
            parts.append(disc((side * (half_m + 0.004), -0.40, z), 0.38, "x", UNDER, 14))
            parts.append(disc((outer, -0.31, z), 0.31, "x", Material(Texture.WHEEL), 14))
            parts.append(cylinder((inner, -0.31, z), (outer, -0.31, z), (0.31, 0.31), TYRE, 14))
    return joined(parts)


def _trim(stations: tuple[tuple[float, float, float], ...]) -> Soup:
    """Lights, plates, bumpers, and the dark ground below."""
    builder = Builder()
    (tail, tail_half, tail_top), (nose, nose_half, nose_top) = stations[0], stations[-1]
    red, white = Material(Texture.PLAIN, (0.62, 0.05, 0.05)), Material(Texture.PLAIN, (0.95, 0.96, 0.98), 0.3)
    plate, black = Material(Texture.PLAIN, (0.93, 0.93, 0.86)), Material(Texture.PLAIN, (0.12, 0.12, 0.13))
    for z, half, top, lamp in ((tail - 0.01, tail_half, tail_top, red), (nose + 0.01, nose_half, nose_top, white)):
        for side in (-1.0, 1.0):
            x0, x1 = sorted((side * half * 0.62, side * half * 0.98))
            builder.quad([(x0, -top, z), (x1, -top, z), (x1, 0.18 - top, z), (x0, 0.18 - top, z)], lamp)
        builder.quad([(-0.26, -0.52, z), (0.26, -0.52, z), (0.26, -0.41, z), (-0.26, -0.41, z)], plate)
        builder.quad([(-half, -0.38, z), (half, -0.38, z), (half, -0.22, z), (-half, -0.22, z)], black)
    half = max(station[1] for station in stations)
    y = -0.02
    builder.quad([(-half, y, nose - 0.1), (half, y, nose - 0.1), (half, y, tail + 0.1), (-half, y, tail + 0.1)], UNDER)
    y = -0.2
    builder.quad([(-half, y, nose - 0.2), (half, y, nose - 0.2), (half, y, tail + 0.2), (-half, y, tail + 0.2)], UNDER)
    return builder.soup()
