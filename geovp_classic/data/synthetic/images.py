"""The images of the textures: every function paints RGBA bytes [SIZE, SIZE, 4]; alpha is the share
of the tint.
"""

import enum
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from geovp_classic.types import ByteArray, FloatArray

IntArray = npt.NDArray[np.integer[Any]]
Colour = tuple[float, float, float]
SIZE, GLASS = 512, (0.87, 0.98, 1.1)
WHITE, DARK, BLACK = (236, 236, 230, 0), (50, 50, 52, 0), (26, 26, 28, 0)  # untinted
# Every image there is; the number is its place in the stack, the name that of its function below.
Texture = enum.IntEnum(
    "Texture",
    "PLAIN ASPHALT ROAD ZEBRA PAVEMENT GRASS PLASTER BRICK PLASTER_WINDOWS BRICK_WINDOWS ROOF "
    "LEAVES "
    "CAR_PAINT CAR_SIDE CAR_END CAR_WINDOW CLOUDS STAINS",
    start=0,
)
# The size of a tile; images that are stretched over a surface once have size 1.
TILE_M = np.ones(len(Texture))
TILE_M[[Texture.ROAD, Texture.ZEBRA, Texture.PLASTER_WINDOWS, Texture.BRICK_WINDOWS]] = (
    18.0,
    6.0,
    5.6,
    5.6,
)
TILE_M[[Texture.PLAIN, Texture.LEAVES, Texture.ROOF, Texture.PAVEMENT]] = 2.0, 3.0, 4.0, 4.0
TILE_M[[Texture.ASPHALT, Texture.GRASS, Texture.PLASTER, Texture.BRICK, Texture.STAINS]] = (
    6.0,
    6.0,
    5.6,
    5.6,
    37.0,
)


def noise(rng: np.random.Generator, slope: float, coarsest: float = 1.0) -> FloatArray:
    """Tileable noise [SIZE, SIZE] of zero mean and unit spread whose amplitude falls as
    frequency**-slope.

    Frequencies are in cycles per tile; those below `coarsest` are left out.
    """
    frequency = np.hypot(fft.fftfreq(SIZE, 1 / SIZE)[:, None], fft.rfftfreq(SIZE, 1 / SIZE)[None])
    gain = np.where(frequency >= coarsest, np.maximum(frequency, 1e-9) ** -slope, 0.0)
    shaped: FloatArray = fft.irfft2(
        fft.rfft2(rng.standard_normal((SIZE, SIZE))) * gain, (SIZE, SIZE)
    )
    return shaped / shaped.std()


def rgba(
    brightness: FloatArray, colour: Colour = (1.0, 1.0, 1.0), alpha: FloatArray | float = 1.0
) -> ByteArray:
    """An image of one colour; brightness and alpha are [SIZE, SIZE], 0 to 1."""
    layers = [
        *(brightness * channel for channel in colour),
        np.broadcast_to(alpha, brightness.shape),
    ]
    return np.asarray(np.clip(np.stack(layers, axis=-1), 0.0, 1.0) * 255 + 0.5, dtype=np.uint8)


def noisy(
    mean: float, *layers: tuple[float, float, float], colour: Colour = (1.0, 1.0, 1.0)
) -> Callable[[np.random.Generator], ByteArray]:
    """A painter of brightness around a mean; each layer of noise has (spread, slope, coarsest)."""
    return lambda rng: rgba(
        mean + np.sum([spread * noise(rng, *kind) for spread, *kind in layers], axis=0), colour
    )


plain = car_paint = noisy(0.93, (0.02, 1.0, 1))
asphalt = noisy(0.46, (0.035, 1.2, 1), (0.04, 0.3, 40))
grass = noisy(1.0, (0.12, 1.3, 1), (0.2, 0.45, 24), colour=(0.37, 0.48, 0.21))
stains = noisy(0.5, (0.16, 1.1, 1))


