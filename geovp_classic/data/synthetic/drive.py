"""How cars move along paths, which roads, speeds and traffic make up a manoeuvre, and the camera on
the car.
"""

import enum
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from geovp_classic.data.synthetic.roads import Path, Roads, Terrain, from_bends, straight
from geovp_classic.geometry import planar, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

LANE_M = 1.65  # from the middle of the road to the middle of a lane
TICK_S = 0.02
CAMERA_HEIGHT_M = 1.65
FOCAL_HEIGHTS = 489 / 256  # focal length in image heights, as KITTI's cropped to its height
WIDE_ASPECT = 1242 / 375
BASELINE_M = 0.54
NUM_WAVES = 4
SPRINGS_HZ = (0.8, 2.2)  # how cars shake
EXPOSURE_HZ = (0.1, 0.5)  # how exposure wanders


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
    """Speed over time by knots, rounded like a driven car's; constant before the first and after
    the last knot.
    """

    times_s: Sequence[float]
    speeds_m_s: Sequence[float]

    def travelled_m(self, times_s: FloatArray) -> FloatArray:
        """Distance [T] since time 0."""
        start, end = min(0.0, float(np.min(times_s))) - 2.0, max(float(np.max(times_s)), 0.0) + 2.0
        ticks = np.arange(np.floor(start / TICK_S), np.ceil(end / TICK_S) + 1) * TICK_S
        speeds = gaussian_filter1d(
            np.interp(ticks, self.times_s, self.speeds_m_s), 0.25 / TICK_S, mode="nearest"
        )
        travelled = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * TICK_S)])
        return np.interp(times_s, ticks, travelled) - np.interp(0.0, ticks, travelled)


