"""How cars move: along a path at a changing speed; and which roads, speeds and traffic make up a manoeuvre."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from geovp_classic.data.synthetic.ground import Roads
from geovp_classic.data.synthetic.paths import Path, Terrain, from_bends, straight
from geovp_classic.types import FloatArray

LANE_M = 1.65  # from the middle of the road to the middle of a lane
TICK_S = 0.02
QUARTER_RAD = np.pi / 2


class Manoeuvre(enum.StrEnum):
    """What the car with the camera does."""

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
    """Speed over time by knots, rounded like a driven car's; constant before the first and after the last knot."""

    times_s: Sequence[float]
    speeds_m_s: Sequence[float]

    def travelled_m(self, times_s: FloatArray) -> FloatArray:
        """Distance [T] since time 0."""
        start, end = min(0.0, float(np.min(times_s))) - 2.0, max(float(np.max(times_s)), 0.0) + 2.0
        ticks = np.arange(np.floor(start / TICK_S), np.ceil(end / TICK_S) + 1) * TICK_S
        speeds = gaussian_filter1d(np.interp(ticks, self.times_s, self.speeds_m_s), 0.25 / TICK_S, mode="nearest")
        travelled = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * TICK_S)])
        return np.interp(times_s, ticks, travelled) - np.interp(0.0, ticks, travelled)

    def acceleration_m_s2(self, times_s: FloatArray) -> FloatArray:
        """Acceleration [T]."""
        before, here, after = (self.travelled_m(times_s + shift) for shift in (-0.2, 0.0, 0.2))
        return (after - 2 * here + before) / 0.04


@dataclass(frozen=True)
class Journey:
    """A vehicle on its way: `start_m` along a path at time 0, `right_m` beside it."""

    path: Path
    speed: Speed
    start_m: float
    right_m: float = 0.0
    backwards: bool = False  # against the direction of the path

    def place_at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places [T, 2] and yaw_rad [T]."""
        sign = -1.0 if self.backwards else 1.0
        place, yaw_rad = self.path.at(self.start_m + sign * self.speed.travelled_m(times_s), self.right_m)
        return place, yaw_rad + (np.pi if self.backwards else 0.0)

    def world_from_vehicle(self, terrain: Terrain, times_s: FloatArray) -> FloatArray:
        """world_from_vehicle [T, 4, 4]; the origin is on the ground."""
        return terrain.stand(*self.place_at(times_s))


@dataclass(frozen=True)
class Scheme:
    """The roads of a manoeuvre and everything that moves on them."""

    roads: Roads
    ego: Journey
    traffic: Sequence[Journey]


def plan(manoeuvre: Manoeuvre, rng: np.random.Generator) -> Scheme:
    """Roads, the car's journey and the traffic."""
    if manoeuvre in (Manoeuvre.LEFT_TURN, Manoeuvre.RIGHT_TURN):
        return _turn(rng, to_the_right=manoeuvre is Manoeuvre.RIGHT_TURN)
    if manoeuvre in (Manoeuvre.BRAKE, Manoeuvre.STAND, Manoeuvre.ACCELERATE):
        return _at_junction(manoeuvre, rng)
    return _along(manoeuvre, rng)


def _along(manoeuvre: Manoeuvre, rng: np.random.Generator) -> Scheme:
    """One road: straight, with a gentle curve or winding; a car ahead, others coming."""
    side = float(rng.choice([-1.0, 1.0]))
    bends = {
        Manoeuvre.STRAIGHT: [(460.0, 0.02 * side)],
        Manoeuvre.GENTLE_CURVE: [(72.0, 0.0), (80.0, side * 1.05), (300.0, -side * 0.3)],
        Manoeuvre.WINDING: [(66.0, 0.0), (24.0, side * 0.55), (34.0, -side * 0.95), (30.0, side * 0.8), (300.0, 0.1)],
    }[manoeuvre]
    road = from_bends(bends, easing_m=5.0)
    speed_m_s = float({"straight": 12.5, "gentle-curve": 9.5, "winding": 7.5}[manoeuvre] * rng.uniform(0.92, 1.08))
    ego = Journey(road, Speed([0.0, 6.0], [speed_m_s, speed_m_s * 1.05]), start_m=60.0, right_m=LANE_M)
    ahead = Journey(road, Speed([0.0], [speed_m_s * 0.97]), start_m=60.0 + 2.1 * speed_m_s, right_m=LANE_M)
    oncoming = [
        Journey(road, Speed([0.0], [rng.uniform(8, 12)]), start_m=60.0 + gap_m, right_m=-LANE_M, backwards=True)
        for gap_m in (rng.uniform(26, 40), rng.uniform(66, 90), rng.uniform(120, 150))
    ]
    return Scheme(Roads([road]), ego, [ahead, *oncoming])


