"""A furnished street with its traffic and weather, drawn from a seed.

street.toml describes the objects, and manoeuvres.toml roads and traffic of each manoeuvre.
"""

import functools
import itertools
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from geovp_classic.data.synthetic.roads import (
    Journey,
    Places,
    Roads,
    from_bends,
    world_from_vehicle,
)
from geovp_classic.data.synthetic.solids import Solids, box_planes, joined
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.data.synthetic.weather import Weather
from geovp_classic.types import FloatArray

TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())
MANOEUVRES: dict[str, Any] = tomllib.loads(
    Path(__file__).with_name("manoeuvres.toml").read_text()
)


@dataclass(frozen=True)
class Street:
    """A street with its traffic; the ground is y = 0, and y points down."""

    static: Solids
    traffic: Sequence[tuple[Solids, Journey]]
    roads: Roads
    weather: Weather
    ego: Journey

    def solids_at(self, time_s: float) -> Solids:
        """Return all solids at a time, those of the traffic last."""
        solids = [self.static]
        for car, journey in self.traffic:
            pose = world_from_vehicle(*journey.place_at(np.array([time_s])))[0]
            solids.append(car.moved(pose))
        return joined(solids)


@functools.lru_cache(maxsize=8)
def build_street(seed: int, manoeuvre: str) -> Street:
    """Return the street for a manoeuvre, furnished for 230 m."""
    rng = np.random.default_rng([seed, list(MANOEUVRES).index(manoeuvre)])
    roads, (ego, *others) = plan(manoeuvre, rng)
    cars = TABLES["rows"][1]["models"]
    traffic = [(model(rng, str(rng.choice(cars))), other) for other in others]
    weather = Weather.drawn(rng)
    along_m = ego.start_m + np.arange(-20.0, 230.0)
    drive, _ = ego.path.at(along_m, ego.right_m)
    centre = world_from_vehicle(drive[:1], np.zeros(1))[0]
    landscape = model(rng, "landscape").moved(centre)
    objects = [landscape, *_furniture(rng, roads, drive)]
    return Street(joined(objects), traffic, roads, weather, ego)


def plan(manoeuvre: str, rng: Generator) -> tuple[Roads, list[Journey]]:
    """Return roads and journeys of a manoeuvre, that of the car with the camera first."""

    def draw(value: Any) -> float:
        return rng.uniform(*value) if isinstance(value, list) else value

    table = MANOEUVRES[manoeuvre]
    is_single = len(table["paths"]) == 1
    side = rng.choice([-1.0, 1.0]) if is_single else 1.0
    paths = [from_bends(**path, side=side) for path in table["paths"]]
    usual_m_s = draw(table["speed_m_s"])
    journeys = []
    for row in table["journeys"]:
        path = paths[row.get("path", 0)]
        speed_m_s = draw(row.get("speed_m_s", usual_m_s))
        start_m = draw(row["start_m"])
        start_m += draw(row.get("headway_s", 0.0)) * speed_m_s
        times_s, factors = np.transpose(row.get("profile", [[0.0, 1.0]]))
        right_m = row.get("lane", 1) * 1.65  # from the middle of the road
        speeds_m_s = speed_m_s * factors
        journeys.append(Journey(path, start_m, right_m, speeds_m_s, times_s))
    return Roads(paths[:2]), journeys


def model(rng: Generator, name: str) -> Solids:
    """Return an object of street.toml at the origin, or a tree."""
    tints = {
        name: rng.choice(choices) for name, choices in TABLES["tints"].items()
    }
    parts = _tree(rng) if name == "tree" else TABLES["models"][name]
    columns = zip(*(_solid(tints, **part) for part in parts), strict=True)
    return Solids(*map(np.array, columns))


def _solid(
    tints: dict[str, FloatArray],
    low: Sequence[float],  # [3], left, foot and rear
    high: Sequence[float],  # [3]
    paint: Sequence[tuple[str, str]],
    taper: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    round: bool = False,
) -> tuple[Any, ...]:
    """Return the fields of one solid."""
    world_from_local = np.diag([*np.subtract(high, low), 1.0])
    world_from_local[:3, 3] = low[0], -high[1], low[2]
    surfaces = [*paint] * (3 // len(paint))
    textures = [Texture[texture.upper()] for texture, _ in surfaces]
    surface_tints = [tints[tint] for _, tint in surfaces]
    return world_from_local, box_planes(taper), round, textures, surface_tints


def _tree(rng: Generator) -> list[dict[str, Any]]:
    """Return a trunk with a crown of 24 lumps, rounder or taller from tree to tree."""
    height_m = rng.uniform(5.5, 10.5)
    crown_m = height_m * rng.uniform(0.22, 0.32) * np.array([1, 1.1, 1])
    middle_m = [0, height_m - crown_m[1], 0]
    trunk_m = 0.022 * height_m * np.array([1, 35, 1])
    parts = [_ellipsoid(0 * trunk_m, trunk_m, "plaster", "bark")]
    for _ in range(24):
        out_m = rng.normal(size=3)
        out_m *= crown_m * rng.uniform(0.3, 0.85) / np.linalg.norm(out_m)
        radii_m = crown_m * rng.uniform(0.25, 0.45) * rng.uniform(0.8, 1.2, 3)
        parts.append(_ellipsoid(middle_m + out_m, radii_m, "leaves", "greens"))
    return parts


def _ellipsoid(
    middle: FloatArray, radii: FloatArray, *paint: str
) -> dict[str, Any]:
    """Return a part of an object as street.toml describes it."""
    corners = {"low": middle - radii, "high": middle + radii}
    return {**corners, "paint": [paint], "round": True}


def _furniture(
    rng: Generator,
    roads: Roads,
    drive: Places,  # [K], places that the camera passes
) -> list[Solids]:
    """Return the objects beside the roads; none overlaps another or reaches over its kerb."""
    objects = []
    occupied = np.empty((0, 2), complex)  # place and radius
    rows = TABLES["rows"]
    for path, row, side in itertools.product(roads.paths, rows, (-1.0, 1.0)):
        radius_m = row.get("radius_m", 0.3)
        around_m = row.get("kerb_m", 0.0) * np.array([0.0, -1.0, 1.0])
        low_m, high_m = row["step_m"]
        for along_m in np.cumsum(rng.uniform(low_m, high_m, 200)):
            from_kerb_m = rng.uniform(*row["from_kerb_m"])
            right_m = side * (roads.half_width_m + from_kerb_m)
            places, yaw_rad = path.at(along_m + around_m, right_m)
            from_drive_m = np.abs(drive - places[0]).min()
            gaps_m = np.abs(occupied[:, 0] - places[0]) - occupied[:, 1].real
            if (
                not 1.7 < from_drive_m < 110.0
                or (gaps_m < radius_m).any()
                or roads.distance_m(places).min() < from_kerb_m - 0.3
            ):
                continue
            occupied = np.vstack([occupied, [places[0], radius_m]])
            is_parked = from_kerb_m < 0
            turn_rad = 0.5 * np.pi * side - 0.5 * np.pi * is_parked
            pose = world_from_vehicle(places[:1], yaw_rad[:1] + turn_rad)[0]
            pose[:3, :3] *= row.get("scale", 1.0)
            name = str(rng.choice(row["models"]))
            objects.append(model(rng, name).moved(pose))
    return objects
