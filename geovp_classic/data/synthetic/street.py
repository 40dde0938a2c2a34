"""The street itself: roads, what stands beside them, what drives on them, and the weather, drawn
from a seed.
"""

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geovp_classic.data.synthetic import objects
from geovp_classic.data.synthetic.drive import Journey, Manoeuvre, plan
from geovp_classic.data.synthetic.mesh import Surfaces, TriangleMesh, joined
from geovp_classic.data.synthetic.roads import (
    HALF_WIDTH_M,
    KERB_HEIGHT_M,
    Path,
    Roads,
    Terrain,
    ground,
    rolling,
)
from geovp_classic.data.synthetic.shading import Weather
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

FURNISHED_M = 230.0  # of the drive
NEAR_M = 110.0  # objects further from the drive than this are left out


@dataclass(frozen=True)
class Street:
    """A street with its traffic; y points down, the datum of heights is y = 0."""

    static: TriangleMesh
    traffic: Sequence[tuple[TriangleMesh, Journey]]
    terrain: Terrain
    weather: Weather
    ego: Journey

    @functools.cached_property
    def surfaces(self) -> Surfaces:
        """What stands still, ready for rays; all clips and cameras of a street share it."""
        return Surfaces(self.static)

    def traffic_at(self, time_s: float) -> list[TriangleMesh]:
        """The moving cars where they are at that time."""
        places = [(mesh, journey.place_at(np.array([time_s]))) for mesh, journey in self.traffic]
        return [mesh.moved(self.terrain.world_from_vehicle(*place)[0]) for mesh, place in places]


def build_street(seed: int, manoeuvre: Manoeuvre) -> Street:
    """The street on which a manoeuvre is driven; the same seed gives the same street."""
    rng = np.random.default_rng([seed, list(Manoeuvre).index(manoeuvre)])
    roads, ego, others = plan(manoeuvre, rng)
    terrain = rolling(rng, steepest=0.025)
    seen = ego.path.at(ego.start_m + np.arange(-20.0, FURNISHED_M, 10.0), ego.right_m)[0]
    furniture = _Furniture(roads, terrain, seen, ego.path, rng).meshes
    static = joined([ground(roads, terrain, seen[2], rng), *furniture])
    traffic = [(objects.car(rng), journey) for journey in others]
    return Street(static, traffic, terrain, _weather(rng), ego)


