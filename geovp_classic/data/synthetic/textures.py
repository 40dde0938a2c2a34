"""Procedural pictures for surfaces: asphalt, brick, leaves, windows; tileable, painted once per process."""

from __future__ import annotations

import enum
import functools
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.types import ByteArray, FloatArray

ATLAS_SEED = 20_110_926  # one set of pictures for all streets; streets differ by tints and layout


class Texture(enum.IntEnum):
    """Every picture there is; the number is its place in the atlas."""

    PLAIN = 0
    ASPHALT = 1
    ROAD_PAINT = 2
    PAVEMENT = 3
    KERB = 4
    GRASS = 5
    PLASTER = 6
    BRICK = 7
    ROOF = 8
    BARK = 9
    LEAVES = 10
    WINDOW_PLAIN = 11
    WINDOW_CURTAIN = 12
    WINDOW_CROSS = 13
    DOOR = 14
    GARAGE = 15
    ZEBRA = 16
    WHEEL = 17
    CAR_GLASS = 18
    SIGN_RING = 19
    SIGN_BLUE = 20
    CLOUDS = 21
    MACRO = 22
    WOODS = 23
    CAR_SIDE = 24
    FENCE = 25


TILE_M: dict[Texture, float] = {
    Texture.PLAIN: 2.0,
    Texture.ASPHALT: 6.0,
    Texture.ROAD_PAINT: 27.0,
    Texture.PAVEMENT: 4.0,
    Texture.KERB: 2.0,
    Texture.GRASS: 6.0,
    Texture.PLASTER: 6.0,
    Texture.BRICK: 3.0,
    Texture.ROOF: 4.0,
    Texture.BARK: 1.5,
    Texture.LEAVES: 3.0,
    Texture.MACRO: 37.0,
    Texture.WOODS: 60.0,
    Texture.FENCE: 2.0,
} | dict.fromkeys((Texture.WINDOW_PLAIN, Texture.WINDOW_CURTAIN, Texture.WINDOW_CROSS, Texture.DOOR, Texture.GARAGE, Texture.ZEBRA, Texture.WHEEL, Texture.CAR_GLASS, Texture.SIGN_RING, Texture.SIGN_BLUE, Texture.CLOUDS, Texture.CAR_SIDE), 1.0)


@dataclass(frozen=True)
class Atlas:
    """All pictures with all mip levels in one row of texels."""

    texels: ByteArray  # [L, 4], RGBA in display brightness
    starts: FloatArray  # [textures, levels], int64: first texel
    widths: FloatArray  # [textures, levels], int64; 0 behind the last level
    heights: FloatArray  # [textures, levels], int64


@functools.lru_cache(maxsize=1)
def atlas() -> Atlas:
    """The atlas of all textures."""
    chains = [_mip_levels(PAINTERS[texture](np.random.default_rng([ATLAS_SEED, texture]))) for texture in Texture]
    num_levels = max(map(len, chains))
    starts, widths, heights = (np.zeros((len(chains), num_levels), dtype=np.int64) for _ in range(3))
    place = 0
    for row, chain in enumerate(chains):
        for level, picture in enumerate(chain):
            heights[row, level], widths[row, level] = picture.shape[:2]
            starts[row, level] = place
            place += picture.shape[0] * picture.shape[1]
    return Atlas(np.concatenate([level.reshape(-1, 4) for chain in chains for level in chain]), starts, widths, heights)


def noise(rng: np.random.Generator, size: tuple[int, int], slope: float, coarsest: float = 1.0) -> FloatArray:
    """Tileable noise [H, W] of zero mean and unit spread whose amplitude falls as frequency**-slope.

    Frequencies are in cycles per tile; those below `coarsest` are left out.
    """
    height, width = size
    white = np.fft.rfft2(rng.standard_normal(size, dtype=np.float32))
    frequency = np.hypot(np.fft.fftfreq(height, 1 / height)[:, None], np.fft.rfftfreq(width, 1 / width)[None])
    shaped = np.fft.irfft2(white * np.where(frequency >= coarsest, np.maximum(frequency, 1e-9), np.inf) ** -slope, size)
    return shaped / shaped.std()


