"""What stands along the roads: houses, trees, hedges, parked cars, lamps, signs, and the hills behind them."""

from __future__ import annotations

import functools

import numpy as np

from geovp_classic.data.synthetic import buildings, plants, vehicles
from geovp_classic.data.synthetic.ground import KERB_HEIGHT_M, Roads
from geovp_classic.data.synthetic.mesh import Builder, Material, Soup, cylinder, disc, joined, loft
from geovp_classic.data.synthetic.paths import Path, Terrain
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.types import FloatArray

STEEL = Material(Texture.PLAIN, (0.50, 0.52, 0.53))
DARK_STEEL = Material(Texture.PLAIN, (0.22, 0.25, 0.24))
NEAR_M = 110.0  # things nearer to the drive than this are worth drawing


def draw_car(rng: np.random.Generator) -> Soup:
    """A random car, its origin on the ground below its middle."""
    kind = str(rng.choice(["hatchback", "hatchback", "saloon", "saloon", "van"]))
    return vehicles.car(kind, vehicles.PAINTS[rng.integers(len(vehicles.PAINTS))])


def furnish(roads: Roads, terrain: Terrain, seen: FloatArray, route: Path, rng: np.random.Generator) -> Soup:
    """Everything beside the roads near the places [K, 2] that the drive passes."""
    plot = _Plot(roads, terrain, seen, route, rng)
    for path in roads.paths:
        for side in (-1.0, 1.0):
            plot.houses(path, side)
            plot.parked_cars(path, side)
            plot.trees(path, side)
            plot.lamps(path, side)
    plot.woods()
    return joined(plot.soups)


class _Plot:
    """Puts things on free places of the map."""

    def __init__(self, roads: Roads, terrain: Terrain, seen: FloatArray, route: Path, rng: np.random.Generator) -> None:
        self.roads, self.terrain, self.seen, self.route, self.rng = roads, terrain, seen, route, rng
        self.soups: list[Soup] = []
        self.taken: list[tuple[FloatArray, float]] = []
        self.trees_near = [plants.broadleaf(rng, float(height_m), 2) for height_m in rng.uniform(6.5, 10.5, 5)]
        self.trees_far = [plants.broadleaf(rng, float(height_m), 1) for height_m in rng.uniform(8, 13, 4)]
        self.trees_far += [plants.conifer(rng, float(height_m)) for height_m in rng.uniform(7, 12, 2)]

    def houses(self, path: Path, side: float) -> None:
        along_m = float(self.rng.uniform(0, 6))
        while along_m < path.length_m:
            plan = buildings.draw_plan(self.rng)
            setback_m = float(self.rng.uniform(2.5, 6.5))
            middle_m = along_m + plan.width_m / 2
            right_m = side * (self.roads.half_width_m + 2.2 + setback_m)
            place, _ = path.at(middle_m, right_m + side * plan.depth_m / 2)
            radius_m = float(np.hypot(plan.width_m, plan.depth_m)) / 2
            if self._free(place, radius_m * 0.8, plan.depth_m / 2 + 3.4):
                house = buildings.house(plan, self.rng)
                self._put(house, path, middle_m, right_m, side * np.pi / 2)
                self.taken.append((place, radius_m * 0.8))
                if self.rng.random() < 0.6:
                    self._front_hedge(path, middle_m, plan.width_m, side)
                along_m += plan.width_m + float(self.rng.uniform(2.0, 6.0))
            else:
                along_m += 4.0

    def parked_cars(self, path: Path, side: float) -> None:
        along_m = float(self.rng.uniform(0, 10))
        while along_m < path.length_m:
            right_m = side * (self.roads.half_width_m - 1.05)
            place, _ = path.at(along_m, right_m)
            inside = self.roads.distance_m(place[None])[0]
            off_route_m = abs(self.route.locate(place[None])[1][0])
            if self._visible(place) and -1.2 < inside < -0.9 and off_route_m > 1.6 and self._clear(path, along_m):
                self._put(draw_car(self.rng), path, along_m, right_m, 0.0 if side > 0 else np.pi, height_m=0.0)
            along_m += float(self.rng.choice([6.2, 7.0, 13.0, 22.0]))

    def trees(self, path: Path, side: float) -> None:
        along_m = float(self.rng.uniform(0, 12))
        while along_m < path.length_m:
            right_m = side * (self.roads.half_width_m + float(self.rng.choice([1.6, 2.9, 2.9, 3.4])))
            place, _ = path.at(along_m, right_m)
            if self._free(place, 0.5, 1.3):
                kinds = self.trees_near if self._near(place, 45.0) else self.trees_far
                tree = kinds[self.rng.integers(len(kinds) - 2)]  # no fir among street trees
                self._put(
                    tree, path, along_m, right_m, float(self.rng.uniform(0, 6.3)), float(self.rng.uniform(0.7, 1.05))
                )
            elif self._free(place, 0.1, 2.0) and self.rng.random() < 0.5:
                self._put(plants.bush(self.rng, float(self.rng.uniform(0.5, 0.9))), path, along_m, right_m, 0.0)
            along_m += float(self.rng.uniform(8.0, 20.0))

    def lamps(self, path: Path, side: float) -> None:
        start_m = 6.0 if side > 0 else 21.0
        for along_m in np.arange(start_m, path.length_m, 30.0):
            right_m = side * (self.roads.half_width_m + 0.5)
            place, _ = path.at(along_m, right_m)
            if self._visible(place) and 0.3 < self.roads.distance_m(place[None])[0] < 0.8:
                self._put(_lamp(), path, float(along_m), right_m, side * np.pi / 2)
                if self.rng.random() < 0.5:
                    self._put(_sign(self.rng), path, float(along_m) + 7.0, right_m, 0.0 if side > 0 else np.pi)

    def woods(self) -> None:
        """Trees behind the houses."""
        low, high = self.seen.min(axis=0) - 70, self.seen.max(axis=0) + 70
        for place in self.rng.uniform(low, high, (260, 2)):
            if self._free(place, 2.5, 14.0):
                tree = self.trees_far[self.rng.integers(len(self.trees_far))]
                self._stand(tree, place, float(self.rng.uniform(0, 6.3)), float(self.rng.uniform(0.8, 1.3)))
                self.taken.append((place, 2.5))

    def _front_hedge(self, path: Path, middle_m: float, width_m: float, side: float) -> None:
        """A hedge along the pavement, with a gap for the gate."""
        right_m = side * (self.roads.half_width_m + 2.6)
        for start_m in (middle_m - width_m / 2 - 0.5, middle_m + 1.2):
            length_m = width_m / 2 - 0.7
            places, _ = path.at(start_m + np.array([0.0, length_m]), right_m)
            if (self.roads.distance_m(places) > 2.3).all():
                hedge = plants.hedge(self.rng, length_m, float(self.rng.uniform(0.8, 1.5)))
                offset = start_m + (0.0 if side < 0 else length_m)
                self._put(hedge, path, offset, right_m, side * np.pi / 2)

    def _clear(self, path: Path, along_m: float) -> bool:
        """Whether all of a parked car's length is beside a straight kerb."""
        places, _ = path.at(along_m + np.array([-9.0, 9.0]), 0.0)
        return bool((self.roads.distance_m(places) > -self.roads.half_width_m - 0.05).all())

    def _near(self, place: FloatArray, reach_m: float) -> bool:
        """Whether the drive's first 100 m come that near."""
        return bool(np.linalg.norm(self.seen[:12] - place, axis=-1).min() < reach_m)

    def _visible(self, place: FloatArray) -> bool:
        return bool(np.linalg.norm(self.seen - place, axis=-1).min() < NEAR_M)

    def _free(self, place: FloatArray, radius_m: float, from_kerb_m: float) -> bool:
        if not self._visible(place) or self.roads.distance_m(place[None])[0] < from_kerb_m:
            return False
        others = np.array([(*other, other_radius_m) for other, other_radius_m in self.taken]).reshape(-1, 3)
        return bool((np.hypot(*(others[:, :2] - place).T) > radius_m + others[:, 2]).all())

    def _put(
        self,
        soup: Soup,
        path: Path,
        along_m: float,
        right_m: float,
        turn_rad: float,
        scale: float = 1.0,
        height_m: float = KERB_HEIGHT_M,
    ) -> None:
        """Beside a road: turned by `turn_rad` to the right of the road's direction."""
        place, yaw_rad = path.at(along_m, right_m)
        self._stand(soup, place, float(yaw_rad) + turn_rad, scale, height_m)

    def _stand(
        self, soup: Soup, place: FloatArray, yaw_rad: float, scale: float = 1.0, height_m: float = KERB_HEIGHT_M
    ) -> None:
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        ground_m = float(self.terrain.height_m(place))
        world_from_object = np.array(
            [[cos, 0, sin, place[0]], [0, 1, 0, -height_m - ground_m], [-sin, 0, cos, place[1]], [0, 0, 0, 1]]
        )
        self.soups.append(soup.moved(world_from_object, scale))