@dataclass(frozen=True)
class _Furniture:
    """Everything beside the roads near the places [K, 2] that the drive passes."""

    roads: Roads
    terrain: Terrain
    seen: FloatArray
    route: Path
    rng: np.random.Generator
    meshes: list[TriangleMesh] = field(default_factory=list)
    taken: list[tuple[float, float, float]] = field(default_factory=list)  # (x, z, radius)

    def __post_init__(self) -> None:
        """Furnish both sides of every road, then what lies behind."""
        trees = [
            objects.tree(self.rng, height_m, detail)
            for height_m, detail in ((7, 2), (8.5, 1), (10, 2), (11, 1))
        ]
        for path, side in itertools.product(self.roads.paths, (-1.0, 1.0)):
            self.houses(path, side)
            self.parked_cars(path, side)
            for along_m in np.arange(6.0 if side > 0 else 21.0, path.length_m, 30.0):
                place, yaw_rad = path.at(along_m, side * (HALF_WIDTH_M + 0.5))
                if self.free(place, 0.0, 0.3):
                    self.put(objects.lamp(), place, yaw_rad + side * np.pi / 2)
            for along_m in np.cumsum(self.rng.uniform(8.0, 20.0, 60)):
                place, yaw_rad = path.at(
                    along_m, side * (HALF_WIDTH_M + self.rng.choice([1.6, 2.9, 2.9, 3.4]))
                )
                if self.free(place, 0.5, 1.3):
                    tree = trees[self.rng.integers(len(trees))]
                    self.put(
                        tree, place, yaw_rad + self.rng.uniform(0, 6.3), self.rng.uniform(0.7, 1.05)
                    )
        for place in self.rng.uniform(
            self.seen.min(axis=0) - 70, self.seen.max(axis=0) + 70, (260, 2)
        ):
            if self.free(place, 2.5, 14.0):
                self.put(trees[-1], place, self.rng.uniform(0, 6.3), self.rng.uniform(0.7, 1.2))
                self.taken.append((*place, 2.5))

    def houses(self, path: Path, side: float) -> None:
        """Houses in gardens behind the pavement."""
        for along_m in np.cumsum(self.rng.uniform(2.0, 6.0, 200)):
            garden_m = self.rng.uniform(2.5, 6.5)
            front_m = HALF_WIDTH_M + 2.2 + garden_m
            front, yaw_rad = path.at(along_m, side * front_m)
            if self.free(front, 4.0, garden_m + 2.1):
                house, (width_m, depth_m) = objects.house(self.rng, garden_m)
                middle, _ = path.at(along_m, side * (front_m + depth_m / 2))
                radius_m = 0.4 * np.hypot(width_m, depth_m)
                if self.free(middle, radius_m, depth_m / 2 + 3.4):
                    self.put(house, front, yaw_rad + side * np.pi / 2)
                    self.taken.append((*middle, radius_m))

    def parked_cars(self, path: Path, side: float) -> None:
        """Cars along straight kerbs, off the lanes and the drive."""
        for along_m in np.cumsum(self.rng.choice([6.2, 7.0, 13.0, 22.0], 80)):
            place, yaw_rad = path.at(along_m, side * (HALF_WIDTH_M - 1.05))
            middle, _ = path.at(along_m + np.array([-9.0, 9.0]))
            at_kerb = (self.roads.distance_m(middle) > -HALF_WIDTH_M - 0.05).all()
            if (
                at_kerb
                and self.free(place, 0.0, -2.0)
                and abs(self.route.right_m(place[None])[0]) > 1.6
            ):
                self.put(objects.car(self.rng), place, yaw_rad + (1 - side) * np.pi / 2)

    def free(self, place: FloatArray, radius_m: float, from_kerb_m: float) -> bool:
        """Whether an object of that radius at the place [2] is near the drive, off the kerb and
        clear of others.
        """
        others = np.array(self.taken).reshape(-1, 3)
        clear = (np.hypot(*(others[:, :2] - place).T) > radius_m + others[:, 2]).all()
        near = np.linalg.norm(self.seen - place, axis=-1).min() < NEAR_M
        return bool(clear and near and self.roads.distance_m(place[None])[0] >= from_kerb_m)

    def put(
        self, mesh: TriangleMesh, place: FloatArray, yaw_rad: FloatArray | float, scale: float = 1.0
    ) -> None:
        """Stand an object upright at the place [2], on the road or a kerb above it."""
        above_m = KERB_HEIGHT_M if self.roads.distance_m(place[None])[0] > 0 else 0.0
        upright = se3.exp(np.array([0, 0, 0, 0, float(yaw_rad), 0]))[:3, :3]
        self.meshes.append(
            mesh.moved(se3.compose(upright, self.terrain.points(place, above_m)), scale)
        )


def _weather(rng: np.random.Generator) -> Weather:
    """A fine day with the sun 30 to 55 degrees high."""
    height_rad, azimuth_rad, warm = (
        np.deg2rad(rng.uniform(30, 55)),
        rng.uniform(0, 2 * np.pi),
        rng.uniform(0, 1),
    )
    to_sun = [
        np.cos(height_rad) * np.sin(azimuth_rad),
        -np.sin(height_rad),
        np.cos(height_rad) * np.cos(azimuth_rad),
    ]
    sun = [1.45, 1.34 - 0.07 * warm, 1.17 - 0.18 * warm]
    return Weather(
        *(np.array(part, dtype=np.float32) for part in (to_sun, sun, rng.uniform(0, 1, 2)))
    )