def _mip_levels(picture: ByteArray) -> list[ByteArray]:
    levels = [picture]
    while max(levels[-1].shape[:2]) > 1:
        height, width = levels[-1].shape[:2]
        size = (max(1, width // 2), max(1, height // 2))
        levels.append(cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], 4))
    return levels


def _picture(colour: FloatArray, alpha: FloatArray | float = 1.0) -> ByteArray:
    """RGBA [H, W, 4] bytes from colour [H, W] or [H, W, 3] in 0..1."""
    if colour.ndim == 2:
        colour = np.repeat(colour[..., None], 3, axis=-1)
    opaque = np.broadcast_to(np.asarray(alpha), colour.shape[:2])[..., None]
    return np.asarray(np.clip(np.concatenate([colour, opaque], axis=-1) * 255 + 0.5, 0, 255), dtype=np.uint8)


def _plain(rng: np.random.Generator) -> ByteArray:
    return _picture(0.93 + 0.02 * noise(rng, (64, 64), 1.0))


def _asphalt(rng: np.random.Generator) -> ByteArray:
    size = (512, 512)
    return _picture(0.46 + 0.035 * noise(rng, size, 1.2) + 0.04 * noise(rng, size, 0.3, 40))


def _road_paint(rng: np.random.Generator) -> ByteArray:
    """27 m of a road, 9.4 m across: dashed centre line, cracks, patches and a manhole, the rest see-through."""
    height, width = 2048, 512
    paint = np.zeros((height, width, 4), dtype=np.uint8)
    for _ in range(5):
        x, y = int(rng.integers(0, width)), int(rng.integers(100, height - 400))
        far = (x + int(rng.integers(60, 180)), y + int(rng.integers(80, 300)))
        cv2.rectangle(paint, (x, y), far, (95, 95, 98, int(rng.integers(60, 170))), -1)
    for lane in (0.28, 0.72):  # tyres polish the road
        for side in (-0.1, 0.1):
            x = int(width * (lane + side))
            cv2.rectangle(paint, (x - 14, 0), (x + 14, height), (100, 100, 100, 45), -1)
    paint = cv2.GaussianBlur(paint, (9, 9), 0)
    for _ in range(9):
        steps = rng.normal(0, [7, 22], (24, 2)).cumsum(axis=0) + [rng.uniform(40, 470), rng.uniform(300, 1700)]
        cv2.polylines(paint, [steps.astype(np.int32)], False, (50, 50, 52, 210), 2, cv2.LINE_AA)
    for y in (300, 1400):
        cv2.circle(paint, (int(rng.integers(120, 210)), y), 21, (88, 84, 80, 255), -1, cv2.LINE_AA)
        cv2.circle(paint, (int(rng.integers(330, 400)), y + 260), 19, (60, 58, 56, 255), 3, cv2.LINE_AA)
    for start in range(0, height, 683):
        cv2.rectangle(paint, (252, start + 40), (260, start + 267), (226, 226, 220, 255), -1)
    worn = np.clip(1.0 + 0.13 * noise(rng, (height, width), 0.8), 0.3, 1)
    paint[..., 3] = (paint[..., 3] * worn).astype(np.uint8)
    return paint


