"""Surfaces that repeat without a seam: asphalt, paving, grass, plaster, brick, tiles, bark, leaves, boards."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import fft

from geovp_classic.types import ByteArray, FloatArray


def noise(rng: np.random.Generator, size: tuple[int, int], slope: float, coarsest: float = 1.0) -> FloatArray:
    """Tileable noise [H, W] of zero mean and unit spread whose amplitude falls as frequency**-slope.

    Frequencies are in cycles per tile; those below `coarsest` are left out.
    """
    height, width = size
    white = fft.rfft2(rng.standard_normal(size, dtype=np.float32))
    frequency = np.hypot(fft.fftfreq(height, 1 / height)[:, None], fft.rfftfreq(width, 1 / width)[None])
    gain = np.where(frequency >= coarsest, np.maximum(frequency, 1e-9) ** -slope, 0.0).astype(np.float32)
    shaped: FloatArray = fft.irfft2(white * gain, size)
    return shaped / shaped.std()


def image_of(colour: FloatArray, alpha: FloatArray | float = 1.0) -> ByteArray:
    """RGBA bytes [H, W, 4], colour times alpha, from colour [H, W] or [H, W, 3] in 0..1."""
    if colour.ndim == 2:
        colour = np.repeat(colour[..., None], 3, axis=-1)
    opaque = np.broadcast_to(np.asarray(alpha), colour.shape[:2])[..., None]
    rgba = np.concatenate([np.clip(colour, 0.0, 1.0) * opaque, opaque], axis=-1)
    return np.asarray(rgba * 255 + 0.5, dtype=np.uint8)


def laid_over(paint: ByteArray, wear: FloatArray | float = 1.0) -> ByteArray:
    """RGBA bytes [H, W, 4], colour times alpha, of drawn ones; `wear` [H, W] (0 to 1) scales the alpha."""
    return image_of(paint[..., :3] / np.float32(255), paint[..., 3] / np.float32(255) * wear)


def plain(rng: np.random.Generator) -> ByteArray:
    """Almost white, for tints."""
    return image_of(0.93 + 0.02 * noise(rng, (64, 64), 1.0))


def asphalt(rng: np.random.Generator) -> ByteArray:
    """Grey with grit."""
    size = (512, 512)
    return image_of(0.46 + 0.035 * noise(rng, size, 1.2) + 0.04 * noise(rng, size, 0.3, 40))


def road_paint(rng: np.random.Generator) -> ByteArray:
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
    paint = np.asarray(cv2.GaussianBlur(paint, (9, 9), 0), dtype=np.uint8)
    for _ in range(6):
        crack = np.array([rng.uniform(40, 470), rng.uniform(0, 1400)])
        crack = crack + rng.normal([0, 24], [4, 8], (26, 2)).cumsum(axis=0)
        cv2.polylines(paint, [crack.astype(np.int32)], False, (62, 62, 64, 150), 2, cv2.LINE_AA)
    for y in (520, 1180, 1890):
        cv2.line(paint, (0, y), (width, y + int(rng.integers(-20, 20))), (58, 58, 60, 140), 3, cv2.LINE_AA)
    for y in (300, 1400):
        cv2.circle(paint, (int(rng.integers(120, 210)), y), 21, (88, 84, 80, 255), -1, cv2.LINE_AA)
        cv2.circle(paint, (int(rng.integers(330, 400)), y + 260), 19, (60, 58, 56, 255), 3, cv2.LINE_AA)
    for start in range(0, height, 683):
        cv2.rectangle(paint, (252, start + 40), (260, start + 267), (226, 226, 220, 255), -1)
    wear = cv2.resize(np.clip(1.0 + 0.2 * noise(rng, (1024, 256), 0.8), 0.3, 1), (width, height))
    return laid_over(paint, wear)


def _slabs(rng: np.random.Generator, size: int, num: tuple[int, int], tone: float, spread: float) -> FloatArray:
    """Slabs [size, size] of random tones with dark joints; num = (across, down)."""
    tones = tone + spread * rng.standard_normal((num[1], num[0]))
    tones = tones.repeat(size // num[1], axis=0).repeat(size // num[0], axis=1)
    for k in range(num[0]):
        tones[:, k * size // num[0] + np.arange(3)] *= 0.72
    for k in range(num[1]):
        tones[k * size // num[1] + np.arange(3)] *= 0.72
    return tones + 0.03 * noise(rng, (size, size), 0.7)


def pavement(rng: np.random.Generator) -> ByteArray:
    """Concrete slabs of half a metre."""
    return image_of(_slabs(rng, 512, (8, 8), 0.62, 0.04)[..., None] * [1.0, 0.985, 0.95])


def kerb(rng: np.random.Generator) -> ByteArray:
    """Granite."""
    return image_of(0.68 + 0.05 * noise(rng, (128, 128), 0.7))


def grass(rng: np.random.Generator) -> ByteArray:
    """A lawn with dry patches."""
    size = (512, 512)
    lush, blade = noise(rng, size, 1.3), noise(rng, size, 0.45, 24)
    tone = 1 + 0.12 * lush + 0.2 * blade
    dry = np.clip(0.5 + 0.3 * noise(rng, size, 1.6), 0, 1)[..., None]
    return image_of(tone[..., None] * (dry * [0.47, 0.52, 0.25] + (1 - dry) * [0.30, 0.45, 0.18]))


def plaster(rng: np.random.Generator) -> ByteArray:
    """Rendered wall, streaked by rain."""
    size = (512, 512)
    streaks = np.asarray(cv2.GaussianBlur(noise(rng, size, 0.6), (0, 0), sigmaX=2, sigmaY=40))
    streaks = streaks / streaks.std()
    return image_of(0.86 + 0.025 * noise(rng, size, 1.4) + 0.02 * streaks + 0.02 * noise(rng, size, 0.2, 60))


def _courses(size: int, num: tuple[int, int], rng: np.random.Generator, spread: float) -> tuple[FloatArray, FloatArray]:
    """Tones [size, size] of bricks or tiles, NaN in the joints, and where in its course a row is (0 to 1)."""
    rows, columns = np.mgrid[:size, :size] / size
    course = np.floor(rows * num[1]).astype(int)
    place = columns * num[0] + 0.5 * (course % 2)
    tones = 1 + spread * rng.standard_normal((num[1], num[0]))
    joint = (place % 1 < 0.06) | (rows * num[1] % 1 < 0.14)
    return np.where(joint, np.nan, tones[course, np.floor(place).astype(int) % num[0]]), rows * num[1] % 1


def brick(rng: np.random.Generator) -> ByteArray:
    """Bricks of 25 x 8 cm with light joints."""
    tones, _ = _courses(512, (12, 36), rng, 0.11)
    colour = np.nan_to_num(tones, nan=0.0)[..., None] * [0.78, 0.74, 0.72]
    colour = np.where(np.isnan(tones)[..., None], [0.80, 0.79, 0.77], colour)
    return image_of(colour * (1 + 0.05 * noise(rng, (512, 512), 0.8))[..., None])


def roof(rng: np.random.Generator) -> ByteArray:
    """Tiles of 25 x 29 cm, each course dark where the next one covers it."""
    tones, place = _courses(512, (16, 14), rng, 0.09)
    tones = np.where(np.isnan(tones), 0.62, tones * (0.78 + 0.25 * place))
    return image_of(0.85 * tones * (1 + 0.05 * noise(rng, (512, 512), 0.9)))


def bark(rng: np.random.Generator) -> ByteArray:
    """Upright ridges."""
    ridges = np.asarray(cv2.GaussianBlur(noise(rng, (256, 256), 0.3), (0, 0), sigmaX=1.5, sigmaY=14))
    return image_of((0.5 + 0.14 * ridges / ridges.std())[..., None] * [0.95, 0.83, 0.68])


def leaves(rng: np.random.Generator) -> ByteArray:
    """Overlapping leaves, the upper ones lighter, wrapped around the edges."""
    size = 512
    image = np.full((size, size, 3), 25, dtype=np.uint8)
    for count in range(2600):
        light = 0.28 + 0.5 * count / 2600 + 0.10 * rng.standard_normal()
        colour = 255 * light * np.array([rng.uniform(0.72, 0.95), 1.0, rng.uniform(0.3, 0.5)])
        centre, angle = rng.integers(0, size, 2), float(rng.uniform(0, 180))
        axes = (int(rng.integers(8, 15)), int(rng.integers(4, 8)))
        for dx in {0, -size * (centre[0] > size - 16), size * (centre[0] < 16)}:
            for dy in {0, -size * (centre[1] > size - 16), size * (centre[1] < 16)}:
                place = (int(centre[0] + dx), int(centre[1] + dy))
                cv2.ellipse(image, place, axes, angle, 0, 360, colour.tolist(), -1, cv2.LINE_AA)
    clumps = 1 + 0.2 * noise(rng, (size, size), 1.2, 2)
    return image_of(image / 255 * clumps[..., None])


def zebra(rng: np.random.Generator) -> ByteArray:
    """The white stripes of a zebra crossing, upright in the upper half, and nothing below."""
    stripes = np.zeros((256, 512))
    for k in range(8):
        stripes[:128, k * 64 + 16 : k * 64 + 48] = 1
    worn = np.clip(0.85 + 0.2 * noise(rng, (256, 512), 0.8), 0.2, 1.0)
    return image_of(0.87 + 0.02 * noise(rng, (256, 512), 0.5), np.asarray(cv2.GaussianBlur(stripes * worn, (3, 3), 0)))


def macro(rng: np.random.Generator) -> ByteArray:
    """Stains of all sizes, grey."""
    return image_of(np.clip(0.5 + 0.16 * noise(rng, (256, 256), 1.1), 0, 1))


def woods(rng: np.random.Generator) -> ByteArray:
    """Tree tops far away."""
    tone = 0.42 + 0.06 * noise(rng, (512, 512), 0.9) + 0.07 * noise(rng, (512, 512), 0.4, 20)
    return image_of(tone[..., None] * [0.72, 0.92, 0.55])


def fence(rng: np.random.Generator) -> ByteArray:
    """Upright boards."""
    fence = 0.75 + 0.06 * rng.standard_normal(16).repeat(16)[None] * np.ones((256, 1))
    fence[:, np.arange(256) % 16 < 2] = 0.25
    return image_of((fence + 0.03 * noise(rng, (256, 256), 0.8))[..., None] * [1.0, 0.87, 0.7])
