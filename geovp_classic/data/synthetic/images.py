"""Painters of the texture images: each returns RGBA bytes [SIZE, SIZE, 4].

Alpha is the fraction of the object's tint that shows; parts with alpha 0 keep their own colour.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.random import Generator
from scipy import fft

from geovp_classic.types import ByteArray, FloatArray

Rgb = tuple[float, float, float]
SIZE = 512  # a power of two
UNTINTED_WHITE = (236, 236, 230, 0)


def noise_of(
    rng: Generator, slope: float, min_frequency: float = 1.0
) -> FloatArray:
    """Return tileable noise [SIZE, SIZE] of zero mean and unit standard deviation.

    The amplitude falls as frequency**-slope. Frequencies are in cycles per tile.
    """
    rows = fft.fftfreq(SIZE, 1 / SIZE)[:, None]
    columns = fft.rfftfreq(SIZE, 1 / SIZE)
    frequency = np.hypot(rows, columns)
    gain = np.maximum(frequency, 1e-9) ** -slope
    gain[frequency < min_frequency] = 0
    white = rng.standard_normal((SIZE, SIZE))
    shaped: FloatArray = fft.irfft2(fft.rfft2(white) * gain, (SIZE, SIZE))
    return shaped / shaped.std()


def rgba(
    brightness: FloatArray,
    colour: Rgb = (1.0, 1.0, 1.0),
    alpha: FloatArray | float = 1.0,
) -> ByteArray:
    """Return an image of one colour; brightness and alpha are [SIZE, SIZE], 0 to 1."""
    red, green, blue = (brightness * channel for channel in colour)
    layers = [red, green, blue, np.broadcast_to(alpha, brightness.shape)]
    image = np.clip(np.stack(layers, axis=-1), 0.0, 1.0)
    return np.asarray(image * 255 + 0.5, dtype=np.uint8)


def paint(name: str, table: dict[str, Any], rng: Generator) -> ByteArray:
    """Paint a texture of textures.toml."""
    painters = [road, zebra, pavement, plaster, brick, roof, leaves, clouds]
    painters += [plaster_windows, brick_windows, car_window]
    by_name = {painter.__name__: painter for painter in painters}
    image = by_name[name](rng) if name in by_name else even(rng, **table)
    for shape in table.get("shapes", []):
        _draw(image, **shape)
    return image


def even(
    rng: Generator,
    noise: Sequence[tuple[float, float, float]] = ((0.02, 1.0, 1.0),),
    brightness: float = 1.0,
    colour: Rgb = (1.0, 1.0, 1.0),
    **_: Any,
) -> ByteArray:
    """Paint one colour with layers of noise."""
    layers = [
        amplitude * noise_of(rng, *spectrum) for amplitude, *spectrum in noise
    ]
    return rgba(brightness + np.sum(layers, axis=0), colour)


def clouds(rng: Generator) -> ByteArray:
    """Paint fair-weather clouds; alpha is the fraction of the sky that they hide."""
    brightness = 0.93 + 0.05 * noise_of(rng, 1.5)
    cover = np.clip(0.32 + 0.42 * noise_of(rng, 1.7), 0, 1)
    return rgba(brightness, alpha=cover)


def road(rng: Generator) -> ByteArray:
    """Paint asphalt with repairs and cracks."""
    image = even(rng, [(0.035, 1.2, 1), (0.04, 0.3, 40)], 0.46)
    for x, y, width, height in rng.integers(
        (0, 0, 40, 40), (450, 450, 160, 160), (6, 4)
    ):
        repair = image[y : y + height, x : x + width]
        repair[:] = 0.65 * repair + 0.35 * rng.integers(85, 108)
    for _ in range(7):
        start = rng.uniform((30, 0), (480, 330))
        crack = start + rng.normal((0, 9), (4, 3), (22, 2)).cumsum(axis=0)
        cv2.polylines(
            image,
            [crack.astype(np.int32)],
            False,
            (72, 72, 74, 255),
            2,
            cv2.LINE_AA,
        )
    return image


def zebra(rng: Generator) -> ByteArray:
    """Paint a zebra crossing: worn stripes along the road, 9.2 m from kerb to kerb."""
    is_stripe = (np.arange(SIZE) + 48) % 64 < 31
    wear = 1 + 0.06 * noise_of(rng, 0.8) + 0.05 * noise_of(rng, 0.2, 40)
    return rgba(np.where(is_stripe, 0.84, 0.46) * wear)


def pavement(rng: Generator) -> ByteArray:
    """Paint concrete slabs of half a metre."""
    slabs, is_joint = _stone_courses(rng, (8, 8), 0.06, joint=0.06, shift=0.0)
    slabs[is_joint] = 0.72
    return rgba(0.62 * slabs + 0.03 * noise_of(rng, 0.7))


def plaster(rng: Generator) -> ByteArray:
    """Paint a rendered wall with streaks of rain; tinted brown, it serves as bark."""
    streaks = cv2.GaussianBlur(noise_of(rng, 0.6), (0, 0), sigmaX=2, sigmaY=40)
    brightness = (
        0.86 + 0.025 * noise_of(rng, 1.4) + 0.02 * streaks / streaks.std()
    )
    return rgba(brightness + 0.02 * noise_of(rng, 0.2, 60))


def brick(rng: Generator) -> ByteArray:
    """Paint bricks of 25 x 8 cm with light joints."""
    stones, is_joint = _stone_courses(
        rng, (22, 68), 0.13, joint=0.15, shift=0.5
    )
    shade = np.where(is_joint, 0.72, 0.76 * stones) * (
        1 + 0.05 * noise_of(rng, 0.8)
    )
    return rgba(shade, (1.0, 0.96, 0.94), np.where(is_joint, 0.4, 1.0))


def roof(rng: Generator) -> ByteArray:
    """Paint tiles of 25 x 29 cm, each row dark where the next one covers it."""
    tiles, is_joint = _stone_courses(rng, (16, 14), 0.09, joint=0.1, shift=0.5)
    slope = (np.arange(SIZE) * 14 / SIZE % 1)[:, None]
    tiles = np.where(is_joint, 0.62, tiles * (0.78 + 0.25 * slope))
    return rgba(0.85 * tiles * (1 + 0.05 * noise_of(rng, 0.9)))


def plaster_windows(rng: Generator) -> ByteArray:
    """Paint two by two bays of 2.8 m: plaster, and windows with shutters."""
    wall = plaster(rng)
    for left, top in _windows():
        for shutter in (left - 54, left + 110):
            wall[top - 5 : top + 129, shutter : shutter + 47] = (92, 44, 38, 0)
    return _with_windows(rng, wall, num_rows=2)


def brick_windows(rng: Generator) -> ByteArray:
    """Paint two by two bays of 2.8 m: bricks, and windows of six panes."""
    return _with_windows(rng, brick(rng), num_rows=3)


def leaves(rng: Generator) -> ByteArray:
    """Paint overlapping leaves, the upper ones lighter."""
    image = np.full((SIZE, SIZE, 4), (25, 25, 25, 255), dtype=np.uint8)
    for count in range(2600):
        light = 255 * (0.28 + 0.5 * count / 2600 + 0.10 * rng.standard_normal())
        red = light * rng.uniform(0.72, 0.95)
        colour = (red, light, light * rng.uniform(0.3, 0.5), 255)
        place = rng.integers(16, SIZE - 16, 2).tolist()
        axes = rng.integers((8, 4), (15, 8)).tolist()
        angle_deg = rng.uniform(0, 180)
        cv2.ellipse(
            image, place, axes, angle_deg, 0, 360, colour, -1, cv2.LINE_AA
        )
        if count % 50 == 0:  # shift the border, so that the tile has no seam
            image = np.roll(image, rng.integers(0, SIZE, 2), axis=(0, 1))
    return image


def car_window(rng: Generator) -> ByteArray:
    """Paint dark glass, lighter at the top, in a painted frame."""
    image = even(rng, brightness=0.93)
    glass = _glass(np.linspace(0.36, 0.10, SIZE)[:, None] + np.zeros(SIZE))
    image[60:470, 40:472] = glass[60:470, 40:472]
    return image


def _draw(
    image: ByteArray,
    kind: str,
    at: Sequence[int],
    colour: Sequence[int],
    width: int = -1,
) -> None:
    """Draw a shape on an image."""
    first = at[:2]
    second = at[2:]
    match kind:
        case "rectangle":
            cv2.rectangle(image, first, second, colour, width)
        case "line":
            cv2.line(image, first, second, colour, width, cv2.LINE_AA)
        case "ellipse":
            cv2.ellipse(
                image, first, second, 0, 0, 360, colour, width, cv2.LINE_AA
            )


def _glass(brightness: FloatArray) -> ByteArray:
    """Return untinted bluish glass."""
    return rgba(brightness, (0.87, 0.98, 1.1), 0.0)


def _stone_courses(
    rng: Generator,
    num: tuple[int, int],  # stones across and down
    spread: float,  # standard deviation of their brightness
    joint: float,  # thickness of the bed joints in stone heights
    shift: float,  # of every second row, in stone widths
) -> tuple[FloatArray, FloatArray]:
    """Return the brightness of rows of stones and the mask of joints, each [SIZE, SIZE]."""
    num_across, num_down = num
    rows, columns = np.mgrid[:SIZE, :SIZE] / SIZE
    down = rows * num_down
    row = np.floor(down).astype(int)
    across = columns * num_across + shift * (row % 2)
    column = np.floor(across).astype(int) % num_across
    stones = 1 + spread * rng.standard_normal((num_down, num_across))
    is_joint = (across % 1 < 0.06) | (down % 1 < joint)
    return stones[row, column], is_joint


def _windows() -> list[tuple[int, int]]:
    """Return the left and top pixels of the windows of 2 x 2 bays."""
    return [(left, top) for top in (33, 289) for left in (76, 332)]


def _with_windows(rng: Generator, wall: ByteArray, num_rows: int) -> ByteArray:
    """Paint windows with frames, curtains, sills and two columns of panes on a wall."""
    width = 104
    height = 123
    brightness = np.linspace(0.42, 0.16, SIZE)[:, None] * (
        1 + 0.25 * noise_of(rng, 1.4)
    )
    glass = cv2.resize(_glass(brightness), (width, height))
    for left, top in _windows():
        right = left + width
        bottom = top + height
        window = wall[top:bottom, left:right]
        curtain = int(rng.integers(12, 40))
        window[:] = glass
        window[:, :curtain] = window[:, -curtain:] = (168, 164, 154, 0)
        for row in range(num_rows):
            level = top + row * height // num_rows
            cv2.rectangle(
                wall, (left, level), (left + 52, bottom), UNTINTED_WHITE, 5
            )
            cv2.rectangle(
                wall, (left + 52, level), (right, bottom), UNTINTED_WHITE, 5
            )
        cv2.rectangle(wall, (left, top), (right, bottom), UNTINTED_WHITE, 10)
        wall[bottom + 6 : bottom + 16, left - 14 : right + 15] = (
            205,
            203,
            196,
            0,
        )
    return wall