def _slabs(rng: np.random.Generator, size: int, num: tuple[int, int], tone: float, spread: float) -> FloatArray:
    """Slabs [size, size] of random tones with dark joints; num = (across, down)."""
    tones = cv2.resize(
        (tone + spread * rng.standard_normal((num[1], num[0]))).astype(np.float32),
        (size, size),
        interpolation=cv2.INTER_NEAREST,
    )
    for k in range(num[0]):
        tones[:, k * size // num[0] + np.arange(3)] *= 0.72
    for k in range(num[1]):
        tones[k * size // num[1] + np.arange(3)] *= 0.72
    return tones + 0.03 * noise(rng, (size, size), 0.7)


def _pavement(rng: np.random.Generator) -> ByteArray:
    return _picture(_slabs(rng, 512, (8, 8), 0.62, 0.04)[..., None] * [1.0, 0.985, 0.95])


def _kerb(rng: np.random.Generator) -> ByteArray:
    return _picture(0.68 + 0.05 * noise(rng, (128, 128), 0.7))


def _grass(rng: np.random.Generator) -> ByteArray:
    size = (512, 512)
    lush, blade = noise(rng, size, 1.3), noise(rng, size, 0.45, 24)
    tone = 1 + 0.12 * lush + 0.2 * blade
    dry = np.clip(0.5 + 0.3 * noise(rng, size, 1.6), 0, 1)[..., None]
    return _picture(tone[..., None] * (dry * [0.47, 0.52, 0.25] + (1 - dry) * [0.30, 0.45, 0.18]))


def _plaster(rng: np.random.Generator) -> ByteArray:
    size = (512, 512)
    streaks = cv2.GaussianBlur(noise(rng, size, 0.6).astype(np.float32), (0, 0), sigmaX=2, sigmaY=40)
    streaks /= streaks.std()
    return _picture(0.86 + 0.025 * noise(rng, size, 1.4) + 0.02 * streaks + 0.02 * noise(rng, size, 0.2, 60))


def _courses(size: int, num: tuple[int, int], rng: np.random.Generator, spread: float) -> tuple[FloatArray, FloatArray]:
    """Tones [size, size] of bricks or tiles, NaN in the joints, and where in its course a row is (0 to 1)."""
    rows, columns = np.mgrid[:size, :size] / size
    course = np.floor(rows * num[1]).astype(int)
    place = columns * num[0] + 0.5 * (course % 2)
    tones = 1 + spread * rng.standard_normal((num[1], num[0]))
    joint = (place % 1 < 0.06) | (rows * num[1] % 1 < 0.14)
    return np.where(joint, np.nan, tones[course, np.floor(place).astype(int) % num[0]]), rows * num[1] % 1


def _brick(rng: np.random.Generator) -> ByteArray:
    tones, _ = _courses(512, (12, 36), rng, 0.11)
    colour = np.nan_to_num(tones, nan=0.0)[..., None] * [0.78, 0.74, 0.72]
    colour = np.where(np.isnan(tones)[..., None], [0.80, 0.79, 0.77], colour)
    return _picture(colour * (1 + 0.05 * noise(rng, (512, 512), 0.8))[..., None])


def _roof(rng: np.random.Generator) -> ByteArray:
    tones, place = _courses(512, (16, 14), rng, 0.09)
    tones = np.where(np.isnan(tones), 0.62, tones * (0.78 + 0.25 * place))
    return _picture(0.85 * tones * (1 + 0.05 * noise(rng, (512, 512), 0.9)))


def _bark(rng: np.random.Generator) -> ByteArray:
    ridges = cv2.GaussianBlur(noise(rng, (256, 256), 0.3).astype(np.float32), (0, 0), sigmaX=1.5, sigmaY=14)
    return _picture((0.5 + 0.14 * ridges / ridges.std())[..., None] * [0.95, 0.83, 0.68])


def _leaves(rng: np.random.Generator) -> ByteArray:
    """Overlapping leaves, the upper ones lighter, wrapped around the edges."""
    size = 512
    picture = np.full((size, size, 3), 25, dtype=np.uint8)
    for count in range(2600):
        light = 0.28 + 0.5 * count / 2600 + 0.10 * rng.standard_normal()
        colour = 255 * light * np.array([rng.uniform(0.72, 0.95), 1.0, rng.uniform(0.3, 0.5)])
        centre, angle = rng.integers(0, size, 2), float(rng.uniform(0, 180))
        axes = (int(rng.integers(8, 15)), int(rng.integers(4, 8)))
        for dx in {0, -size * (centre[0] > size - 16), size * (centre[0] < 16)}:
            for dy in {0, -size * (centre[1] > size - 16), size * (centre[1] < 16)}:
                place = (int(centre[0] + dx), int(centre[1] + dy))
                cv2.ellipse(picture, place, axes, angle, 0, 360, colour.tolist(), -1, cv2.LINE_AA)
    clumps = 1 + 0.2 * noise(rng, (size, size), 1.2, 2)
    return _picture(picture / 255 * clumps[..., None])


def _window(rng: np.random.Generator, bars: tuple[int, int], curtain: bool) -> ByteArray:
    size = 128
    glass = np.linspace(0.36, 0.16, size)[:, None, None] * np.array([0.85, 0.97, 1.1]) * np.ones((size, size, 1))
    glass *= (1 + 0.22 * noise(rng, (size, size), 1.6))[..., None]
    if curtain:
        folds = 0.68 + 0.10 * np.sin(np.arange(size) * 0.55)[None, :, None]
        drawn = (np.abs(np.arange(size) - size / 2) > size * 0.26)[None, :, None]
        glass = np.where(drawn, folds * np.array([0.95, 0.93, 0.88]), glass)
    frame = np.ascontiguousarray(glass)  # floats: lines are drawn without smoothing, mip-maps smooth them
    white = (0.92, 0.92, 0.90)
    cv2.rectangle(frame, (0, 0), (size - 1, size - 1), white, 16)
    for k in range(1, bars[0]):
        cv2.line(frame, (k * size // bars[0], 0), (k * size // bars[0], size), white, 7)
    for k in range(1, bars[1]):
        cv2.line(frame, (0, k * size // bars[1]), (size, k * size // bars[1]), white, 7)
    return _picture(frame)


def _door(rng: np.random.Generator) -> ByteArray:
    door = np.full((256, 128, 3), 0.8)
    for x0, x1 in ((18, 58), (70, 110)):
        for y0, y1 in ((20, 100), (120, 230)):
            cv2.rectangle(door, (x0, y0), (x1, y1), (0.62, 0.62, 0.62), -1)
            cv2.rectangle(door, (x0, y0), (x1, y1), (0.95, 0.95, 0.95), 2)
    cv2.rectangle(door, (0, 0), (127, 255), (1.0, 1.0, 1.0), 8)
    cv2.circle(door, (112, 135), 5, (0.3, 0.28, 0.2), -1)
    return _picture(door * (1 + 0.03 * noise(rng, (256, 128), 1.0))[..., None])


def _garage(rng: np.random.Generator) -> ByteArray:
    rows = 0.8 + 0.12 * np.sign(np.sin(np.arange(256) * 2 * np.pi / 32))[:, None] * np.ones((1, 256))
    return _picture(cv2.GaussianBlur(rows + 0.02 * noise(rng, (256, 256), 1.0), (5, 5), 0))


def _zebra(rng: np.random.Generator) -> ByteArray:
    stripes = np.zeros((128, 512))
    for k in range(8):
        stripes[:, k * 64 + 16 : k * 64 + 48] = 1
    worn = np.clip(1 + 0.2 * noise(rng, stripes.shape, 0.8), 0.2, 1.1)
    stripes = cv2.GaussianBlur(stripes * worn, (3, 3), 0)
    return _picture(0.44 + 0.42 * stripes + 0.03 * noise(rng, stripes.shape, 0.5))


def _wheel(rng: np.random.Generator) -> ByteArray:
    wheel = np.full((128, 128, 3), 33, dtype=np.uint8)
    cv2.circle(wheel, (64, 64), 44, (168, 171, 176), -1, cv2.LINE_AA)
    for k in range(5):
        at = (64 + 30 * np.cos(k * 2 * np.pi / 5), 64 + 30 * np.sin(k * 2 * np.pi / 5))
        cv2.circle(wheel, (int(at[0]), int(at[1])), 10, (31, 31, 33), -1, cv2.LINE_AA)
    cv2.circle(wheel, (64, 64), 8, (102, 102, 107), -1, cv2.LINE_AA)
    return _picture(wheel / 255)


def _car_glass(rng: np.random.Generator) -> ByteArray:
    slope = np.linspace(0.34, 0.10, 64)[:, None, None] * np.array([0.9, 1.0, 1.08])
    return _picture(slope * (1 + 0.12 * noise(rng, (64, 64), 1.6))[..., None])


def _car_side(rng: np.random.Generator) -> ByteArray:
    """Seams, handles and a sill over the side of a car, see-through elsewhere; u runs from tail to nose."""
    side = np.zeros((128, 512, 4), dtype=np.uint8)
    for x in (150, 262, 366):
        cv2.line(side, (x, 6), (x - 6, 112), (12, 12, 14, 200), 3, cv2.LINE_AA)
    cv2.line(side, (150, 112), (366, 112), (12, 12, 14, 200), 3, cv2.LINE_AA)
    for x in (168, 276):
        cv2.rectangle(side, (x, 26), (x + 26, 33), (20, 20, 22, 230), -1)
    cv2.line(side, (20, 52), (495, 46), (255, 255, 255, 60), 4, cv2.LINE_AA)
    return side


def _sign_ring(rng: np.random.Generator) -> ByteArray:
    """The limit of 30 km/h."""
    sign = np.full((128, 128, 3), 243, dtype=np.uint8)
    cv2.circle(sign, (64, 64), 56, (204, 26, 26), 14, cv2.LINE_AA)
    three = [(36, 44), (56, 44), (46, 60), (56, 68), (54, 82), (36, 84)]
    cv2.polylines(sign, [np.array(three)], False, (20, 20, 26), 6, cv2.LINE_AA)
    cv2.ellipse(sign, (80, 64), (12, 20), 0, 0, 360, (20, 20, 26), 6, cv2.LINE_AA)
    return _picture(sign / 255)


def _sign_blue(rng: np.random.Generator) -> ByteArray:
    """Parking."""
    sign = np.full((128, 128, 3), (31, 77, 173), dtype=np.uint8)
    cv2.rectangle(sign, (4, 4), (123, 123), (238, 240, 245), 6)
    cv2.line(sign, (46, 28), (46, 102), (240, 242, 248), 13)
    cv2.ellipse(sign, (52, 48), (28, 20), 0, -90, 90, (240, 242, 248), 12, cv2.LINE_AA)
    return _picture(sign / 255)


def _clouds(rng: np.random.Generator) -> ByteArray:
    tone = noise(rng, (512, 512), 1.7)
    return _picture(0.93 + 0.05 * noise(rng, (512, 512), 1.5), np.clip(0.32 + 0.42 * tone, 0, 1))


def _macro(rng: np.random.Generator) -> ByteArray:
    return _picture(np.clip(0.5 + 0.16 * noise(rng, (256, 256), 1.1), 0, 1))


def _woods(rng: np.random.Generator) -> ByteArray:
    tone = 0.42 + 0.06 * noise(rng, (512, 512), 0.9) + 0.07 * noise(rng, (512, 512), 0.4, 20)
    return _picture(tone[..., None] * [0.72, 0.92, 0.55])


def _fence(rng: np.random.Generator) -> ByteArray:
    fence = 0.75 + 0.06 * rng.standard_normal(16).repeat(16)[None] * np.ones((256, 1))
    fence[:, np.arange(256) % 16 < 2] = 0.25
    return _picture((fence + 0.03 * noise(rng, (256, 256), 0.8))[..., None] * [1.0, 0.87, 0.7])


PAINTERS: dict[Texture, Callable[[np.random.Generator], ByteArray]] = {
    Texture.PLAIN: _plain,
    Texture.ASPHALT: _asphalt,
    Texture.ROAD_PAINT: _road_paint,
    Texture.PAVEMENT: _pavement,
    Texture.KERB: _kerb,
    Texture.GRASS: _grass,
    Texture.PLASTER: _plaster,
    Texture.BRICK: _brick,
    Texture.ROOF: _roof,
    Texture.BARK: _bark,
    Texture.LEAVES: _leaves,
    Texture.WINDOW_PLAIN: functools.partial(_window, bars=(1, 1), curtain=True),
    Texture.WINDOW_CURTAIN: functools.partial(_window, bars=(2, 1), curtain=True),
    Texture.WINDOW_CROSS: functools.partial(_window, bars=(2, 3), curtain=False),
    Texture.DOOR: _door,
    Texture.GARAGE: _garage,
    Texture.ZEBRA: _zebra,
    Texture.WHEEL: _wheel,
    Texture.CAR_GLASS: _car_glass,
    Texture.SIGN_RING: _sign_ring,
    Texture.SIGN_BLUE: _sign_blue,
    Texture.CLOUDS: _clouds,
    Texture.MACRO: _macro,
    Texture.WOODS: _woods,
    Texture.CAR_SIDE: _car_side,
    Texture.FENCE: _fence,
}
