"""Roads, speeds and traffic of each manoeuvre, and the motion of cars along paths.

The manoeuvres are described in manoeuvres.toml.
"""

import enum
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.ndimage import gaussian_filter1d

from geovp_classic.data.synthetic.roads import Path, Roads, from_bends
from geovp_classic.types import FloatArray

LANE_M = 1.65  # from the middle of the road to the middle of a lane


class Manoeuvre(enum.StrEnum):
    """Manoeuvre of the car with the camera."""

    STRAIGHT = "straight"
    LEFT_TURN = "left-turn"
    GENTLE_CURVE = "gentle-curve"
    BRAKE = "brake"
    RIGHT_TURN = "right-turn"
    ACCELERATE = "accelerate"
    WINDING = "winding"
    STAND = "stand"


@dataclass(frozen=True)
class Speed:
    """Speed over time by knots, rounded like that of a driver.

    The speed is constant before the first and after the last knot.
    """

    speeds_m_s: Sequence[float] | FloatArray
    times_s: Sequence[float] | FloatArray = (0.0,)
    tick_s: float = 0.02
    smoothing_s: float = 0.25  # standard deviation

    def travelled_m(self, times_s: FloatArray) -> FloatArray:
        """Return the distance [T] travelled since time 0."""
        including_zero_s = np.append(times_s, 0.0)
        first = np.floor((including_zero_s.min() - 2.0) / self.tick_s)
        last = np.ceil((including_zero_s.max() + 2.0) / self.tick_s)
        ticks_s = np.arange(first, last + 1) * self.tick_s
        speeds = np.interp(ticks_s, self.times_s, self.speeds_m_s)
        speeds = gaussian_filter1d(
            speeds, self.smoothing_s / self.tick_s, mode="nearest"
        )
        steps_m = 0.5 * (speeds[1:] + speeds[:-1]) * self.tick_s
        travelled_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        travelled_m -= np.interp(0.0, ticks_s, travelled_m)
        return np.interp(times_s, ticks_s, travelled_m)


@dataclass(frozen=True)
class Journey:
    """Motion of a vehicle along a path; with negative `right_m` it drives back."""

    path: Path
    speed: Speed
    start_m: float  # along the path at time 0
    right_m: float = LANE_M  # beside the path

    def place_at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places [T, 2] and yaw_rad [T]."""
        travelled_m = self.speed.travelled_m(times_s)
        if self.right_m >= 0:
            return self.path.at(self.start_m + travelled_m, self.right_m)
        place, yaw_rad = self.path.at(self.start_m - travelled_m, self.right_m)
        return place, yaw_rad + np.pi


class Plan(NamedTuple):
    """Roads with the journeys of the car with the camera and of the traffic."""

    roads: Roads
    ego: Journey
    traffic: list[Journey]


def plan(manoeuvre: Manoeuvre, rng: Generator) -> Plan:
    """Return roads and journeys of a manoeuvre."""
    tables = tomllib.loads(FilePath(__file__).with_suffix(".toml").read_text())
    table = tables[manoeuvre]
    if "bends" in table:
        side = rng.choice([-1.0, 1.0])
        bends = [
            (length_m, side * turn_rad) for length_m, turn_rad in table["bends"]
        ]
        roads = Roads([from_bends(bends, easing_m=5.0)])
    else:
        main = from_bends([(560.0, 0.0)], start=(0.0, -200.0))
        cross = from_bends(
            [(520.0, 0.0)], start=(-260.0, 0.0), start_yaw_rad=np.pi / 2
        )
        roads = Roads([main, cross], (200.0, 260.0))
    default = {"speed_m_s": _draw(rng, table["speed_m_s"])}
    ego, *traffic = (
        _journey(rng, roads, **default | journey)
        for journey in table["journeys"]
    )
    if "turn" in table:
        ego = replace(ego, path=_turn(**table["turn"]), right_m=0.0)
    return Plan(roads, ego, traffic)


def _journey(
    rng: Generator,
    roads: Roads,
    speed_m_s: Any,
    start_m: Any,
    profile: Sequence[tuple[float, float]] = ((0.0, 1.0),),
    path: int = 0,
    headway_s: Any = 0.0,
    lane: float = 1,
) -> Journey:
    """Return a journey; numbers given as [low, high] are drawn at random."""
    drawn_m_s = _draw(rng, speed_m_s)
    start_m = _draw(rng, start_m) + _draw(rng, headway_s) * drawn_m_s
    times_s, factors = np.transpose(profile)
    speed = Speed(drawn_m_s * factors, times_s)
    return Journey(roads.paths[path], speed, start_m, lane * LANE_M)


def _draw(rng: Generator, value: Any) -> float:
    """Return a number from a pair [low, high], or the number given."""
    return rng.uniform(*value) if isinstance(value, list) else value


def _turn(side: float, radius_m: float) -> Path:
    """Return a right (1) or left (-1) turn from lane to lane at the crossing, after 80 m."""
    quarter_turn = (radius_m * np.pi / 2, side * np.pi / 2)
    path = from_bends([(80.0, 0.0), quarter_turn, (250.0, 0.0)], easing_m=1.5)
    shift = np.array([LANE_M, -side * LANE_M - path.points[-1, 1]])
    return replace(path, points=path.points + shift)
