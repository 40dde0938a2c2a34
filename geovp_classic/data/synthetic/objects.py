"""Meshes of the objects on a street, each at the origin: houses, trees, lamps and cars.

Tints and sizes are in objects.toml.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from geovp_classic.data.synthetic.mesh import (
    Colour,
    TriangleMesh,
    box,
    joined,
    lathe,
    sheet,
    triangles,
)
from geovp_classic.data.synthetic.textures import TILE_M, Texture
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

TABLES: dict[str, Any] = tomllib.loads(
    Path(__file__).with_name("objects.toml").read_text()
)
TINTS = TABLES["tints"]


def house(rng: Generator, garden_m: float) -> tuple[TriangleMesh, FloatArray]:
    """Return a house with a gable roof and a hedge before it, and its width and depth [2].

    Its front lies along x at z = 0.
    """
    has_bricks = rng.random() < 0.4
    tint = rng.choice(TINTS["bricks" if has_bricks else "plasters"])
    roof_tint = rng.choice(TINTS["roofs"])
    door_tint = rng.uniform(0.14, 0.5, 3)
    bays = rng.integers((3, 3), (6, 5))
    storeys = int(rng.choice([1, 2, 2, 3]))
    size_m = bays * rng.uniform(2.5, 2.9, 2)
    x, z = size_m / 2
    top = -2.8 * storeys
    door_x = (rng.integers(bays[0]) + 0.5) * size_m[0] / bays[0] - x

    foot = np.array(
        [(-x, 0.0, -z), (x, 0.0, -z), (x, 0.0, z), (-x, 0.0, z), (-x, 0.0, -z)]
    )
    walls = Texture.BRICK_WINDOWS if has_bricks else Texture.PLASTER_WINDOWS
    uv = (np.cumsum([0.0, *bays, *bays]) / 2, [[-storeys / 2], [0.0]])
    parts = [
        sheet(
            [foot + np.array([0.0, top, 0.0]), foot],
            walls,
            tint,
            uv,
            [[1.0], [0.8]],
        ),
        box(
            (0, 0.1, 0),
            (x + 0.03, 0.5, z + 0.03),
            Texture.PLASTER,
            TINTS["stone"],
        ),
        box((door_x, -1.28, -z), (0.6, 1.08, 0.04), Texture.PLAIN, door_tint),
        box((door_x, -2.54, -z), (0.9, 0.06, 0.9), Texture.ROOF, roof_tint),
    ]
    gables = Texture.BRICK if has_bricks else Texture.PLASTER
    if rng.random() < 0.35:  # the ridge runs from front to back
        quarter_turn = se3.exp(np.array([0, 0, 0, 0, np.pi / 2, 0]))
        parts.append(
            _roof(rng, z, x, top, gables, tint, roof_tint).moved(quarter_turn)
        )
    else:
        parts.append(_roof(rng, x, z, top, gables, tint, roof_tint))
    if rng.random() < 0.6:  # a hedge with a gap for the gate
        hedge_z = 0.75 - z - garden_m
        half_m = x / 2 - 0.35
        for left in (-x - 0.5, 1.0):
            half_size = (half_m, rng.uniform(0.8, 1.5), 0.35)
            parts.append(
                box(
                    (left + half_m, 0, hedge_z),
                    half_size,
                    Texture.LEAVES,
                    TINTS["hedge"],
                )
            )
    return joined(parts).moved(
        se3.compose(np.eye(3), np.array([0, 0, z]))
    ), size_m


def _roof(
    rng: Generator,
    x: float,
    z: float,
    top: float,
    gable_texture: Texture,
    gable_tint: Colour,
    tint: Colour,
) -> TriangleMesh:
    """Return a gable roof with a chimney on walls of half sizes x and z; the ridge is along x."""
    rise = rng.uniform(0.55, 0.95)
    ridge = top - rise * z
    eaves_z = z + 0.45
    eaves_y = top + 0.45 * rise
    gables = np.array(
        [[(end, ridge, 0), (end, top, z), (end, top, -z)] for end in (-x, x)]
    )
    rows = ((eaves_y, -eaves_z), (ridge, 0), (eaves_y, eaves_z))
    slopes = [[(end, *row) for end in (-x - 0.4, x + 0.4)] for row in rows]
    slope_tiles = eaves_z * np.hypot(1, rise) / TILE_M[Texture.ROOF]
    uv = ([0.0, x / 2], [[slope_tiles], [0.0], [slope_tiles]])
    chimney = (0.4 * x, ridge + 0.35, 0.65)
    return joined(
        [
            triangles(gables, gable_texture, gable_tint),
            sheet(slopes, Texture.ROOF, tint, uv),
            box(chimney, (0.35, 1.15, 0.35), Texture.BRICK, TINTS["chimney"]),
        ]
    )


def tree(rng: Generator, height_m: float, detail: int) -> TriangleMesh:
    """Return a forked trunk with a crown of lumps, rounder or taller from tree to tree."""
    green = rng.choice(TINTS["greens"])
    crown_m = height_m * rng.uniform(0.25, 0.33)
    slimness = rng.uniform(0.8, 1.5)
    fork_m = max(
        height_m - crown_m * (0.9 + 0.4 * slimness), 2.2 + 0.6 * crown_m
    )
    trunk = _branch(
        (0, 0.3, 0), (0.1, -fork_m, 0.05), 0.026 * height_m, 0.013 * height_m
    )
    parts = [trunk]
    for turn in range(6):  # the first lump is in the middle
        angle_rad = 2.4 * turn + rng.uniform(-0.4, 0.4)
        out_m = crown_m * rng.uniform(0.45, 0.75) * (turn > 0)
        up_m = (
            crown_m * slimness * (rng.uniform(-0.35, 0.5) if turn > 0 else 0.45)
        )
        centre = np.array(
            [
                out_m * np.sin(angle_rad),
                -fork_m - up_m,
                out_m * np.cos(angle_rad),
            ]
        )
        lump = _foliage(rng, crown_m * rng.uniform(0.45, 0.68), detail, green)
        parts.append(lump.moved(se3.compose(np.eye(3), centre)))
        parts.append(_branch((0.1, -0.7 * fork_m, 0.05), centre, 0.09, 0.03))
    return joined(parts)


def _branch(
    start: Colour, end: Colour, start_radius_m: float, end_radius_m: float
) -> TriangleMesh:
    """Return a cone of bark between two points [3]."""
    rings = lathe(start, end, [(0.0, start_radius_m), (1.0, end_radius_m)])
    return sheet(rings, Texture.PLASTER, TINTS["bark"])


def _foliage(
    rng: Generator, radius_m: float, detail: int, green: Colour
) -> TriangleMesh:
    """Return a dented ball of leaves with sprays that stick out, darker below and inside."""
    angle_rad = np.linspace(0, np.pi, 4 * detail + 1)
    profile = np.stack(
        [0.5 - 0.5 * np.cos(angle_rad), np.sin(angle_rad)], axis=-1
    )
    ball = lathe((0, 1, 0), (0, -1, 0), profile, 6 * detail)
    waves = np.sin(ball @ rng.normal(0, 3.0, (3, 8)) + rng.uniform(0, 6.3, 8))
    ball *= radius_m * (1 + 0.045 * waves.sum(axis=-1, keepdims=True))
    outward = rng.normal(size=(40 * detail**2, 1, 3))
    outward *= radius_m / np.linalg.norm(outward, axis=-1, keepdims=True)
    sprays = outward + rng.normal(0, 0.14, (len(outward), 3, 3))
    corners = np.concatenate([sheet(ball, Texture.LEAVES).corners, sprays])
    light = (
        0.66
        - 0.40 * corners[..., 1] / radius_m
        + rng.normal(0, 0.08, (len(corners), 1))
    )
    return triangles(
        corners, Texture.LEAVES, green, ambient=np.clip(light, 0.22, 1.15)
    )


def lamp() -> TriangleMesh:
    """Return a street lamp whose arm reaches towards -z."""
    steel = (Texture.PLAIN, TINTS["steel"])
    post = box((0, -2.75, 0), (0.06, 2.95, 0.06), *steel)
    arm = box((0, -5.75, -0.65), (0.04, 0.06, 0.65), *steel)
    head = box((0, -5.94, -1.55), (0.14, 0.08, 0.35), *steel)
    return joined([post, arm, head])


@dataclass(frozen=True)
class Car:
    """A kind of car."""

    half_length_m: float
    half_width_m: float
    shoulder_m: float  # height of the body
    roof_m: float  # height of the roof
    cabin_z_m: tuple[
        float, float, float, float
    ]  # foot and roof at the tail, roof and foot ahead
    probability: float
    floor_m: float = 0.24  # height of the floor
    wheel_m: float = 0.31  # radius

    def mesh(self, paint: Colour) -> TriangleMesh:
        """Return the car on the ground, its nose towards +z."""
        x = 0.9 * self.half_width_m
        half_size = (x, 0.11, self.half_length_m - 0.05)
        under = box(
            (0, 0.11 - self.floor_m, 0), half_size, Texture.PLAIN, TINTS["dark"]
        )
        wheels = [
            self._wheel(
                side * self.half_width_m, end * 0.64 * self.half_length_m
            )
            for side in (-1, 1)
            for end in (-1, 1)
        ]
        return joined([self._body(paint), self._cabin(paint), under, *wheels])

    def _body(self, paint: Colour) -> TriangleMesh:
        """Return the body below the windows: its shell and both ends."""
        sections = np.array(TABLES["car"]["sections"])
        outline = np.array(TABLES["car"]["outline"])
        scale_m = [self.half_length_m, self.half_width_m, self.shoulder_m]
        z, width_m, top_m = (sections * scale_m).T[
            ..., None
        ]  # each [sections, 1]
        x = width_m * outline[:, 0]
        above_m = (top_m - self.floor_m) * outline[:, 1]  # above the floor
        shell = np.stack([x, -self.floor_m - above_m, z + 0 * x], axis=-1)
        ambient = np.clip(0.5 - 0.65 * shell[..., 1], 0.4, 1.0)
        u = (z / self.half_length_m + 1) / 2
        v = np.clip(1 - above_m / (self.shoulder_m - self.floor_m), 0.01, 0.99)
        meshes = [sheet(shell, Texture.CAR_SIDE, paint, (u, v), ambient)]
        for end, middle in (
            (0, 0.25),
            (-1, 0.75),
        ):  # tail and nose in the texture
            rows = np.stack([shell[end], shell[end] * [0, 1, 1]])
            u = middle + 0.25 * rows[..., 0] / width_m[end]
            v = 1 - above_m[end] / above_m[end].max()
            meshes.append(
                sheet(rows, Texture.CAR_END, paint, (u, v), ambient[end])
            )
        return joined(meshes)

    def _cabin(self, paint: Colour) -> TriangleMesh:
        """Return the glazed upper part: a pane at the front and at the back, two at the sides."""
        x = 0.92 * self.half_width_m * np.array([-1.0, 1.0, 1.0, -1.0, -1.0])
        z = np.array(self.cabin_z_m)
        foot = np.column_stack(
            [x, 0 * x + 0.03 - self.shoulder_m, z[[3, 3, 0, 0, 3]]]
        )
        roof = np.column_stack(
            [0.82 * x, 0 * x - self.roof_m, z[[2, 2, 1, 1, 2]]]
        )
        lid = np.broadcast_to(roof[:4].mean(axis=0), roof.shape)
        uv = ([0.0, 1.0, 3.0, 4.0, 6.0], [[0.0], [0.0], [1.0]])
        return sheet([lid, roof, foot], Texture.CAR_WINDOW, paint, uv)

    def _wheel(self, x: float, z: float) -> TriangleMesh:
        """Return tyre and rim of the wheel whose outer face is at x."""
        profile = self.wheel_m * np.array(
            [(0.0, 1.0), (3.3, 1.0), (3.3, 0.66), (2.9, 0.0)]
        )
        inner_x = x - 0.2 * np.sign(x)
        rings = lathe(
            (inner_x, -self.wheel_m, z), (x, -self.wheel_m, z), profile, 16
        )
        tyre = sheet(rings[:3], Texture.PLAIN, TINTS["dark"])
        rim = sheet(rings[2:], Texture.PLAIN, TINTS["steel"])
        return joined([tyre, rim])


def car(rng: Generator) -> TriangleMesh:
    """Return a random car on the ground, its nose towards +z."""
    kinds = [Car(**table) for table in TABLES["car"]["kinds"]]
    kind = rng.choice(len(kinds), p=[kind.probability for kind in kinds])
    return kinds[kind].mesh(rng.choice(TINTS["car_paints"]))
