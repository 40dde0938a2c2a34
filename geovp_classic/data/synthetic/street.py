"""A furnished street with its traffic and weather, drawn from a seed."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from geovp_classic.data.synthetic import objects
from geovp_classic.data.synthetic.manoeuvres import Journey, Manoeuvre, plan
from geovp_classic.data.synthetic.mesh import TriangleMesh, joined
from geovp_classic.data.synthetic.ray_casting import RayCaster
from geovp_classic.data.synthetic.roads import Path, Roads
from geovp_classic.data.synthetic.shading import Weather
from geovp_classic.data.synthetic.terrain import Terrain, ground, rolling_hills
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Street:
    """A street with its traffic; y points down, and heights are relative to y = 0."""

    static: TriangleMesh
    traffic: Sequence[tuple[TriangleMesh, Journey]]
    terrain: Terrain
    weather: Weather
    ego: Journey

    @functools.cached_property
    def ray_caster(self) -> RayCaster:
        """Return the static mesh, ready for rays."""
        return RayCaster(self.static)

    def traffic_at(self, time_s: float) -> list[TriangleMesh]:
        """Return the moving cars at a time."""
        meshes = []
        for mesh, journey in self.traffic:
            places, yaw_rad = journey.place_at(np.array([time_s]))
            world_from_car = self.terrain.world_from_vehicle(places, yaw_rad)[0]
            meshes.append(mesh.moved(world_from_car))
        return meshes


def build_street(seed: int, manoeuvre: Manoeuvre) -> Street:
    """Return the street for a manoeuvre, furnished for 230 m."""
    rng = np.random.default_rng([seed, list(Manoeuvre).index(manoeuvre)])
    roads, ego, others = plan(manoeuvre, rng)
    terrain = rolling_hills(rng, max_slope=0.025)
    along_m = ego.start_m + np.arange(-20.0, 230.0, 10.0)
    drive, _ = ego.path.at(along_m, ego.right_m)
    furniture = _Furniture(roads, terrain, drive, ego.path, rng)
    furniture.place_all()
    static = joined([ground(roads, terrain, drive[2], rng), *furniture.meshes])
    traffic = [(objects.car(rng), journey) for journey in others]
    return Street(static, traffic, terrain, _weather(rng), ego)


@dataclass(frozen=True)
class _Furniture:
    """The objects beside the roads."""

    roads: Roads
    terrain: Terrain
    drive: FloatArray  # [K, 2], places that the camera passes
    route: Path
    rng: Generator
    max_distance_m: float = 110.0  # from the drive
    meshes: list[TriangleMesh] = field(default_factory=list)
    occupied: list[tuple[float, float, float]] = field(
        default_factory=list
    )  # (x, z, radius)

    def place_all(self) -> None:
        """Furnish both sides of each road, then the land behind."""
        sizes = ((7, 2), (8.5, 1), (10, 2), (11, 1))
        trees = [
            objects.tree(self.rng, height_m, detail)
            for height_m, detail in sizes
        ]
        for path in self.roads.paths:
            for side in (-1.0, 1.0):
                self._place_houses(path, side)
                self._place_parked_cars(path, side)
                for along_m in np.arange(
                    6.0 if side > 0 else 21.0, path.length_m, 30.0
                ):
                    place, to_road_rad = self._beside(path, side, along_m, 0.5)
                    if self._is_free(place, 0.0, 0.3):
                        self._put(objects.lamp(), place, to_road_rad)
                for along_m in np.cumsum(self.rng.uniform(8.0, 20.0, 60)):
                    from_kerb_m = self.rng.choice([1.6, 2.9, 2.9, 3.4])
                    place, _ = self._beside(path, side, along_m, from_kerb_m)
                    if self._is_free(place, 0.5, 1.3):
                        tree = trees[self.rng.integers(len(trees))]
                        self._put_tree(tree, place, 1.05)
        low = self.drive.min(axis=0) - 70
        high = self.drive.max(axis=0) + 70
        for place in self.rng.uniform(low, high, (260, 2)):
            if self._is_free(place, 2.5, 14.0):
                self._put_tree(trees[-1], place, 1.2)
                self.occupied.append((*place, 2.5))

    def _beside(
        self, path: Path, side: float, along_m: float, from_kerb_m: float
    ) -> tuple[FloatArray, float]:
        """Return a place [2] beside the road, and the yaw of an object whose -z faces the road."""
        place, yaw_rad = path.at(
            along_m, side * (self.roads.half_width_m + from_kerb_m)
        )
        return place, float(yaw_rad) + side * np.pi / 2

    def _place_houses(self, path: Path, side: float) -> None:
        """Place houses in gardens behind the pavement."""
        for along_m in np.cumsum(self.rng.uniform(2.0, 6.0, 200)):
            garden_m = self.rng.uniform(2.5, 6.5)
            front, to_road_rad = self._beside(
                path, side, along_m, 2.2 + garden_m
            )
            if not self._is_free(front, 4.0, garden_m + 2.1):
                continue
            house, (width_m, depth_m) = objects.house(self.rng, garden_m)
            middle, _ = self._beside(
                path, side, along_m, 2.2 + garden_m + depth_m / 2
            )
            radius_m = 0.4 * np.hypot(width_m, depth_m)
            if self._is_free(middle, radius_m, depth_m / 2 + 3.4):
                self._put(house, front, to_road_rad)
                self.occupied.append((*middle, radius_m))

    def _place_parked_cars(self, path: Path, side: float) -> None:
        """Place cars along straight kerbs, off the lanes and the drive."""
        for along_m in np.cumsum(self.rng.choice([6.2, 7.0, 13.0, 22.0], 80)):
            place, to_road_rad = self._beside(path, side, along_m, -1.05)
            middle, _ = path.at(along_m + np.array([-9.0, 9.0]))
            is_straight = (
                self.roads.distance_m(middle) > -self.roads.half_width_m - 0.05
            ).all()
            from_route_m = abs(self.route.right_m(place[None])[0])
            if (
                is_straight
                and from_route_m > 1.6
                and self._is_free(place, 0.0, -2.0)
            ):
                self._put(objects.car(self.rng), place, to_road_rad - np.pi / 2)

    def _put_tree(
        self, tree: TriangleMesh, place: FloatArray, max_scale: float
    ) -> None:
        """Add a randomly turned and scaled tree."""
        yaw_rad = self.rng.uniform(0, 6.3)
        self._put(tree, place, yaw_rad, self.rng.uniform(0.7, max_scale))

    def _is_free(
        self, place: FloatArray, radius_m: float, min_from_kerb_m: float
    ) -> bool:
        """Return whether a place [2] is near the drive, off the road and clear of other objects."""
        if self.roads.distance_m(place[None])[0] < min_from_kerb_m:
            return False
        if (
            np.linalg.norm(self.drive - place, axis=-1).min()
            >= self.max_distance_m
        ):
            return False
        x, z, radii_m = np.array(self.occupied).reshape(-1, 3).T
        gaps_m = np.hypot(x - place[0], z - place[1]) - radii_m
        return bool((gaps_m > radius_m).all())

    def _put(
        self,
        mesh: TriangleMesh,
        place: FloatArray,
        yaw_rad: float,
        scale: float = 1.0,
    ) -> None:
        """Add an upright object at a place [2], on the road or a kerb above it."""
        is_on_pavement = self.roads.distance_m(place[None])[0] > 0
        above_m = self.roads.kerb_height_m if is_on_pavement else 0.0
        world_from_object = se3.exp(np.array([0, 0, 0, 0, yaw_rad, 0]))
        world_from_object[:3, 3] = self.terrain.points(place, above_m)
        self.meshes.append(mesh.moved(world_from_object, scale))


def _weather(rng: Generator) -> Weather:
    """Return a fine day with the sun 30 to 55 degrees high."""
    elevation_rad = np.deg2rad(rng.uniform(30, 55))
    azimuth_rad = rng.uniform(0, 2 * np.pi)
    warmth = rng.uniform(0, 1)
    level = np.cos(elevation_rad)
    x = level * np.sin(azimuth_rad)
    z = level * np.cos(azimuth_rad)
    to_sun = np.array([x, -np.sin(elevation_rad), z])
    sun = np.array([1.45, 1.34 - 0.07 * warmth, 1.17 - 0.18 * warmth])
    return Weather(to_sun, sun, cloud_shift=rng.uniform(0, 1, 2))
