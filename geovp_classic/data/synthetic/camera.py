"""The camera on the car: its intrinsics, its motion and its sensor."""

import numpy as np
from numpy.random import Generator

from geovp_classic.data.synthetic.manoeuvres import Journey
from geovp_classic.data.synthetic.roads import world_from_vehicle
from geovp_classic.geometry import planar, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

CAMERA_HEIGHT_M = 1.65  # KITTI's


def square_camera(size_px: tuple[int, int]) -> Intrinsics:
    """Return the camera of a square crop of KITTI's image, resized to (width, height)."""
    width_px, height_px = size_px
    focal_lengths = 489 / 256  # in image heights, of KITTI's crop
    return Intrinsics(
        focal_lengths * width_px,
        focal_lengths * height_px,
        (width_px - 1) / 2,
        (height_px - 1) / 2,
        width_px,
        height_px,
    )


def full_camera(size_px: tuple[int, int]) -> Intrinsics:
    """Return the camera of the uncropped image; `square_camera` sees its middle."""
    width_px, height_px = size_px
    extra_px = round(width_px * (1242 / 375 - 1) / 2)  # KITTI's aspect ratio
    square = square_camera(size_px)
    return square.cropped(-extra_px, 0, width_px + 2 * extra_px, height_px)


def right_from_left() -> FloatArray:
    """Return the transform [4, 4] from the left to the right camera, 0.54 m apart (KITTI's)."""
    return se3.compose(np.eye(3), np.array([-0.54, 0.0, 0.0]))


def world_from_camera(
    ego: Journey,
    times_s: FloatArray,  # [T]
    seed: int,
    pitch_deg: float,
    roll_deg: float,
    bounce: float,
) -> FloatArray:
    """Return world_from_cam [T, 4, 4] of the camera, CAMERA_HEIGHT_M above the road.

    The car pitches, rolls and heaves at 0.8 to 2.2 Hz while it moves, and pitches when it brakes.
    `bounce` scales this motion.
    """
    delays_s = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])[:, None]
    travelled_m = ego.speed.travelled_m(times_s + delays_s)  # [5, T]
    speed_m_s = (travelled_m[3] - travelled_m[1]) / 0.2
    acceleration_m_s2 = (
        travelled_m[4] - 2 * travelled_m[2] + travelled_m[0]
    ) / 0.04
    amplitude = bounce * np.clip(speed_m_s / 8.0, 0.0, 1.2)
    rng = np.random.default_rng([seed, 7])
    pitch, roll, heave = (
        amplitude * _waves(rng, times_s, 0.8, 2.2) for _ in range(3)
    )
    body_from_rest = np.zeros((len(times_s), 6))
    body_from_rest[:, 1] = 0.008 * heave - CAMERA_HEIGHT_M
    body_from_rest[:, 3] = 0.0022 * pitch + bounce * 0.004 * acceleration_m_s2
    body_from_rest[:, 5] = 0.0016 * roll
    mount = planar.level_vehicle_from_cam(
        np.deg2rad(pitch_deg), np.deg2rad(roll_deg)
    )
    world_from_rest = world_from_vehicle(*ego.place_at(times_s))
    return world_from_rest @ se3.exp(body_from_rest) @ mount


def expose(
    light: FloatArray,  # [T, H, W, 3], linear
    canvas_px: int,
    rng: Generator,
    noise: float,
    exposure_drift: float,
) -> ByteArray:
    """Return images [T, H, W, 3] with noise (in grey levels) and drifting exposure (a fraction).

    The noise is drawn for images `canvas_px` wide. A crop therefore has the noise of the whole.
    """
    num_frames, height_px, width_px, _ = light.shape
    times_s = np.arange(num_frames) * 0.1
    gain = np.exp(exposure_drift * _waves(rng, times_s, 0.1, 0.5))
    grain = rng.standard_normal(
        (num_frames, height_px, canvas_px, 3), dtype=np.float32
    )
    left_px = (canvas_px - width_px) // 2
    grain = grain[:, :, left_px : left_px + width_px]
    image = 255 * np.sqrt(np.clip(light * gain[:, None, None, None], 0.0, 1.0))
    return np.clip(image + noise * grain + 0.5, 0, 255).astype(np.uint8)


def _waves(
    rng: Generator,
    times_s: FloatArray,
    min_hz: float,
    max_hz: float,
    num_waves: int = 4,
) -> FloatArray:
    """Return a wandering signal [T] of about unit variance."""
    frequencies_hz = rng.uniform(min_hz, max_hz, num_waves)
    phases_rad = rng.uniform(0, 2 * np.pi, num_waves)
    waves = np.sin(2 * np.pi * np.outer(times_s, frequencies_hz) + phases_rad)
    return waves.sum(axis=-1) * np.sqrt(2 / num_waves)
