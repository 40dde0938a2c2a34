"""Roads with rounded junctions, kerbs, pavements and grass: one mesh, cut where the distance to a road says so."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.data.synthetic.mesh import Material, Soup, joined, soup_of
from geovp_classic.data.synthetic.paths import STEP_M, Path, Terrain
from geovp_classic.data.synthetic.textures import TILE_M, IntArray, Texture
from geovp_classic.types import BoolArray, FloatArray

KERB_HEIGHT_M = 0.12
CORNER_RADIUS_M = 6.0
PAVEMENT_M = 2.2  # from the kerb's edge to the grass
ZEBRA_M = 3.0  # half the tile of its image; the other half is see-through
CELL_M = 1.2
FAR_CELL_M = 16.0
PAINT_WIDTH_M = 9.4  # the paint's image spans this much of the road

ASPHALT = Material(Texture.ASPHALT)
KERB = Material(Texture.KERB)
PAVEMENT = Material(Texture.PAVEMENT)
GRASS = Material(Texture.GRASS)


@dataclass(frozen=True)
class Roads:
    """Streets by their centre lines; the carriageway is `half_width_m` to either side."""

    paths: list[Path]
    half_width_m: float = 4.6

    def distance_m(self, places: FloatArray) -> FloatArray:
        """Signed distance [N] of places [N, 2] from the kerb, negative on the carriageway, corners rounded."""
        total: FloatArray | None = None
        for path in self.paths:
            own = np.abs(path.locate(places)[1]) - self.half_width_m
            total = own if total is None else _round_union(total, own, CORNER_RADIUS_M)
        assert total is not None
        return total

    def lane(self, places: FloatArray) -> tuple[FloatArray, FloatArray, IntArray, BoolArray]:
        """Metres along and right of the nearest street [N], its number, and whether it is painted there."""
        found = [path.locate(places) for path in self.paths]
        along_m, right_m = (np.stack([place[k] for place in found]) for k in (0, 1))  # [streets, N]
        near = np.abs(right_m).argmin(axis=0)
        close = (np.abs(right_m) < self.half_width_m + CORNER_RADIUS_M).sum(axis=0)
        column = np.arange(len(places))
        return along_m[near, column], right_m[near, column], near, close < 2

    def zebras(self) -> list[tuple[int, float]]:
        """The number of the street and the metres along it at which zebra crossings begin: on all arms of junctions."""
        starts = []
        before_m = self.half_width_m + CORNER_RADIUS_M + 0.5
        for number, path in enumerate(self.paths):
            for other in self.paths[:number] + self.paths[number + 1 :]:
                middle_m = float(np.abs(other.locate(path.points)[1]).argmin() * STEP_M)
                starts += [(number, middle_m + before_m), (number, middle_m - before_m - ZEBRA_M)]
        return starts


def ground(roads: Roads, terrain: Terrain, focus: FloatArray, reach_m: float) -> Soup:
    """The ground around the places of interest [K, 2]; fine near the streets, coarse as far as `reach_m` beyond."""
    fine = _grid(focus.min(axis=0) - reach_m, focus.max(axis=0) + reach_m, CELL_M)
    middle = fine[:, :, :2].mean(axis=1)
    distance_m = roads.distance_m(middle)
    wanted = distance_m < 9.0
    road, raised, kerb_line = _split(_with_distance(fine[wanted], roads), 0.0)
    stone, beyond, _ = _split(raised, 0.2)
    slabs, verge, _ = _split(beyond, PAVEMENT_M)
    far = _grid(focus.min(axis=0) - 500.0, focus.max(axis=0) + 500.0, FAR_CELL_M)
    return joined(
        [
            _painted(_flat(road, 0.0, ASPHALT, terrain), road, roads),
            _flat(stone, KERB_HEIGHT_M, KERB, terrain),
            _flat(slabs, KERB_HEIGHT_M, PAVEMENT, terrain),
            _flat(verge, KERB_HEIGHT_M, GRASS, terrain),
            _kerb_faces(kerb_line, terrain),
            _flat(far, -0.25, GRASS, terrain),
        ]
    )


def _round_union(a: FloatArray, b: FloatArray, radius_m: float) -> FloatArray:
    """Signed distance to the union of two shapes, the inner corner between them filled with an arc."""
    inside = np.hypot(np.maximum(radius_m - a, 0), np.maximum(radius_m - b, 0))
    return np.maximum(radius_m, np.minimum(a, b)) - inside


def _grid(low: FloatArray, high: FloatArray, cell_m: float) -> FloatArray:
    """Triangles [N, 3, 2] that cover a rectangle of the map."""
    x, z = (np.arange(low[axis], high[axis] + cell_m, cell_m) for axis in (0, 1))
    corner = np.stack(np.meshgrid(x, z), axis=-1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 2)


def _with_distance(triangles: FloatArray, roads: Roads) -> FloatArray:
    """Triangles [N, 3, 3] as (x, z, distance to the kerb)."""
    distance_m = roads.distance_m(triangles.reshape(-1, 2))
    return np.concatenate([triangles, distance_m.reshape(-1, 3, 1)], axis=-1)


def _split(
    triangles: FloatArray,  # [N, 3, 3] as (x, z, distance)
    level_m: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Triangles below and above a distance, cut where they cross it, and the cuts [M, 2, 3], the lower side left."""
    above = triangles[..., 2] > level_m
    count = above.sum(axis=-1)
    sides = [triangles[count == 0]], [triangles[count == 3]]
    cuts = []
    for number, lone_side in ((1, 1), (2, 0)):  # the corner that is alone is above, or below
        mixed = triangles[count == number]
        lone = (above[count == number] == bool(lone_side)).argmax(axis=-1)
        order = (lone[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(mixed, order[..., None], axis=1), 1, 0)
        ab, ac = (a + ((level_m - a[:, 2]) / (end[:, 2] - a[:, 2]))[:, None] * (end - a) for end in (b, c))
        sides[lone_side].append(np.stack([a, ab, ac], axis=1))
        sides[1 - lone_side].extend([np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)])
        cuts.append(np.stack([ab, ac] if lone_side else [ac, ab], axis=1))
    return np.concatenate(sides[0]), np.concatenate(sides[1]), np.concatenate(cuts)


