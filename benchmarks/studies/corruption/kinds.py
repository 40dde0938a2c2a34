"""Corruptions of the frames of a clip, each in four severities (0 to 3).

An image function gets a frame, its step in the clip and the severity. Lengths in pixels are those
of images of 256 rows.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from geovp_classic.types import ByteArray, Context, Intrinsics

NUM_PAST, NUM_FUTURE = 10, 20
NUM_STEPS = NUM_PAST + NUM_FUTURE
Image = Callable[[ByteArray, int, int], ByteArray]


def _unchanged(image: ByteArray, step: int, severity: int) -> ByteArray:
    return image


def _in_order(severity: int) -> list[int]:
    return list(range(NUM_STEPS))


@dataclass(frozen=True)
class Corruption:
    """Change of a clip."""

    image: Image = _unchanged
    order: Callable[[int], list[int]] = _in_order  # the frame that is shown at each step
    context: Callable[[Context, int], Context] = lambda context, severity: context
    reorders_poses: bool = False
    crop_from_full: bool = False  # the crop is cut from the corrupted full frame
    severities: int = 4


def _gain(factors: tuple[float, ...], first: int = 0) -> Image:
    """Return the change of brightness from a step on."""

    def scaled(image: ByteArray, step: int, severity: int) -> ByteArray:
        return _scaled(image, factors[severity]) if step >= first else image

    return scaled


def _scaled(image: ByteArray, factor: float, offset: float = 0.0) -> ByteArray:
    return np.asarray(cv2.convertScaleAbs(image, alpha=factor, beta=offset))


def _low_contrast(image: ByteArray, step: int, severity: int) -> ByteArray:
    return _scaled(image, (0.5, 0.25, 0.1, 0.05)[severity], 100)


def _flicker(image: ByteArray, step: int, severity: int) -> ByteArray:
    if step >= NUM_PAST:
        return image
    return _scaled(image, 1 - (0.1, 0.2, 0.4, 0.6)[severity] * (step % 2))


def _noise(image: ByteArray, step: int, severity: int) -> ByteArray:
    rng = np.random.default_rng([step, severity])
    noise = rng.normal(0, (5, 15, 30, 60)[severity], image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _blur(image: ByteArray, step: int, severity: int) -> ByteArray:
    if step != NUM_PAST - 3:
        return image
    length = max(2, round((5, 10, 20, 40)[severity] * len(image) / 256))
    return np.asarray(cv2.blur(image, (length, 1)))


def _hood(image: ByteArray, step: int, severity: int) -> ByteArray:
    hooded = image.copy()
    hooded[round(len(image) * (1 - (0.05, 0.1, 0.2, 0.3)[severity])) :] = 40  # brighter than a bar
    return hooded


def _bars(image: ByteArray, step: int, severity: int) -> ByteArray:
    """Add black bars above and below (letterboxing)."""
    rows = round(len(image) * (0.04, 0.08, 0.12, 0.2)[severity])
    barred = image.copy()
    barred[:rows] = barred[len(image) - rows :] = 0
    return barred


def _rain(image: ByteArray, step: int, severity: int) -> ByteArray:
    rng = np.random.default_rng([step, severity])
    wet = image.copy()
    height, width = image.shape[:2]
    for _ in range((40, 100, 250, 600)[severity] * width // height):
        u, v = int(rng.integers(width)), int(rng.integers(height))
        cv2.line(wet, (u, v), (u + height // 80, v + height // 16), (200, 200, 200), 1, cv2.LINE_AA)
    return wet


def _tilt(image: ByteArray, step: int, severity: int) -> ByteArray:
    height, width = image.shape[:2]
    turn = cv2.getRotationMatrix2D((width / 2 - 0.5, height / 2 - 0.5), (2, 5, 10, 20)[severity], 1)
    return np.asarray(cv2.warpAffine(image, turn, (width, height), borderMode=cv2.BORDER_REFLECT))


def _flat(value: int) -> Image:
    """Return the replacement of 1, 2, 3 or 5 frames by a uniform image."""

    def flat(image: ByteArray, step: int, severity: int) -> ByteArray:
        is_replaced = 5 - severity <= step <= 5 + severity // 3
        return np.full_like(image, value) if is_replaced else image

    return flat


def _mirrored_start(image: ByteArray, step: int, severity: int) -> ByteArray:
    return image[:, ::-1] if step < (3, 5, 7, 8)[severity] else image


def _bus(image: ByteArray, step: int, severity: int) -> ByteArray:
    """Add a vehicle that crosses from left to right, a third of the image height per second."""
    height, width = image.shape[:2]
    rows = slice(round(0.28 * height), round(0.88 * height))
    length = round((0.3, 0.6, 0.8, 1.0)[severity] * height)
    left = round((0.035 * step - 0.2) * height) + (width - height) // 2
    side = _spotted(length, rows.stop - rows.start, severity)
    columns = np.arange(max(left, 0), min(left + length, width))
    crossed = image.copy()
    crossed[rows, columns] = side[:, columns - left, None]
    return crossed


def _lorry(image: ByteArray, step: int, severity: int) -> ByteArray:
    """Add a vehicle ahead at a constant distance on the road that shakes a little."""
    height, width = image.shape[:2]
    side = round((0.25, 0.35, 0.45, 0.6)[severity] * height)
    rng = np.random.default_rng(severity)
    shakes = rng.normal(0, 0.05 * height / 256, (NUM_STEPS, 2)).cumsum(axis=0)
    left = (width - side) / 2 + shakes[step, 0]
    top = 0.46 * height + 0.42 * side - 0.95 * side + shakes[step, 1]
    place = np.array([[1, 0, left], [0, 1, top]])
    back = cv2.cvtColor(_spotted(side, round(0.95 * side), severity), cv2.COLOR_GRAY2RGB)
    followed = image.copy()
    cv2.warpAffine(back, place, (width, height), followed, borderMode=cv2.BORDER_TRANSPARENT)
    return followed


def _spotted(width: int, height: int, seed: int) -> ByteArray:
    spots = np.random.default_rng(seed).random((40, 60)).astype(np.float32)
    grey = 40 + 160 * cv2.resize(spots, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    return grey.astype(np.uint8)


def _repeated(severity: int) -> list[int]:
    order = _in_order(severity)
    last = 6 + (0, 0, 1, 2)[severity]
    order[6 : last + 1] = [5] * (last - 5)
    if severity:
        order[9] = 8
    return order


def _swapped(severity: int) -> list[int]:
    order = _in_order(severity)
    for step in ([4], [7], [8], [2, 8])[severity]:
        order[step], order[step + 1] = step + 1, step
    return order


def _stationary(severity: int) -> list[int]:
    return [NUM_PAST - 1] * NUM_STEPS


def _pattern(image: ByteArray, step: int, severity: int) -> ByteArray:
    side = max(1, round((4, 8, 16, 32)[severity] * len(image) / 256))
    v, u = np.indices(image.shape[:2]) // side
    tiles: ByteArray = np.asarray(40 + 160 * ((u + v) % 2), np.uint8)
    return np.repeat(tiles[:, :, None], 3, axis=2)


def _camera(
    change: Callable[[Intrinsics, Intrinsics, int], Intrinsics],
) -> Callable[[Context, int], Context]:
    """Return the change of the intrinsics of the crop and of the full frame."""

    def changed(context: Context, severity: int) -> Context:
        crop = context.intrinsics
        full = context.full
        if full is not None:
            full = replace(full, intrinsics=change(full.intrinsics, crop, severity))
        return replace(context, intrinsics=change(crop, crop, severity), full=full)

    return changed


def _focal(camera: Intrinsics, crop: Intrinsics, severity: int) -> Intrinsics:
    factor = (1.05, 1.1, 1.2, 1.4)[severity]
    return replace(camera, fx_px=camera.fx_px * factor, fy_px=camera.fy_px * factor)


def _centre(camera: Intrinsics, crop: Intrinsics, severity: int) -> Intrinsics:
    tangent = (
        (0.05, 0.1, 0.2, 0.4)[severity] * crop.cx_px / crop.fx_px
    )  # of the same angle for both
    return replace(camera, cx_px=camera.cx_px + tangent * camera.fx_px)


def _jittered_times(context: Context, severity: int) -> Context:
    step_s = float(np.diff(context.times_s).mean())
    rng = np.random.default_rng(severity)
    jitter = rng.uniform(-0.5, 0.5, len(context.times_s)) * (0.1, 0.3, 0.6, 0.9)[severity]
    return replace(context, times_s=context.times_s + jitter * step_s)


CORRUPTIONS = {
    "none": Corruption(severities=1),
    "black frames": Corruption(_flat(0)),
    "white frames": Corruption(_flat(255)),
    "repeated frames": Corruption(order=_repeated),
    "swapped frames": Corruption(order=_swapped),
    "another scene before": Corruption(_mirrored_start),
    "one blurred frame": Corruption(_blur),
    "noise": Corruption(_noise),
    "rain": Corruption(_rain),
    "dim": Corruption(_gain((0.5, 0.25, 0.1, 0.05))),
    "low contrast": Corruption(_low_contrast),
    "darker from frame 5 on": Corruption(_gain((0.7, 0.5, 0.25, 0.1), first=5)),
    "darker from the last frame on": Corruption(_gain((0.7, 0.5, 0.25, 0.1), first=NUM_PAST - 1)),
    "flicker": Corruption(_flicker),
    "tilt": Corruption(_tilt, crop_from_full=True),
    "hood": Corruption(_hood),
    "black bars": Corruption(_bars),
    "lorry ahead": Corruption(_lorry),
    "wrong focal length": Corruption(context=_camera(_focal)),
    "wrong principal point": Corruption(context=_camera(_centre)),
    "jittered times": Corruption(context=_jittered_times),
    "stationary": Corruption(order=_stationary, reorders_poses=True, severities=1),
    "stationary with noise": Corruption(_noise, _stationary, reorders_poses=True),
    "stationary behind a bus": Corruption(_bus, _stationary, reorders_poses=True),
    "stationary before a pattern": Corruption(_pattern, _stationary, reorders_poses=True),
}