def road(rng: np.random.Generator) -> ByteArray:
    """18 m of a road, 9.2 m across: asphalt with repairs, cracks, manholes and a dashed centre
    line.
    """
    image = asphalt(rng)
    worn = cv2.GaussianBlur(image, (5, 5), 0)
    for x, y, width, height in rng.integers((0, 0, 40, 40), (450, 450, 160, 160), (6, 4)).tolist():
        cv2.rectangle(worn, (x, y), (x + width, y + height), 3 * (int(rng.integers(85, 108)),), -1)
    image = np.asarray(cv2.addWeighted(image, 0.65, worn, 0.35, 0), dtype=np.uint8)
    for _ in range(7):
        crack = rng.uniform((30, 0), (480, 330)) + rng.normal((0, 9), (4, 3), (22, 2)).cumsum(
            axis=0
        )
        cv2.polylines(image, [crack.astype(np.int32)], False, (72, 72, 74, 255), 2, cv2.LINE_AA)
    for x, y in ((150, 60), (365, 300)):
        cv2.line(image, (0, y + 80), (SIZE, y + 76), (74, 74, 76, 255), 2, cv2.LINE_AA)
        cv2.ellipse(image, (x, y), (20, 10), 0, 0, 360, (78, 75, 72, 255), -1, cv2.LINE_AA)
        cv2.rectangle(image, (252, y - 30), (259, y + 56), (222, 222, 216, 255), -1)
    return image


def zebra(rng: np.random.Generator) -> ByteArray:
    """A zebra crossing: worn stripes along the road, 9.2 m from kerb to kerb."""
    stripe = (np.arange(SIZE) + 48) % 64 < 31
    return rgba(
        np.where(stripe, 0.84, 0.46) * (1 + 0.06 * noise(rng, 0.8) + 0.05 * noise(rng, 0.2, 40))
    )


def _courses(
    rng: np.random.Generator, num: tuple[int, int], spread: float, joint: float, shift: float
) -> FloatArray:
    """Brightness [SIZE, SIZE] of rows of stones, num = (across, down); NaN in the joints, every
    second row shifted.
    """
    down, across = np.mgrid[:SIZE, :SIZE] / SIZE * np.array([num[1], num[0]])[:, None, None]
    row = np.floor(down).astype(int)
    across = across + shift * (row % 2)
    stones = 1 + spread * rng.standard_normal((num[1], num[0]))
    joints = (across % 1 < 0.06) | (down % 1 < joint)
    return np.where(joints, np.nan, stones[row, np.floor(across).astype(int) % num[0]])


def pavement(rng: np.random.Generator) -> ByteArray:
    """Concrete slabs of half a metre."""
    return rgba(
        0.62 * np.nan_to_num(_courses(rng, (8, 8), 0.06, 0.06, 0.0), nan=0.72)
        + 0.03 * noise(rng, 0.7)
    )


def plaster(rng: np.random.Generator) -> ByteArray:
    """A rendered wall, streaked by rain; also bark, when it is tinted brown."""
    streaks = cv2.GaussianBlur(noise(rng, 0.6), (0, 0), sigmaX=2, sigmaY=40)
    return rgba(
        0.86 + 0.025 * noise(rng, 1.4) + 0.02 * streaks / streaks.std() + 0.02 * noise(rng, 0.2, 60)
    )


def brick(rng: np.random.Generator) -> ByteArray:
    """Bricks of 25 x 8 cm with light joints."""
    stones = _courses(rng, (22, 68), 0.13, 0.15, 0.5)
    shade = np.nan_to_num(0.76 * stones, nan=0.72) * (1 + 0.05 * noise(rng, 0.8))
    return rgba(shade, (1.0, 0.96, 0.94), np.where(np.isnan(stones), 0.4, 1.0))


def roof(rng: np.random.Generator) -> ByteArray:
    """Tiles of 25 x 29 cm, each row dark where the next one covers it."""
    slope = (np.arange(SIZE) * 14 / SIZE % 1)[:, None]
    tiles = np.nan_to_num(_courses(rng, (16, 14), 0.09, 0.1, 0.5) * (0.78 + 0.25 * slope), nan=0.62)
    return rgba(0.85 * tiles * (1 + 0.05 * noise(rng, 0.9)))


def plaster_windows(rng: np.random.Generator) -> ByteArray:
    """Two by two bays of 2.8 m: plaster, and windows with shutters."""
    wall = plaster(rng)
    for x, y in (
        (22, 28),
        (186, 28),
        (278, 28),
        (442, 28),
        (22, 284),
        (186, 284),
        (278, 284),
        (442, 284),
    ):
        cv2.rectangle(wall, (x, y), (x + 46, y + 133), (92, 44, 38, 0), -1)
    return _with_windows(rng, wall, 2)


