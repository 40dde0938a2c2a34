"""The street itself: roads, what stands beside them, what drives on them, and the weather, drawn from a seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geovp_classic.data.synthetic import furniture
from geovp_classic.data.synthetic.drive import Journey, Manoeuvre, plan
from geovp_classic.data.synthetic.ground import ground
from geovp_classic.data.synthetic.mesh import Soup, joined
from geovp_classic.data.synthetic.paths import Terrain, rolling
from geovp_classic.data.synthetic.shading import Weather

STEEPEST = 0.025
SIGHT_M = 230.0


@dataclass(frozen=True)
class World:
    """A street with its traffic; y points down, the datum of heights is y = 0."""

    static: Soup
    traffic: Sequence[tuple[Soup, Journey]]
    terrain: Terrain
    weather: Weather
    ego: Journey

    def traffic_at(self, time_s: float) -> list[Soup]:
        """The moving cars where they are at that time."""
        when = np.array([time_s])
        return [soup.moved(journey.world_from_vehicle(self.terrain, when)[0]) for soup, journey in self.traffic]


def build_world(seed: int, manoeuvre: Manoeuvre) -> World:
    """The street on which a manoeuvre is driven; the same seed gives the same street."""
    rng = np.random.default_rng([seed, list(Manoeuvre).index(manoeuvre)])
    scheme = plan(manoeuvre, rng)
    terrain = rolling(rng, STEEPEST)
    start = scheme.ego.place_at(np.array([0.0]))[0][0]
    seen = scheme.ego.path.at(scheme.ego.start_m + np.arange(-20.0, SIGHT_M, 10.0), scheme.ego.right_m)[0]
    street = furniture.furnish(scheme.roads, terrain, seen, scheme.ego.path, rng)
    static = joined([ground(scheme.roads, terrain, seen, 60.0), street, furniture.skyline(rng, start, terrain)])
    traffic = [(furniture.draw_car(rng), journey) for journey in scheme.traffic]
    return World(static, traffic, terrain, _weather(rng), scheme.ego)


def _weather(rng: np.random.Generator) -> Weather:
    """A fine day with the sun 30 to 55 degrees high."""
    height_rad, azimuth_rad = np.deg2rad(rng.uniform(30, 55)), rng.uniform(0, 2 * np.pi)
    flat = np.cos(height_rad)
    warm = float(rng.uniform(0.0, 1.0))
    return Weather(
        to_sun=np.array([flat * np.sin(azimuth_rad), -np.sin(height_rad), flat * np.cos(azimuth_rad)]),
        sun=np.array([1.45, 1.34 - 0.07 * warm, 1.17 - 0.18 * warm]),
        sky=np.array([0.36, 0.42, 0.52]),
        zenith=np.array([0.16, 0.33, 0.66]),
        horizon=np.array([0.62, 0.74, 0.86]),
        cloud_shift=rng.uniform(0, 1, 2),
    )
