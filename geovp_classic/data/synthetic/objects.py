"""What stands on a street and drives on it: houses, trees, hedges, lamps and cars, each on the
origin.
"""

import numpy as np

from geovp_classic.data.synthetic.images import Texture
from geovp_classic.data.synthetic.mesh import (
    Colour,
    TriangleMesh,
    box,
    joined,
    lathe,
    sheet,
    triangles,
)
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

STOREY_M = 2.8
STEEL, DARK, BARK, STONE = (
    (0.50, 0.52, 0.53),
    (0.08, 0.08, 0.08),
    (0.50, 0.44, 0.36),
    (0.60, 0.58, 0.55),
)
PLASTERS = (
    (0.93, 0.90, 0.82),
    (0.92, 0.82, 0.62),
    (0.86, 0.72, 0.60),
    (0.72, 0.78, 0.80),
    (0.80, 0.84, 0.72),
)
BRICKS = ((0.78, 0.42, 0.32), (0.66, 0.36, 0.28), (0.86, 0.66, 0.50))
ROOFS = ((0.66, 0.34, 0.26), (0.48, 0.28, 0.24), (0.36, 0.36, 0.39), (0.52, 0.44, 0.38))
GREENS = ((0.62, 0.72, 0.52), (0.70, 0.74, 0.48), (0.52, 0.66, 0.52), (0.60, 0.66, 0.42))
GREYS = (
    (0.80, 0.81, 0.83),
    (0.86, 0.86, 0.85),
    (0.10, 0.10, 0.12),
    (0.30, 0.31, 0.34),
    (0.62, 0.60, 0.54),
)
PAINTS = (*GREYS, (0.55, 0.08, 0.09), (0.10, 0.18, 0.42), (0.16, 0.30, 0.24), (0.74, 0.30, 0.10))
# Kinds of cars: half length and width, heights of shoulder and roof, and z of the cabin's foot and
# roof from the tail.
HATCHBACK = (2.0, 0.87, 0.92, 1.48, (-1.93, -1.55, 0.15, 1.0))
SALOON = (2.3, 0.89, 0.94, 1.43, (-1.75, -1.0, 0.1, 1.0))
VAN = (2.4, 0.95, 1.08, 1.98, (-2.36, -2.3, 1.0, 1.75))
FLOOR_M, WHEEL_M = 0.24, 0.31
WHEEL_PROFILE = WHEEL_M * np.array(
    [(0.0, 1.0), (3.3, 1.0), (3.3, 0.66), (2.9, 0.0)]
)  # the rim from the third on
# A car's cross-sections from tail to nose, in half lengths, half widths and heights of the
# shoulder.
SECTIONS = np.array(
    [
        (-1, 0.85, 0.85),
        (-0.96, 0.95, 0.98),
        (-0.6, 1, 1),
        (0.45, 1, 0.98),
        (0.85, 0.97, 0.86),
        (1, 0.84, 0.66),
    ]
)
# Half a cross-section from below to the middle of its top, in half widths and in heights over the
# floor.
OUTLINE = np.array([(0.86, 0.0), (0.98, 0.2), (1.0, 0.55), (0.96, 0.86), (0.82, 1.0), (0.0, 1.06)])


