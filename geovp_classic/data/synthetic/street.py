"""A furnished street with its traffic and weather, drawn from a seed.

street.toml describes the objects, and manoeuvres.toml roads and traffic of each manoeuvre.
"""

import functools
import itertools
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.random import Generator

from geovp_classic.data.synthetic.roads import (
    Journey,
    Places,
    Roads,
    from_bends,
    world_from_vehicle,
)
from geovp_classic.data.synthetic.solids import Solids, joined
from geovp_classic.data.synthetic.textures import Texture, sample
from geovp_classic.types import BoolArray, FloatArray

TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())
MANOEUVRES: dict[str, Any] = tomllib.loads(Path(__file__).with_name("manoeuvres.toml").read_text())
Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Weather:
    """Sun and sky of a fine day; colours are linear light."""

    to_sun: FloatArray  # [3], unit, world frame
    sun: FloatArray  # [3]
    cloud_shift: FloatArray  # [2], in tiles
    ambient: Rgb = (0.36, 0.42, 0.52)
    zenith: Rgb = (0.16, 0.33, 0.66)
    horizon: Rgb = (0.62, 0.74, 0.86)

    @classmethod
    def drawn(cls, rng: Generator) -> Self:
        """Return a day with the sun 30 to 55 degrees high."""
        elevation_rad = np.deg2rad(rng.uniform(30, 55))
        azimuth_rad = rng.uniform(0, 2 * np.pi)
        warmth = rng.uniform(0, 1)
        level = np.cos(elevation_rad) * np.exp(1j * azimuth_rad)
        to_sun = np.array([level.imag, -np.sin(elevation_rad), level.real])
        sun = np.array([1.45, 1.34 - 0.07 * warmth, 1.17 - 0.18 * warmth])
        return cls(to_sun, sun, cloud_shift=rng.uniform(0, 1, 2))

    def sky_light(self, directions: FloatArray) -> FloatArray:
        """Return the light [N, 3] from unit directions [N, 3].

        The sky is paler at the horizon, with clouds on a flat ceiling and a glow around the sun.
        """
        up = np.maximum(-directions[:, 1:2], 0.0)
        weight = np.exp(-4.0 * up)
        clear = self.horizon * weight + self.zenith * (1 - weight)
        reach = 0.35 / (up + 0.12)
        uv = directions[:, [0, 2]] * reach + self.cloud_shift
        blur = 0.004 * reach[:, 0] ** 2
        cover = sample(Texture.CLOUDS, uv, 0 * uv, blur)[:, :1]
        cover *= np.minimum(1.0, 5.0 * up)  # no clouds in the haze
        towards_sun = np.maximum(directions @ self.to_sun, 0.0)[:, None]
        glow = 0.35 * towards_sun**24 * self.sun
        return clear * (1 - cover) + 0.93 * cover + glow

    def irradiance(self, normal: FloatArray, is_lit: BoolArray, is_leaf: BoolArray) -> FloatArray:
        """Return the light [N, 3] that arrives from sun and sky; leaves also let it through."""
        cosine = normal @ self.to_sun
        up = -normal[:, 1]
        direct = np.where(is_leaf, 0.25 + 0.5 * cosine, cosine)
        direct = np.maximum(direct, 0.0) * is_lit
        from_sky = np.where(is_leaf, 0.6 + 0.4 * up, 0.75 + 0.25 * up)
        return direct[:, None] * self.sun + from_sky[:, None] * self.ambient


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
def build_street(seed: int, manoeuvre: str, has_plain_road: bool = False) -> Street:
    """Return the street for a manoeuvre, furnished for 230 m."""
    rng = np.random.default_rng([seed, list(MANOEUVRES).index(manoeuvre)])
    roads, (ego, *others) = plan(manoeuvre, rng)
    roads = replace(roads, is_plain=has_plain_road)
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
    tints = {name: rng.choice(choices) for name, choices in TABLES["tints"].items()}
    solids = []
    for shape in _tree(rng) if name == "tree" else TABLES["models"][name]:
        low, high = shape["low"], shape["high"]
        world_from_local = np.diag([*np.subtract(high, low), 1.0])
        world_from_local[:3, 3] = low[0], -high[1], low[2]
        paint = shape["paint"] * (3 // len(shape["paint"]))
        textures = [Texture[texture.upper()] for texture, _ in paint]
        surface_tints = [tints[tint] for _, tint in paint]
        taper = shape.get("taper", [0.0] * 4)
        is_round = shape.get("round", False)
        solids.append((world_from_local, taper, is_round, textures, surface_tints))
    return Solids(*map(np.array, zip(*solids, strict=True)))


def _tree(rng: Generator) -> list[dict[str, Any]]:
    """Return a trunk with a crown of 24 lumps, rounder or taller from tree to tree."""
    height_m = rng.uniform(5.5, 10.5)
    crown_m = height_m * rng.uniform(0.22, 0.32) * np.array([1, 1.1, 1])
    middle_m = [0, height_m - crown_m[1], 0]
    trunk_m = 0.022 * height_m * np.array([1, 35, 1])
    ellipsoids = [(0 * trunk_m, trunk_m, ("plaster", "bark"))]
    for _ in range(24):
        out_m = rng.normal(size=3)
        out_m *= crown_m * rng.uniform(0.3, 0.85) / np.linalg.norm(out_m)
        radii_m = crown_m * rng.uniform(0.25, 0.45) * rng.uniform(0.8, 1.2, 3)
        ellipsoids.append((middle_m + out_m, radii_m, ("leaves", "greens")))
    return [
        {"low": at - radii, "high": at + radii, "paint": [paint], "round": True}
        for at, radii, paint in ellipsoids
    ]


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
                or roads.locate(places)[-1].min() < from_kerb_m - 0.3
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