@dataclass(frozen=True)
class Journey:
    """A vehicle's motion: `start_m` along a path at time 0, `right_m` beside it, where negative
    means driving back.
    """

    path: Path
    speed: Speed
    start_m: float
    right_m: float = LANE_M

    def place_at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places [T, 2] and yaw_rad [T]."""
        back = self.right_m < 0
        travelled_m = self.speed.travelled_m(times_s) * (-1.0 if back else 1.0)
        place, yaw_rad = self.path.at(self.start_m + travelled_m, self.right_m)
        return place, yaw_rad + (np.pi if back else 0.0)


def plan(manoeuvre: Manoeuvre, rng: np.random.Generator) -> tuple[Roads, Journey, list[Journey]]:
    """Roads, the journey of the car with the camera, and the traffic."""
    if manoeuvre in (Manoeuvre.LEFT_TURN, Manoeuvre.RIGHT_TURN):
        return _turn(rng, 1.0 if manoeuvre is Manoeuvre.RIGHT_TURN else -1.0)
    if manoeuvre in (Manoeuvre.BRAKE, Manoeuvre.STAND, Manoeuvre.ACCELERATE):
        return _at_junction(manoeuvre, rng)
    return _along(manoeuvre, rng)


def _along(manoeuvre: Manoeuvre, rng: np.random.Generator) -> tuple[Roads, Journey, list[Journey]]:
    """One road: straight, with a gentle curve or winding; a car ahead, others coming."""
    side = float(rng.choice([-1.0, 1.0]))
    speed_m_s, bends = {
        Manoeuvre.STRAIGHT: (12.5, [(460.0, 0.02)]),
        Manoeuvre.GENTLE_CURVE: (9.5, [(72.0, 0.0), (80.0, 1.05), (300.0, -0.3)]),
        Manoeuvre.WINDING: (
            7.5,
            [(66.0, 0.0), (24.0, 0.55), (34.0, -0.95), (30.0, 0.8), (300.0, 0.1 * side)],
        ),
    }[manoeuvre]
    road = from_bends([(length_m, side * turn_rad) for length_m, turn_rad in bends], easing_m=5.0)
    speed_m_s *= float(rng.uniform(0.92, 1.08))
    ego = Journey(road, Speed([0.0, 6.0], [speed_m_s, speed_m_s * 1.05]), 60.0)
    ahead = Journey(road, Speed([0.0], [speed_m_s * 0.97]), 60.0 + 2.1 * speed_m_s)
    gaps_m = [rng.uniform(*gap_m) for gap_m in ((26, 40), (66, 90), (120, 150))]
    oncoming = [
        Journey(road, Speed([0.0], [rng.uniform(8, 12)]), 60.0 + gap_m, -LANE_M) for gap_m in gaps_m
    ]
    return (Roads([road]), ego, [ahead, *oncoming])


def _crossing() -> Roads:
    """Two straight roads that cross on the origin."""
    along, across = straight((0.0, -200.0), 0.0, 560.0), straight((-260.0, 0.0), np.pi / 2, 520.0)
    return Roads([along, across], (200.0, 260.0))


def _turn(rng: np.random.Generator, side: float) -> tuple[Roads, Journey, list[Journey]]:
    """A quarter turn to the right (1) or left (-1) on a crossing, 0.5 to 1.2 s after the start."""
    roads = _crossing()
    radius_m = 7.5 if side > 0 else 10.0
    bend = from_bends(
        [(80.0, 0.0), (radius_m * np.pi / 2, side * np.pi / 2), (250.0, 0.0)], easing_m=1.5
    )
    path = Path(bend.points + np.array([LANE_M, -side * LANE_M - bend.points[-1, 1]]), bend.yaw_rad)
    slow, fast = rng.uniform(5.0, 6.0), rng.uniform(7.0, 8.5)
    speed = Speed([0.0, 1.0, 2.6, 6.0], [fast, slow, slow, 10.0])
    ego = Journey(path, speed, 80.0 - float(rng.uniform(0.5, 1.2)) * fast, 0.0)
    main, cross = roads.paths
    ahead = Journey(cross, Speed([0.0], [8.0]), 260.0 + side * 45.0, side * LANE_M)
    oncoming = Journey(cross, Speed([0.0], [9.0]), 260.0 + side * 75.0, -side * LANE_M)
    waiting = Journey(main, Speed([0.0, 1.5], [2.0, 0.0]), 200.0 + 19.0, -LANE_M)
    return (roads, ego, [ahead, oncoming, waiting])


def _at_junction(
    manoeuvre: Manoeuvre, rng: np.random.Generator
) -> tuple[Roads, Journey, list[Journey]]:
    """Braking to a stop before crossing traffic, standing there, and driving off."""
    roads = _crossing()
    main, cross = roads.paths
    stop_m = 200.0 - 18.0
    first, second = Speed([0.0], [rng.uniform(8, 10)]), Speed([0.0], [rng.uniform(7, 9)])
    from_left = Journey(cross, first, 260.0 - rng.uniform(14, 20))
    from_right = Journey(cross, second, 260.0 + rng.uniform(16, 24), -LANE_M)
    crossing = [from_left, from_right, Journey(cross, first, 260.0 - rng.uniform(38, 46))]
    if manoeuvre is Manoeuvre.BRAKE:
        return (
            roads,
            Journey(main, Speed([0.0, 0.5, 3.4], [11.0, 11.0, 0.0]), stop_m - 21.4),
            crossing,
        )
    if manoeuvre is Manoeuvre.STAND:
        standing = Speed([0.0], [0.0])
        return (
            roads,
            Journey(main, standing, stop_m),
            [*crossing, Journey(main, standing, 218.0, -LANE_M)],
        )
    ego = Journey(main, Speed([0.4, 1.2, 5.0], [0.0, 2.0, 11.0]), stop_m - 11.0)
    leader = Journey(main, Speed([-0.2, 0.6, 5.0], [0.0, 2.2, 12.0]), stop_m + 1.5)
    oncoming = Journey(main, Speed([0.0, 4.0], [1.0, 10.0]), 200.0 + 24.0, -LANE_M)
    return (roads, ego, [leader, oncoming])


def square_camera(size_px: tuple[int, int]) -> Intrinsics:
    """The camera of a square crop of KITTI's image, resized to (width, height)."""
    width, height = size_px
    return Intrinsics(
        FOCAL_HEIGHTS * width,
        FOCAL_HEIGHTS * height,
        (width - 1) / 2,
        (height - 1) / 2,
        width,
        height,
    )


