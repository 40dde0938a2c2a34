"""Roads and traffic of each manoeuvre, as manoeuvres.toml describes them."""

import tomllib
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.random import Generator

from geovp_classic.data.synthetic.roads import Journey, Path, Roads, from_bends

MANOEUVRES: dict[str, Any] = tomllib.loads(
    FilePath(__file__).with_suffix(".toml").read_text()
)


def plan(manoeuvre: str, rng: Generator) -> tuple[Roads, list[Journey]]:
    """Return roads and journeys of a manoeuvre, that of the car with the camera first."""
    table = MANOEUVRES[manoeuvre]
    is_single = len(table["paths"]) == 1
    side = rng.choice([-1.0, 1.0]) if is_single else 1.0
    paths = [from_bends(**path, side=side) for path in table["paths"]]
    default = {"speed_m_s": _draw(rng, table["speed_m_s"])}
    journeys = [
        _journey(rng, paths, **default | journey)
        for journey in table["journeys"]
    ]
    return Roads(paths[:2]), journeys


def _journey(
    rng: Generator,
    paths: Sequence[Path],
    speed_m_s: Any,
    start_m: Any,
    profile: Sequence[tuple[float, float]] = ((0.0, 1.0),),
    path: int = 0,
    headway_s: Any = 0.0,
    lane: float = 1,
    lane_m: float = 1.65,  # from the middle of the road
) -> Journey:
    """Return a journey; numbers given as [low, high] are drawn at random."""
    drawn_m_s = _draw(rng, speed_m_s)
    start_m = _draw(rng, start_m) + _draw(rng, headway_s) * drawn_m_s
    times_s, factors = np.transpose(profile)
    speeds_m_s = drawn_m_s * factors
    return Journey(paths[path], start_m, lane * lane_m, speeds_m_s, times_s)


def _draw(rng: Generator, value: Any) -> float:
    """Return a number from a pair [low, high], or the number given."""
    return rng.uniform(*value) if isinstance(value, list) else value