def _crossing() -> Roads:
    """Two straight roads that cross on the origin."""
    return Roads([straight((0.0, -200.0), 0.0, 560.0), straight((-260.0, 0.0), QUARTER_RAD, 520.0)])


def _turn(rng: np.random.Generator, to_the_right: bool) -> Scheme:
    """A quarter turn on a crossing; the turn begins 0.5 to 1.2 s after the start."""
    roads = _crossing()
    sign = 1.0 if to_the_right else -1.0
    radius_m = 7.5 if to_the_right else 10.0
    bend = from_bends([(80.0, 0.0), (radius_m * QUARTER_RAD, sign * QUARTER_RAD), (250.0, 0.0)], easing_m=1.5)
    path = bend.shifted(np.array([LANE_M, -sign * LANE_M - bend.points[-1, 1]]))
    slow, fast = float(rng.uniform(5.0, 6.0)), float(rng.uniform(7.0, 8.5))
    speed = Speed([0.0, 1.0, 2.6, 6.0], [fast, slow, slow, 10.0])
    ego = Journey(path, speed, start_m=80.0 - float(rng.uniform(0.5, 1.2)) * fast)
    main, side = roads.paths
    traffic = [
        Journey(
            side, Speed([0.0], [8.0]), start_m=260.0 + sign * 45.0, right_m=sign * LANE_M, backwards=not to_the_right
        ),
        Journey(side, Speed([0.0], [9.0]), start_m=260.0 + sign * 75.0, right_m=-sign * LANE_M, backwards=to_the_right),
        Journey(main, Speed([0.0, 1.5], [2.0, 0.0]), start_m=200.0 + 19.0, right_m=-LANE_M, backwards=True),
    ]
    return Scheme(roads, ego, traffic)


def _at_junction(manoeuvre: Manoeuvre, rng: np.random.Generator) -> Scheme:
    """Braking to a stop before crossing traffic, standing there, and driving off."""
    roads = _crossing()
    main, side = roads.paths
    stop_m = 200.0 - 18.0
    first, second = float(rng.uniform(8, 10)), float(rng.uniform(7, 9))
    left_to_right = Journey(side, Speed([0.0], [first]), start_m=260.0 - rng.uniform(14, 20), right_m=LANE_M)
    right_to_left = Journey(
        side, Speed([0.0], [second]), start_m=260.0 + rng.uniform(16, 24), right_m=-LANE_M, backwards=True
    )
    follower = Journey(side, Speed([0.0], [first]), start_m=260.0 - rng.uniform(38, 46), right_m=LANE_M)
    if manoeuvre is Manoeuvre.BRAKE:
        ego = Journey(main, Speed([0.0, 0.5, 3.4], [11.0, 11.0, 0.0]), start_m=stop_m - 21.4, right_m=LANE_M)
        return Scheme(roads, ego, [left_to_right, right_to_left, follower])
    if manoeuvre is Manoeuvre.STAND:
        ego = Journey(main, Speed([0.0], [0.0]), start_m=stop_m, right_m=LANE_M)
        waiting = Journey(main, Speed([0.0], [0.0]), start_m=200.0 + 18.0, right_m=-LANE_M, backwards=True)
        return Scheme(roads, ego, [left_to_right, right_to_left, follower, waiting])
    ego = Journey(main, Speed([0.4, 1.2, 5.0], [0.0, 2.0, 11.0]), start_m=stop_m - 11.0, right_m=LANE_M)
    leader = Journey(main, Speed([-0.2, 0.6, 5.0], [0.0, 2.2, 12.0]), start_m=stop_m + 1.5, right_m=LANE_M)
    oncoming = Journey(main, Speed([0.0, 4.0], [1.0, 10.0]), start_m=200.0 + 24.0, right_m=-LANE_M, backwards=True)
    return Scheme(roads, ego, [leader, oncoming])