def brick_windows(rng: np.random.Generator) -> ByteArray:
    """Two by two bays of 2.8 m: bricks, and windows of six panes."""
    return _with_windows(rng, brick(rng), 3)


def _with_windows(rng: np.random.Generator, wall: ByteArray, num_rows: int) -> ByteArray:
    """A window with curtains in every quarter of the wall: frame, panes in two
    columns, and sill.
    """
    glass = rgba(np.linspace(0.42, 0.16, SIZE)[:, None] * (1 + 0.25 * noise(rng, 1.4)), GLASS, 0.0)
    for left, top in ((76, 33), (332, 33), (76, 289), (332, 289)):
        right, bottom, curtain = left + 104, top + 123, int(rng.integers(12, 40))
        wall[top:bottom, left:right] = cv2.resize(glass, (104, 123))
        wall[top:bottom, [*range(left, left + curtain), *range(right - curtain, right)]] = (
            168,
            164,
            154,
            0,
        )
        for row in range(num_rows):
            level = top + row * 123 // num_rows
            cv2.rectangle(wall, (left, level), (left + 52, bottom), WHITE, 5)
            cv2.rectangle(wall, (left + 52, level), (right, bottom), WHITE, 5)
        cv2.rectangle(wall, (left, top), (right, bottom), WHITE, 10)
        cv2.rectangle(
            wall, (left - 14, bottom + 6), (right + 14, bottom + 15), (205, 203, 196, 0), -1
        )
    return wall


def leaves(rng: np.random.Generator) -> ByteArray:
    """Overlapping leaves, the upper ones lighter."""
    image = np.full((SIZE, SIZE, 4), (25, 25, 25, 255), dtype=np.uint8)
    for count in range(2600):
        light = 255 * (0.28 + 0.5 * count / 2600 + 0.10 * rng.standard_normal())
        colour = (light * rng.uniform(0.72, 0.95), light, light * rng.uniform(0.3, 0.5), 255)
        place, axes = (
            rng.integers(16, SIZE - 16, 2).tolist(),
            rng.integers((8, 4), (15, 8)).tolist(),
        )
        cv2.ellipse(image, place, axes, float(rng.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA)
        if count % 50 == 0:
            image = np.roll(
                image, rng.integers(0, SIZE, 2), axis=(0, 1)
            )  # so that the tile has no seam
    return image


def car_side(rng: np.random.Generator) -> ByteArray:
    """Doors, handles, a sill and wheel arches; from tail to nose and from the shoulder down to the
    floor.
    """
    image = plain(rng)
    for x in (150, 262, 366):
        cv2.line(image, (x, 20), (x - 6, 440), BLACK, 3, cv2.LINE_AA)
        cv2.rectangle(image, (x + 16, 90), (x + 44, 118), BLACK, -1)
    cv2.rectangle(image, (0, 440), (SIZE, SIZE), DARK, -1)
    for x in (92, 420):
        cv2.ellipse(image, (x, 460), (48, 285), 0, 0, 360, BLACK, -1, cv2.LINE_AA)
    return image


def car_end(rng: np.random.Generator) -> ByteArray:
    """Lamps, plate and bumper: the tail on the left half, the nose on the right."""
    image = plain(rng)
    for x, lamp in ((0, (165, 16, 16, 0)), (256, (240, 242, 248, 0))):
        cv2.rectangle(image, (x + 10, 70), (x + 60, 210), lamp, -1)
        cv2.rectangle(image, (x + 195, 70), (x + 245, 210), lamp, -1)
        cv2.rectangle(image, (x, 345), (x + 255, SIZE), BLACK, -1)
        cv2.rectangle(image, (x + 86, 235), (x + 170, 325), WHITE, -1)
    return image


def car_window(rng: np.random.Generator) -> ByteArray:
    """Dark glass, lighter at the top, in a painted frame."""
    image = plain(rng)
    image[60:470, 40:472] = rgba(
        np.linspace(0.36, 0.10, SIZE)[:, None] + np.zeros(SIZE), GLASS, 0.0
    )[60:470, 40:472]
    return image


def clouds(rng: np.random.Generator) -> ByteArray:
    """Fair-weather clouds; alpha is how much of the sky they hide."""
    return rgba(0.93 + 0.05 * noise(rng, 1.5), alpha=np.clip(0.32 + 0.42 * noise(rng, 1.7), 0, 1))