def wide_camera(size_px: tuple[int, int]) -> Intrinsics:
    """The camera of the whole image; `square_camera` is its middle, pixel by pixel."""
    extra_px = round(size_px[0] * (WIDE_ASPECT - 1) / 2)
    return square_camera(size_px).cropped(-extra_px, 0, size_px[0] + 2 * extra_px, size_px[1])


def world_from_camera(
    ego: Journey,
    terrain: Terrain,
    times_s: FloatArray,
    seed: int,
    pitch_deg: float,
    roll_deg: float,
    bounce: float,
) -> FloatArray:
    """world_from_cam [T, 4, 4] of the camera on the car, CAMERA_HEIGHT_M above the road, shaken by
    `bounce`.

    The car nods while it brakes; on the move it pitches, rolls and heaves at 0.8 to 2.2 Hz.
    """
    speed = ego.speed
    pace = np.clip(
        (speed.travelled_m(times_s + 0.1) - speed.travelled_m(times_s - 0.1)) / 0.2 / 8.0, 0.0, 1.2
    )
    rng = np.random.default_rng([seed, 7])
    pitch_rad, roll_rad, heave_m = (
        size * bounce * pace * _waves(rng, times_s, SPRINGS_HZ) for size in (0.0022, 0.0016, 0.008)
    )
    before, here, after = (speed.travelled_m(times_s + shift) for shift in (-0.2, 0.0, 0.2))
    pitch_rad = pitch_rad + bounce * 0.004 * ((after - 2 * here + before) / 0.04)
    zero = np.zeros_like(pitch_rad)
    sprung = se3.exp(
        np.stack([zero, heave_m - CAMERA_HEIGHT_M, zero, pitch_rad, zero, roll_rad], axis=-1)
    )
    mount = planar.level_vehicle_from_cam(np.deg2rad(pitch_deg), np.deg2rad(roll_deg))
    return terrain.world_from_vehicle(*ego.place_at(times_s)) @ sprung @ mount


def expose(
    light: FloatArray, canvas_px: int, rng: np.random.Generator, noise: float, exposure_drift: float
) -> ByteArray:
    """Images [T, H, W, 3] of linear light; noise of a spread in bytes; the exposure wanders by the
    share given.

    The noise is drawn for an image `canvas_px` wide and cut to its middle, so that a crop has the
    noise of the whole.
    """
    left = (canvas_px - light.shape[2]) // 2
    gain = np.exp(exposure_drift * _waves(rng, np.arange(len(light)) * 0.1, EXPOSURE_HZ))
    grain = rng.standard_normal((*light.shape[:2], canvas_px, 3), dtype=np.float32)[
        :, :, left : left + light.shape[2]
    ]
    image = 255 * np.sqrt(np.clip(light * gain[:, None, None, None], 0.0, 1.0)) + noise * grain
    return np.clip(image + 0.5, 0, 255).astype(np.uint8)


def _waves(
    rng: np.random.Generator, times_s: FloatArray, band_hz: tuple[float, float]
) -> FloatArray:
    """A wandering signal [T] of about unit spread."""
    frequencies_hz, phases_rad = (
        rng.uniform(*band_hz, NUM_WAVES),
        rng.uniform(0, 2 * np.pi, NUM_WAVES),
    )
    return (
        np.sin(2 * np.pi * np.multiply.outer(times_s, frequencies_hz) + phases_rad).sum(-1)
        * (2 / NUM_WAVES) ** 0.5
    )
