"""Houses with roofs, windows, doors and chimneys, in the colours of a suburb."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.data.synthetic.mesh import Builder, Colour, Material, Soup, soup_of
from geovp_classic.data.synthetic.textures import Texture

STOREY_M = 2.8
FOUNDATION_M = 0.6  # how deep walls go, so that none floats on a slope
WINDOWS = (Texture.WINDOW_PLAIN, Texture.WINDOW_CURTAIN, Texture.WINDOW_CROSS)
PLASTERS: tuple[Colour, ...] = (
    (0.93, 0.90, 0.82),
    (0.96, 0.95, 0.93),
    (0.92, 0.82, 0.62),
    (0.86, 0.72, 0.60),
    (0.72, 0.78, 0.80),
    (0.80, 0.84, 0.72),
    (0.88, 0.66, 0.55),
)
BRICKS: tuple[Colour, ...] = ((0.78, 0.42, 0.32), (0.66, 0.36, 0.28), (0.86, 0.66, 0.50))
ROOFS: tuple[Colour, ...] = ((0.66, 0.34, 0.26), (0.48, 0.28, 0.24), (0.36, 0.36, 0.39), (0.52, 0.44, 0.38))
DOORS: tuple[Colour, ...] = ((0.45, 0.28, 0.18), (0.22, 0.32, 0.45), (0.5, 0.14, 0.14), (0.2, 0.34, 0.25))
TRIM = Material(Texture.PLAIN, (0.9, 0.9, 0.88))


@dataclass(frozen=True)
class Plan:
    """The size and the looks of one house; the front lies along x at z = 0, the house behind it at z > 0."""

    width_m: float
    depth_m: float
    storeys: int
    wall: Material
    roof: Material
    window: Texture
    door: Colour
    shutters: Colour | None
    ridge_along_front: bool
    roof_rise: float  # metres of rise per metre


def draw_plan(rng: np.random.Generator) -> Plan:
    """A random house."""
    brick = rng.random() < 0.35
    colours = BRICKS if brick else PLASTERS
    wall = Material(Texture.BRICK if brick else Texture.PLASTER, colours[rng.integers(len(colours))])
    return Plan(
        width_m=float(rng.uniform(8, 14)),
        depth_m=float(rng.uniform(8, 11)),
        storeys=int(rng.choice([1, 2, 2, 3])),
        wall=wall,
        roof=Material(Texture.ROOF, ROOFS[rng.integers(len(ROOFS))]),
        window=WINDOWS[rng.integers(len(WINDOWS))],
        door=DOORS[rng.integers(len(DOORS))],
        shutters=DOORS[rng.integers(len(DOORS))] if not brick and rng.random() < 0.4 else None,
        ridge_along_front=bool(rng.random() < 0.65),
        roof_rise=float(rng.uniform(0.55, 0.95)),
    )


def house(plan: Plan, rng: np.random.Generator) -> Soup:
    """The house of a plan, its front at z = 0, the middle of the front on the origin."""
    builder = Builder()
    _walls(builder, plan)
    _roof(builder, plan)
    _front(builder, plan, rng)
    _sides(builder, plan)
    return builder.soup()


def _walls(builder: Builder, plan: Plan) -> None:
    half, top, depth = plan.width_m / 2, -plan.storeys * STOREY_M, plan.depth_m
    foot = -0.45
    shade, dark = (1.0, 0.93), (0.93, 0.55)
    plinth = Material(Texture.PLASTER, (0.6, 0.58, 0.55))
    for start, end in (
        ((-half, 0.0), (half, 0.0)),
        ((half, 0.0), (half, depth)),
        ((half, depth), (-half, depth)),
        ((-half, depth), (-half, 0.0)),
    ):
        (x0, z0), (x1, z1) = start, end
        builder.quad([(x0, top, z0), (x1, top, z1), (x1, foot, z1), (x0, foot, z0)], plan.wall, shade=shade)
        builder.quad(
            [(x0, foot, z0), (x1, foot, z1), (x1, FOUNDATION_M, z1), (x0, FOUNDATION_M, z0)], plinth, shade=dark
        )


def _roof(builder: Builder, plan: Plan) -> None:
    """A gable roof with eaves; gables are filled with wall."""
    half, depth, top, over = plan.width_m / 2, plan.depth_m, -plan.storeys * STOREY_M, 0.45
    if plan.ridge_along_front:
        rise = plan.roof_rise * depth / 2
        ridge, low = top - rise, top + plan.roof_rise * over
        x0, x1, zf, zb, zm = -half - over, half + over, -over, depth + over, depth / 2
        builder.quad([(x0, ridge, zm), (x1, ridge, zm), (x1, low, zf), (x0, low, zf)], plan.roof)
        builder.quad([(x1, ridge, zm), (x0, ridge, zm), (x0, low, zb), (x1, low, zb)], plan.roof)
        for x in (-half, half):
            builder.add(soup_of(np.array([[(x, ridge, zm), (x, top, depth), (x, top, 0.0)]]), plan.wall))
        builder.box((x0, low - 0.02, zf - 0.1), (x1, low + 0.12, zf + 0.02), TRIM)
    else:
        rise = plan.roof_rise * half
        ridge, low = top - rise, top + plan.roof_rise * over
        x0, x1, zf, zb = -half - over, half + over, -over, depth + over
        builder.quad([(0, ridge, zf), (0, ridge, zb), (x1, low, zb), (x1, low, zf)], plan.roof)
        builder.quad([(0, ridge, zb), (0, ridge, zf), (x0, low, zf), (x0, low, zb)], plan.roof)
        for z in (0.0, depth):
            builder.add(soup_of(np.array([[(0.0, ridge, z), (half, top, z), (-half, top, z)]]), plan.wall))
        _window(builder, plan, (0.0, 0.0), (1.0, 0.0), top - 0.6, (1.0, 1.1))
    x, z = (0.25 * plan.width_m, depth / 2) if plan.ridge_along_front else (0.1, 0.7 * depth)
    builder.box(
        (x - 0.35, ridge - 0.9, z - 0.35), (x + 0.35, ridge + 0.8, z + 0.35), Material(Texture.BRICK, BRICKS[1])
    )


def _front(builder: Builder, plan: Plan, rng: np.random.Generator) -> None:
    slots = max(3, round(plan.width_m / 2.7))
    places = (np.arange(slots) - (slots - 1) / 2) * (plan.width_m / slots)
    door_slot, garage_slot = int(rng.integers(slots)), int(rng.integers(2 * slots))  # not every house has a garage
    for storey in range(plan.storeys):
        for slot, x in enumerate(places):
            if storey == 0 and slot == door_slot:
                _door(builder, plan, float(x))
            elif storey == 0 and slot == garage_slot:
                _garage(builder, plan, float(x))
            else:
                _window(builder, plan, (float(x), 0.0), (1.0, 0.0), -storey * STOREY_M - 1.1, (1.15, 1.35))


def _sides(builder: Builder, plan: Plan) -> None:
    half = plan.width_m / 2
    for storey in range(plan.storeys):
        for z in (0.27 * plan.depth_m, 0.73 * plan.depth_m):
            bottom = -storey * STOREY_M - 1.1
            _window(builder, plan, (half, z), (0.0, 1.0), bottom, (1.0, 1.3))
            _window(builder, plan, (-half, z), (0.0, -1.0), bottom, (1.0, 1.3))


def _door(builder: Builder, plan: Plan, x: float) -> None:
    door = Material(Texture.DOOR, plan.door)
    builder.quad(
        [(x - 0.55, -2.35, -0.03), (x + 0.55, -2.35, -0.03), (x + 0.55, -0.2, -0.03), (x - 0.55, -0.2, -0.03)],
        door,
        image=True,
    )
    builder.box((x - 0.9, -2.6, -0.9), (x + 0.9, -2.48, 0.0), plan.roof)
    builder.box((x - 0.9, -0.2, -1.0), (x + 0.9, FOUNDATION_M, 0.0), Material(Texture.KERB))


def _garage(builder: Builder, plan: Plan, x: float) -> None:
    door = Material(Texture.GARAGE, plan.shutters or (0.92, 0.92, 0.9))
    corners = [(x - 1.2, -2.2, -0.03), (x + 1.2, -2.2, -0.03), (x + 1.2, 0.05, -0.03), (x - 1.2, 0.05, -0.03)]
    builder.quad(corners, door, image=True)


def _window(
    builder: Builder,
    plan: Plan,
    place: tuple[float, float],  # (x, z) of its middle on the wall
    along: tuple[float, float],  # (x, z) to the right as seen from outside
    bottom: float,
    size_m: tuple[float, float],
) -> None:
    """A window just off the wall, its sill, and shutters where the plan has them."""
    (ax, az), (w, h) = along, size_m
    out = (az * 0.03, -ax * 0.03)

    def corner(right_m: float, y: float, off: float = 1.0) -> tuple[float, float, float]:
        return (place[0] + ax * right_m + out[0] * off, y, place[1] + az * right_m + out[1] * off)

    top = bottom - h
    glass = Material(plan.window, gloss=0.35)
    quad = [corner(-w / 2, top), corner(w / 2, top), corner(w / 2, bottom), corner(-w / 2, bottom)]
    builder.quad(quad, glass, image=True)
    sill = [corner(-w / 2 - 0.1, bottom, 1.5), corner(w / 2 + 0.1, bottom, 1.5)]
    builder.quad([*sill, corner(w / 2 + 0.1, bottom + 0.12, 5.0), corner(-w / 2 - 0.1, bottom + 0.12, 5.0)], TRIM)
    if plan.shutters is not None:
        wood = Material(Texture.FENCE, plan.shutters)
        for middle in (-w * 0.76, w * 0.76):
            left, right = middle - w * 0.24, middle + w * 0.24
            builder.quad(
                [
                    corner(left, top, 1.6),
                    corner(right, top, 1.6),
                    corner(right, bottom, 1.6),
                    corner(left, bottom, 1.6),
                ],
                wood,
            )
