"""Images that fill a surface once: windows, doors, wheels, signs, the side of a car; and the clouds."""

from __future__ import annotations

import cv2
import numpy as np

from geovp_classic.data.synthetic.patterns import image_of, laid_over, noise
from geovp_classic.types import ByteArray


def window(rng: np.random.Generator, bars: tuple[int, int], curtain: bool) -> ByteArray:
    """A framed window of (columns, rows) of panes."""
    size = 128
    glass = np.linspace(0.36, 0.16, size)[:, None, None] * np.array([0.85, 0.97, 1.1]) * np.ones((size, size, 1))
    glass = glass * (1 + 0.22 * noise(rng, (size, size), 1.6))[..., None]
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
    return image_of(frame)


def door(rng: np.random.Generator) -> ByteArray:
    """A front door with four panels."""
    door = np.full((256, 128, 3), 0.8)
    for x0, x1 in ((18, 58), (70, 110)):
        for y0, y1 in ((20, 100), (120, 230)):
            cv2.rectangle(door, (x0, y0), (x1, y1), (0.62, 0.62, 0.62), -1)
            cv2.rectangle(door, (x0, y0), (x1, y1), (0.95, 0.95, 0.95), 2)
    cv2.rectangle(door, (0, 0), (127, 255), (1.0, 1.0, 1.0), 8)
    cv2.circle(door, (112, 135), 5, (0.3, 0.28, 0.2), -1)
    return image_of(door * (1 + 0.03 * noise(rng, (256, 128), 1.0))[..., None])


def garage(rng: np.random.Generator) -> ByteArray:
    """A garage door of level boards."""
    rows = 0.8 + 0.12 * np.sign(np.sin(np.arange(256) * 2 * np.pi / 32))[:, None] * np.ones((1, 256))
    return image_of(np.asarray(cv2.GaussianBlur(rows, (5, 5), 0)) + 0.02 * noise(rng, (256, 256), 1.0))


def wheel(rng: np.random.Generator) -> ByteArray:
    """A tyre and a rim with five holes."""
    wheel = np.full((128, 128, 3), 33, dtype=np.uint8)
    cv2.circle(wheel, (64, 64), 44, (168, 171, 176), -1, cv2.LINE_AA)
    for k in range(5):
        at = (64 + 30 * np.cos(k * 2 * np.pi / 5), 64 + 30 * np.sin(k * 2 * np.pi / 5))
        cv2.circle(wheel, (int(at[0]), int(at[1])), 10, (31, 31, 33), -1, cv2.LINE_AA)
    cv2.circle(wheel, (64, 64), 8, (102, 102, 107), -1, cv2.LINE_AA)
    return image_of(wheel / 255)


def car_glass(rng: np.random.Generator) -> ByteArray:
    """Dark glass, lighter at the top."""
    slope = np.linspace(0.34, 0.10, 64)[:, None, None] * np.array([0.9, 1.0, 1.08])
    return image_of(slope * (1 + 0.12 * noise(rng, (64, 64), 1.6))[..., None])


def car_side(rng: np.random.Generator) -> ByteArray:
    """Seams, handles and a sill over the side of a car, see-through elsewhere; u runs from tail to nose."""
    side = np.zeros((128, 512, 4), dtype=np.uint8)
    for x in (150, 262, 366):
        cv2.line(side, (x, 6), (x - 6, 112), (12, 12, 14, 200), 3, cv2.LINE_AA)
    cv2.line(side, (150, 112), (366, 112), (12, 12, 14, 200), 3, cv2.LINE_AA)
    for x in (168, 276):
        cv2.rectangle(side, (x, 26), (x + 26, 33), (20, 20, 22, 230), -1)
    cv2.line(side, (20, 52), (495, 46), (255, 255, 255, 60), 4, cv2.LINE_AA)
    return laid_over(side)


def sign_ring(rng: np.random.Generator) -> ByteArray:
    """The limit of 30 km/h."""
    sign = np.full((128, 128, 3), 243, dtype=np.uint8)
    cv2.circle(sign, (64, 64), 56, (204, 26, 26), 14, cv2.LINE_AA)
    three = [(36, 44), (56, 44), (46, 60), (56, 68), (54, 82), (36, 84)]
    cv2.polylines(sign, [np.array(three)], False, (20, 20, 26), 6, cv2.LINE_AA)
    cv2.ellipse(sign, (80, 64), (12, 20), 0, 0, 360, (20, 20, 26), 6, cv2.LINE_AA)
    return image_of(sign / 255)


def sign_blue(rng: np.random.Generator) -> ByteArray:
    """Parking."""
    sign = np.full((128, 128, 3), (31, 77, 173), dtype=np.uint8)
    cv2.rectangle(sign, (4, 4), (123, 123), (238, 240, 245), 6)
    cv2.line(sign, (46, 28), (46, 102), (240, 242, 248), 13)
    cv2.ellipse(sign, (52, 48), (28, 20), 0, -90, 90, (240, 242, 248), 12, cv2.LINE_AA)
    return image_of(sign / 255)


def clouds(rng: np.random.Generator) -> ByteArray:
    """Fair-weather clouds; alpha is how much of the sky they hide."""
    tone = noise(rng, (512, 512), 1.7)
    return image_of(0.93 + 0.05 * noise(rng, (512, 512), 1.5), np.clip(0.32 + 0.42 * tone, 0, 1))