def house(rng: np.random.Generator, garden_m: float) -> tuple[TriangleMesh, FloatArray]:
    """A house with a gable roof, its front along x at z = 0 and a hedge before it; and its width
    and depth [2].
    """
    bricks = rng.random() < 0.4
    walls, plain = (
        (Texture.BRICK_WINDOWS, Texture.BRICK)
        if bricks
        else (Texture.PLASTER_WINDOWS, Texture.PLASTER)
    )
    tint, roof, paint = (
        rng.choice(BRICKS if bricks else PLASTERS),
        rng.choice(ROOFS),
        rng.uniform(0.14, 0.5, 3),
    )
    bays, storeys = rng.integers((3, 3), (6, 5)), int(rng.choice([1, 2, 2, 3]))
    size_m, top = bays * rng.uniform(2.5, 2.9, 2), -storeys * STOREY_M
    x, z = size_m / 2
    corners = np.array([(-x, 0.0, -z), (x, 0.0, -z), (x, 0.0, z), (-x, 0.0, z), (-x, 0.0, -z)])
    tiles = (np.cumsum([0.0, *bays, *bays]) / 2, [[-storeys / 2], [0.0]])
    door, front = (rng.integers(bays[0]) + 0.5) * size_m[0] / bays[0] - x, -z
    lower = [
        sheet([corners + np.array([0.0, top, 0.0]), corners], walls, tint, tiles, [[1.0], [0.8]]),
        box((-x - 0.03, -0.4, -z - 0.03), (x + 0.03, 0.6, z + 0.03), Texture.PLASTER, STONE),
        box((door - 0.6, -2.35, front - 0.04), (door + 0.6, -0.2, front), Texture.PLAIN, paint),
        box((door - 0.9, -2.6, front - 0.9), (door + 0.9, -2.48, front), Texture.ROOF, roof),
    ]
    swap = rng.random() < 0.35  # the ridge across the front
    x, z = (z, x) if swap else (x, z)
    rise = float(rng.uniform(0.55, 0.95))
    ridge, low, eaves, slope_m = (
        top - rise * z,
        top + 0.45 * rise,
        z + 0.45,
        (z + 0.45) * np.hypot(1, rise),
    )
    gables = np.array([[(side, ridge, 0.0), (side, top, z), (side, top, -z)] for side in (-x, x)])
    slopes = [
        [(end, y, z) for end in (-x - 0.4, x + 0.4)]
        for y, z in ((low, -eaves), (ridge, 0), (low, eaves))
    ]
    upper = [
        triangles(gables, plain, tint),
        sheet(slopes, Texture.ROOF, roof, ([0.0, x / 2], [[slope_m / 4], [0.0], [slope_m / 4]])),
        box(
            (0.4 * x - 0.35, ridge - 0.8, 0.3),
            (0.4 * x + 0.35, ridge + 1.5, 1.0),
            Texture.BRICK,
            BRICKS[1],
        ),
    ]
    parts = [*lower, joined(upper).moved(se3.exp(np.array([0, 0, 0, 0, np.pi / 2 * swap, 0])))]
    for left in (
        (-size_m[0] / 2 - 0.5, 1.0) if rng.random() < 0.6 else ()
    ):  # with a gap for the gate
        low_z, right, top_y = (
            front - garden_m + 0.4,
            left + size_m[0] / 2 - 0.7,
            -rng.uniform(0.8, 1.5),
        )
        parts.append(
            box((left, top_y, low_z), (right, 0.3, low_z + 0.7), Texture.LEAVES, GREENS[2])
        )
    return joined(parts).moved(se3.compose(np.eye(3), np.array([0, 0, -front]))), size_m


def tree(rng: np.random.Generator, height_m: float, detail: int) -> TriangleMesh:
    """A forked trunk and a crown of lumps that is rounder or taller from tree to tree."""
    green = rng.choice(GREENS)
    crown_m, tall = height_m * float(rng.uniform(0.25, 0.33)), float(rng.uniform(0.8, 1.5))
    middle_m = max(height_m - crown_m * (0.9 + 0.4 * tall), 2.2 + 0.6 * crown_m)
    trunk = lathe(
        (0, 0.3, 0), (0.1, -middle_m, 0.05), [(0.0, 0.026 * height_m), (1.0, 0.013 * height_m)]
    )
    parts = [sheet(trunk, Texture.PLASTER, BARK)]
    for turn in range(6):
        angle_rad = 2.4 * turn + rng.uniform(-0.4, 0.4)
        out_m = crown_m * rng.uniform(0.45, 0.75) * (turn > 0)
        up_m = crown_m * tall * (rng.uniform(-0.35, 0.5) if turn else 0.45)
        centre = np.array([out_m * np.sin(angle_rad), -middle_m - up_m, out_m * np.cos(angle_rad)])
        lump = _foliage(rng, crown_m * rng.uniform(0.45, 0.68), detail, green)
        branch = lathe((0.1, -0.7 * middle_m, 0.05), centre, [(0.0, 0.09), (1.0, 0.03)], 5)
        parts += [lump.moved(se3.compose(np.eye(3), centre)), sheet(branch, Texture.PLASTER, BARK)]
    return joined(parts)


