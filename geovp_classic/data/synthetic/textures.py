"""Painted textures, and their colours averaged over the footprints of pixels.

Textures are RGBA images in display brightness, described in textures.toml. Alpha is 0 where the
tint of an object does not apply.
"""

import enum
import functools
import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np
from numpy.random import Generator
from scipy import fft

from geovp_classic.types import ByteArray, FloatArray, IntArray

SIZE = 512  # of the images, a power of two
TABLES: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())
Texture = enum.IntEnum(
    "Texture",
    "GROUND PLAIN ASPHALT ROAD KERB PAVEMENT GRASS ZEBRA HILLS PLASTER "
    "BRICK PLASTER_WINDOWS BRICK_WINDOWS ROOF LEAVES CAR_SIDE BONNET_SIDE "
    "CAR_TAIL CAR_NOSE WINDSCREEN SIDE_WINDOWS WHEEL CLOUDS STAINS PLAIN_ROAD",
    start=0,
)


def column(name: str, default: Any) -> FloatArray:
    """Return a property of all textures, [textures] or [textures, K]."""
    return np.array([table.get(name, default) for table in TABLES.values()])


TILE_M = column("tile_m", [np.nan] * 2)  # NaN: the image covers a surface once


def _noise(rng: Generator, slope: float, min_frequency: float) -> FloatArray:
    """Return tileable noise [SIZE, SIZE] of zero mean and unit standard deviation.

    The amplitude falls as frequency**-slope. Frequencies are in cycles per tile.
    """
    rows = fft.fftfreq(SIZE, 1 / SIZE)[:, None]
    frequency = np.hypot(rows, fft.rfftfreq(SIZE, 1 / SIZE))
    gain = np.maximum(frequency, 1e-9) ** -slope
    gain[frequency < min_frequency] = 0
    white = rng.standard_normal((SIZE, SIZE))
    shaped: FloatArray = fft.irfft2(fft.rfft2(white) * gain, (SIZE, SIZE))
    return shaped / shaped.std()


def _painted(
    rng: Generator,
    brightness: float = 0.9,
    colour: Sequence[float] = (1.0, 1.0, 1.0),
    noise: Sequence[tuple[float, float, float]] = ((0.02, 1.0, 1.0),),
    stones: dict[str, Any] | None = None,
    shapes: Sequence[dict[str, Any]] = (),
    **_: Any,
) -> ByteArray:
    """Paint a texture of textures.toml as RGBA [SIZE, SIZE, 4]."""
    pattern = np.full((SIZE, SIZE), brightness)
    for amplitude, *spectrum in noise:
        pattern += amplitude * _noise(rng, *spectrum)
    if stones:
        pattern *= _stones(rng, **stones)
    colours = np.clip(pattern[..., None] * [*colour, 1e9], 0, 1)
    image = (255 * colours).astype(np.uint8)
    for shape in shapes:
        _draw(image, **shape)
    return image


def _stones(
    rng: Generator,
    num: tuple[int, int],  # stones across and down
    spread: float,  # standard deviation of their brightness
    joint: float,  # thickness of the bed joints in stone heights
    joint_brightness: float,
    shift: float = 0.5,  # of every second row, in stone widths
    slope: float = 0.0,  # brightness from the upper to the lower edge of a stone
) -> FloatArray:
    """Return the brightness [SIZE, SIZE] of rows of stones."""
    grid = np.mgrid[:SIZE, :SIZE] / SIZE
    down, across = grid * np.reshape(num[::-1], (2, 1, 1))
    row = down.astype(int)
    across += shift * (row % 2)
    stones = 1 + spread * rng.standard_normal(num[::-1])
    brightness = stones[row, across.astype(int) % num[0]]
    brightness *= 1 + slope * (down % 1 - 1)
    is_joint = (across % 1 < 0.06) | (down % 1 < joint)
    return np.where(is_joint, joint_brightness, brightness)


def _draw(
    image: ByteArray,
    kind: str,
    at: Sequence[int],
    colour: Sequence[int],
    width: int = -1,
    repeat: Sequence[tuple[int, int]] = ((0, 0),),
) -> None:
    """Draw a shape on an image at each of the shifts of `repeat`."""
    smooth = cv2.LINE_AA
    for shift in repeat:
        points = np.reshape(at, (-1, 2)) + shift
        first, second = points[:2].tolist()
        if kind == "rectangle":
            cv2.rectangle(image, first, second, colour, width)
        elif kind == "ellipse":
            radii = at[2:]
            cv2.ellipse(image, first, radii, 0, 0, 360, colour, width, smooth)
        else:
            cv2.polylines(image, [points], False, colour, width, smooth)


@functools.cache
def mip_maps() -> tuple[ByteArray, ...]:
    """Paint all textures; return RGBA [textures, S, S, 4] for S = SIZE, SIZE / 2, ... 1."""
    # All streets share the images; they differ by tints and layout.
    images = [
        _painted(np.random.default_rng([20_110_926, number]), **table)
        for number, table in enumerate(TABLES.values())
    ]
    levels = []
    for level in range(SIZE.bit_length()):
        size = (SIZE >> level, SIZE >> level)
        smaller = [cv2.resize(image, size, None, 0, 0, cv2.INTER_AREA) for image in images]
        levels.append(np.array(smaller))
    return tuple(levels)


def sample(
    texture: IntArray | Texture,  # [N] or one for all
    uv: FloatArray,  # [N, 2], in tiles; images repeat
    longer: FloatArray,  # [N, 2], the longer side of the footprint of a pixel, in tiles
    shorter: FloatArray,  # [N], length of the shorter side, in tiles
) -> FloatArray:
    """Return RGBA [N, 4] in 0..1, averaged over the footprint of each pixel."""
    textures = np.zeros(len(uv), dtype=int) + texture
    return _sample(mip_maps(), textures, uv, longer, shorter)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sample(levels, texture, uv, longer, shorter):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Average taps along the longer side of the footprint in two mip levels."""
    max_taps = 8  # limits the cost of grazing views
    size = levels[0].shape[1]
    colours = np.zeros((len(texture), 4))
    for i in range(len(texture)):
        major = math.hypot(longer[i, 0], longer[i, 1]) * size
        minor = max(shorter[i] * size, major / max_taps, 1.0)
        num_taps = min(max(math.ceil(major / minor), 1), max_taps)
        level = min(math.log2(minor), len(levels) - 1.0)
        for mip in range(int(level), int(level) + 2):
            weight = (1.0 - abs(level - mip)) / (255.0 * num_taps)
            if weight == 0.0:
                continue
            image = levels[mip][texture[i]]
            width = len(image)
            for tap in range(num_taps):
                offset = (tap + 0.5) / num_taps - 0.5
                x = (uv[i, 0] + offset * longer[i, 0]) * width - 0.5
                y = (uv[i, 1] + offset * longer[i, 1]) * width - 0.5
                left = math.floor(x)
                top = math.floor(y)
                for row in (top, top + 1):
                    for col in (left, left + 1):
                        bilinear = (1.0 - abs(x - col)) * (1.0 - abs(y - row))
                        texel = image[row % width, col % width]
                        for k in range(4):
                            colours[i, k] += weight * bilinear * texel[k]
    return colours
