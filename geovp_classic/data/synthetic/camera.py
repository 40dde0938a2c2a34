"""The camera on the car: where it sits, how it shakes, and what its sensor adds to the light."""

from __future__ import annotations

import numpy as np

from geovp_classic.data.synthetic.world import World
from geovp_classic.geometry import planar, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

CAMERA_HEIGHT_M = 1.65
FOCAL_HEIGHTS = 489 / 256  # focal length in image heights, as KITTI's cropped to its height
WIDE_ASPECT = 1242 / 375
BASELINE_M = 0.54
NUM_WAVES = 4
SPRINGS_HZ = (0.8, 2.2)  # how cars shake
EXPOSURE_HZ = (0.1, 0.5)  # how exposure wanders


def square_camera(size_px: tuple[int, int]) -> Intrinsics:
    """The camera of a square crop of KITTI's image, resized to (width, height)."""
    width_px, height_px = size_px
    fx_px, fy_px = FOCAL_HEIGHTS * width_px, FOCAL_HEIGHTS * height_px
    return Intrinsics(fx_px, fy_px, (width_px - 1) / 2, (height_px - 1) / 2, width_px, height_px)


def wide_camera(size_px: tuple[int, int]) -> Intrinsics:
    """The camera of the whole image; `square_camera` is its middle, pixel by pixel."""
    square = square_camera(size_px)
    extra_px = round(square.width_px * (WIDE_ASPECT - 1) / 2)
    return square.cropped(-extra_px, 0, square.width_px + 2 * extra_px, square.height_px)


def world_from_camera(
    world: World,
    times_s: FloatArray,  # [T]
    seed: int,
    pitch_deg: float = 0.0,
    roll_deg: float = 0.0,
    bounce: float = 1.0,
) -> FloatArray:
    """world_from_cam [T, 4, 4] of the camera on the car, CAMERA_HEIGHT_M above the road, shaken by `bounce`.

    The car nods while it brakes; on the move it pitches, rolls and heaves at 0.8 to 2.2 Hz.
    """
    world_from_vehicle = world.ego.world_from_vehicle(world.terrain, times_s)
    speed = world.ego.speed
    pace = np.clip((speed.travelled_m(times_s + 0.1) - speed.travelled_m(times_s - 0.1)) / 0.2 / 8.0, 0.0, 1.2)
    rng = np.random.default_rng([seed, 7])
    pitch_rad, roll_rad, heave_m = (
        size * bounce * pace * _waves(rng, times_s, SPRINGS_HZ) for size in (0.0022, 0.0016, 0.008)
    )
    pitch_rad = pitch_rad + bounce * 0.004 * speed.acceleration_m_s2(times_s)
    zero = np.zeros_like(pitch_rad)
    sprung = se3.exp(np.stack([zero, heave_m - CAMERA_HEIGHT_M, zero, pitch_rad, zero, roll_rad], axis=-1))
    mount = planar.level_vehicle_from_cam(np.deg2rad(pitch_deg), np.deg2rad(roll_deg))
    return world_from_vehicle @ sprung @ mount


def exposed(
    light: FloatArray,  # [T, H, W, 3], linear
    canvas_px: int,
    rng: np.random.Generator,
    noise: float,
    exposure_drift: float,
) -> ByteArray:
    """Images [T, H, W, 3] as a sensor takes them.

    `noise` is its spread in bytes; the exposure wanders by the share `exposure_drift`.
    The noise is drawn for an image `canvas_px` wide and cut to its middle, so that a crop has the noise of the whole.
    """
    num_frames, height_px, width_px = light.shape[:3]
    left = (canvas_px - width_px) // 2
    gain = np.exp(exposure_drift * _waves(rng, np.arange(num_frames) * 0.1, EXPOSURE_HZ))
    frames = np.empty(light.shape, dtype=np.uint8)
    for step in range(num_frames):
        image = np.sqrt(np.clip(light[step] * gain[step], 0.0, 1.0)) * 255
        if noise > 0:
            grain = rng.standard_normal((height_px, canvas_px, 3), dtype=np.float32)
            image += noise * grain[:, left : left + width_px]
        frames[step] = np.clip(image + 0.5, 0, 255)
    return frames


def _waves(rng: np.random.Generator, times_s: FloatArray, band_hz: tuple[float, float]) -> FloatArray:
    """A wandering signal [T] of about unit spread."""
    frequencies_hz, phases_rad = rng.uniform(*band_hz, NUM_WAVES), rng.uniform(0, 2 * np.pi, NUM_WAVES)
    return np.sin(2 * np.pi * np.multiply.outer(times_s, frequencies_hz) + phases_rad).sum(-1) * (2 / NUM_WAVES) ** 0.5