def _foliage(rng: np.random.Generator, radius_m: float, detail: int, green: Colour) -> TriangleMesh:
    """A dented ball of leaves around the origin with sprays that stick out, darker below and
    inside.
    """
    angle_rad = np.linspace(0, np.pi, 4 * detail + 1)
    profile = np.stack([0.5 - 0.5 * np.cos(angle_rad), np.sin(angle_rad)], axis=-1)
    ball = lathe((0, 1, 0), (0, -1, 0), profile, 6 * detail)
    ball = (
        ball
        * (1 + 0.045 * np.sin(ball @ rng.normal(0, 3.0, (3, 8)) + rng.uniform(0, 6.3, 8)).sum(-1))[
            ..., None
        ]
    )
    outward = rng.normal(size=(40 * detail**2, 1, 3))
    outward *= radius_m / np.linalg.norm(outward, axis=-1, keepdims=True)
    sprays = outward + rng.normal(0, 0.14, (len(outward), 3, 3))
    corners = np.concatenate([sheet(radius_m * ball, Texture.LEAVES).corners, sprays])
    light = 0.66 - 0.40 * corners[..., 1] / radius_m + rng.normal(0, 0.08, (len(corners), 1))
    return triangles(corners, Texture.LEAVES, green, None, np.clip(light, 0.22, 1.15))


def lamp() -> TriangleMesh:
    """A street lamp; its arm reaches towards -z."""
    post = lathe((0, 0.2, 0), (0, -5.6, 0), [(0.0, 0.085), (1.0, 0.055)])
    arm = lathe((0, -5.55, 0), (0, -5.9, -1.3), [(0.0, 0.045), (1.0, 0.04)], 6)
    head = box((-0.14, -6.02, -1.9), (0.14, -5.86, -1.2), Texture.PLAIN, STEEL)
    return joined([sheet(post, Texture.PLAIN, STEEL), sheet(arm, Texture.PLAIN, STEEL), head])


def car(rng: np.random.Generator) -> TriangleMesh:
    """A random car on the ground, its nose towards +z."""
    length_m, width_m, top_m, roof_m, cabin = (HATCHBACK, SALOON, VAN)[
        rng.choice(3, p=[0.4, 0.4, 0.2])
    ]
    paint = rng.choice(PAINTS)
    z, half_m, shoulder_m = (SECTIONS * [length_m, width_m, top_m]).T[..., None]
    over_m = (shoulder_m - FLOOR_M) * OUTLINE[:, 1]
    body = np.stack(np.broadcast_arrays(half_m * OUTLINE[:, 0], -FLOOR_M - over_m, z), axis=-1)
    along, down = (z / length_m + 1) / 2, np.clip(1 - over_m / (top_m - FLOOR_M), 0.01, 0.99)
    under = box(
        (-0.9 * width_m, -FLOOR_M, 0.05 - length_m),
        (0.9 * width_m, -0.02, length_m - 0.05),
        Texture.PLAIN,
        DARK,
    )
    parts = [_cabin(0.92 * width_m, top_m, roof_m, cabin, paint), under]
    for side, sign in ((body, 1), (body * [-1, 1, 1], -1)):
        light = np.clip(0.5 - 0.65 * side[..., 1], 0.4, 1.0)
        parts.append(
            sheet(side[:, :4], Texture.CAR_SIDE, paint, (along, down[:, :4]), light[:, :4])
        )
        parts.append(sheet(side[:, 3:], Texture.CAR_PAINT, paint))
        for end, middle in ((0, 0.25), (-1, 0.75)):
            rows = np.stack([side[end], side[end] * [0, 1, 1]])
            image = (
                middle + 0.25 * rows[..., 0] / half_m[end],
                1 + (rows[..., 1] + FLOOR_M) / over_m[end, -1],
            )
            parts.append(sheet(rows, Texture.CAR_END, paint, image, light[end]))
            hub = np.array([sign * width_m, -WHEEL_M, (4 * middle - 2) * 0.64 * length_m])
            wheel = lathe(hub - [0.2 * sign, 0, 0], hub, WHEEL_PROFILE, 16)
            parts += [sheet(wheel[:3], Texture.PLAIN, DARK), sheet(wheel[2:], Texture.PLAIN, STEEL)]
    return joined(parts)


def _cabin(
    half_m: float, foot_m: float, roof_m: float, ends: tuple[float, ...], paint: Colour
) -> TriangleMesh:
    """The glazed upper part: one pane at the front and at the back, two at the sides."""
    x = half_m * np.array([-1.0, 1.0, 1.0, -1.0, -1.0])
    foot = np.column_stack([x, np.full(5, 0.03 - foot_m), np.take(ends, [3, 3, 0, 0, 3])])
    roof = np.column_stack([0.82 * x, np.full(5, -roof_m), np.take(ends, [2, 2, 1, 1, 2])])
    lid = np.broadcast_to(roof[:4].mean(axis=0), roof.shape)
    tiles = ([0.0, 1.0, 3.0, 4.0, 6.0], [[0.0], [0.0], [1.0]])
    return sheet([lid, roof, foot], Texture.CAR_WINDOW, paint, tiles)