def skyline(rng: np.random.Generator, centre: FloatArray, terrain: Terrain) -> Soup:
    """Wooded hills all around, 300 to 450 m away."""
    angle = np.linspace(0, 2 * np.pi, 145)
    rings = []
    for radius_m, rise_m, base_m in ((300.0, 3.0, 5.0), (330.0, 7.0, 12.0), (450.0, 14.0, 34.0)):
        waves = sum(np.sin(k * angle + rng.uniform(0, 6.3)) / k**0.7 for k in (2, 3, 5, 8, 13, 21))
        height_m = base_m + rise_m * 0.5 * np.asarray(waves)
        rings.append(
            np.stack([centre[0] + radius_m * np.sin(angle), -height_m, centre[1] + radius_m * np.cos(angle)], -1)
        )
    foot = rings[0] * [1, 0, 1] + [0, 6.0, 0]
    return loft(np.stack([rings[2], rings[1], rings[0], foot]), Material(Texture.WOODS), None, closed=False)


@functools.lru_cache(maxsize=1)
def _lamp() -> Soup:
    """A street lamp; its arm reaches towards -z."""
    builder = Builder()
    builder.add(cylinder((0, 0.2, 0), (0, -5.6, 0), (0.085, 0.055), STEEL))
    builder.add(cylinder((0, -5.55, 0), (0, -5.9, -1.3), (0.045, 0.04), STEEL, 6))
    builder.box((-0.14, -6.02, -1.9), (0.14, -5.86, -1.2), STEEL)
    return builder.soup()


def _sign(rng: np.random.Generator) -> Soup:
    """A round or a square sign on a pole, seen by who comes along +z."""
    builder = Builder()
    builder.add(cylinder((0, 0.2, 0.03), (0, -2.7, 0.03), (0.035, 0.035), STEEL, 6))
    if rng.random() < 0.5:
        builder.add(disc((0, -2.4, 0), 0.32, "z", Material(Texture.SIGN_RING), 16))
    else:
        corners = [(-0.3, -2.7, 0), (0.3, -2.7, 0), (0.3, -2.1, 0), (-0.3, -2.1, 0)]
        builder.quad(corners, Material(Texture.SIGN_BLUE), image=True)
    builder.add(disc((0, -2.4, 0.015), 0.3, "z", STEEL, 16))
    return builder.soup()