def _flat(triangles: FloatArray, height_m: float, material: Material, terrain: Terrain) -> Soup:
    """Triangles of the map laid on the hills."""
    points = np.stack([triangles[..., 0], np.full(triangles.shape[:2], -height_m), triangles[..., 1]], axis=-1)
    return soup_of(terrain.lifted(points), material, triangles[..., :2] / TILE_M[material.texture])


def _painted(soup: Soup, triangles: FloatArray, roads: Roads) -> Soup:
    """Lane markings, cracks, patches and zebra crossings laid over the carriageway; nothing on junctions."""
    along_m, right_m, street, allowed = (
        column.reshape(-1, 3) for column in roads.lane(triangles[..., :2].reshape(-1, 2))
    )
    across = right_m / PAINT_WIDTH_M + 0.5
    paint_uv = np.stack([across, along_m / TILE_M[Texture.ROAD_PAINT]], axis=-1)
    paint = np.where(allowed.all(axis=-1), int(Texture.ROAD_PAINT), soup.paint)
    for number, start_m in roads.zebras():
        past_m = along_m - start_m
        on = (street == number).all(axis=-1) & ((past_m > 0) & (past_m < ZEBRA_M)).any(axis=-1)
        paint_uv[on, :, 1] = past_m[on] / TILE_M[Texture.ZEBRA]
        paint[on] = int(Texture.ZEBRA)
    return replace(soup, paint_uv=paint_uv, paint=paint)


def _kerb_faces(cuts: FloatArray, terrain: Terrain) -> Soup:
    """The upright side of the kerb along the cuts [M, 2, 3]."""
    foot = np.stack([cuts[..., 0], np.zeros(cuts.shape[:2]), cuts[..., 1]], axis=-1)
    top = foot - [0.0, KERB_HEIGHT_M, 0.0]
    first = np.stack([top[:, 0], top[:, 1], foot[:, 1]], axis=1)
    second = np.stack([top[:, 0], foot[:, 1], foot[:, 0]], axis=1)
    corners = terrain.lifted(np.concatenate([first, second]))
    shade = np.concatenate([np.tile([1.0, 1.0, 0.6], (len(first), 1)), np.tile([1.0, 0.6, 0.6], (len(second), 1))])
    return soup_of(corners, KERB, None, shade)
