"""What can happen to the frames of a clip, each in four severities."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from geovp_classic.types import ByteArray, Context, Intrinsics
from studies.ablation import NUM_FUTURE, NUM_PAST

NUM_SEVERITIES = 4
NUM_STEPS = NUM_PAST + NUM_FUTURE
HEIGHT_PX = 256  # lengths in pixels are of an image of this height

Severity = int  # 0 to NUM_SEVERITIES - 1
Image = Callable[
    [ByteArray, int, Severity], ByteArray
]  # the frame of a step (0 to NUM_STEPS - 1), corrupted


@dataclass(frozen=True)
class Corruption:
    """What happens to a clip."""

    image: Image = lambda image, step, severity: image
    order: Callable[[Severity], list[int]] = lambda severity: list(
        range(NUM_STEPS)
    )  # which frame is shown at each step
    context: Callable[[Context, Severity], Context] = lambda context, severity: context
    poses_follow: bool = False  # whether the true poses take the frames' order
    crop_from_full: bool = (
        False  # what comes into the crop from beside it is what the whole frame shows there
    )


def _gain(*factors: float, steps: range = range(NUM_STEPS)) -> Image:
    return lambda image, step, severity: (
        _scaled(image, factors[severity]) if step in steps else image
    )


def _scaled(image: ByteArray, factor: float, offset: float = 0.0) -> ByteArray:
    return np.asarray(cv2.convertScaleAbs(image, alpha=factor, beta=offset))


def _flicker(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    return (
        _scaled(image, 1 - (0.1, 0.2, 0.4, 0.6)[severity] * (step % 2))
        if step < NUM_PAST
        else image
    )


def _noise(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    noise = np.random.default_rng([step, severity]).normal(
        0, (5, 15, 30, 60)[severity], image.shape
    )
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _blur(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    if step != NUM_PAST - 3:
        return image
    length = max(2, round((5, 10, 20, 40)[severity] * len(image) / HEIGHT_PX))
    return np.asarray(cv2.blur(image, (length, 1)))


def _hood(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    hooded = image.copy()
    hooded[round(len(image) * (1 - (0.05, 0.1, 0.2, 0.3)[severity])) :] = 40  # brighter than a bar
    return hooded


def _bars(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    """Black bars above and below, as of a film."""
    barred, rows = image.copy(), round(len(image) * (0.04, 0.08, 0.12, 0.2)[severity])
    barred[:rows] = barred[len(image) - rows :] = 0
    return barred


def _rain(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    rng, wet = np.random.default_rng([step, severity]), image.copy()
    height, width = image.shape[:2]
    for _ in range((40, 100, 250, 600)[severity] * width // height):
        u, v = int(rng.integers(width)), int(rng.integers(height))
        cv2.line(wet, (u, v), (u + height // 80, v + height // 16), (200, 200, 200), 1, cv2.LINE_AA)
    return wet


def _tilt(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    height, width = image.shape[:2]
    turn = cv2.getRotationMatrix2D((width / 2 - 0.5, height / 2 - 0.5), (2, 5, 10, 20)[severity], 1)
    return np.asarray(cv2.warpAffine(image, turn, (width, height), borderMode=cv2.BORDER_REFLECT))


def _flat(value: int) -> Image:
    return lambda image, step, severity: (
        np.full_like(image, value) if 5 - severity <= step <= 5 + severity // 3 else image
    )


def _bus(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    """A vehicle that crosses from left to right, a third of the image's height a second."""
    height, width = image.shape[:2]
    rows = slice(round(0.28 * height), round(0.88 * height))
    length, left = (
        round((0.3, 0.6, 0.8, 1.0)[severity] * height),
        round((0.035 * step - 0.2) * height) + (width - height) // 2,
    )
    side = _spotted(length, rows.stop - rows.start, severity)
    columns = np.arange(max(left, 0), min(left + length, width))
    crossed = image.copy()
    crossed[rows, columns] = side[:, columns - left, None]
    return crossed


def _lorry(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    """A vehicle right ahead at one distance, its foot on the road, that shakes a little."""
    height, width = image.shape[:2]
    side = round((0.25, 0.35, 0.45, 0.6)[severity] * height)
    shakes = (
        np.random.default_rng(severity)
        .normal(0, 0.05 * height / HEIGHT_PX, (NUM_STEPS, 2))
        .cumsum(axis=0)[step]
    )
    corner = np.array([(width - side) / 2, 0.46 * height + 0.42 * side - 0.95 * side]) + shakes
    place = np.array([[1, 0, corner[0]], [0, 1, corner[1]]])
    back = cv2.cvtColor(_spotted(side, round(0.95 * side), severity), cv2.COLOR_GRAY2RGB)
    followed = image.copy()
    cv2.warpAffine(back, place, (width, height), followed, borderMode=cv2.BORDER_TRANSPARENT)
    return followed


def _spotted(width: int, height: int, seed: int) -> ByteArray:
    spots = np.random.default_rng(seed).random((40, 60)).astype(np.float32)
    grey = 40 + 160 * cv2.resize(spots, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    return grey.astype(np.uint8)


def _shown(changes: Callable[[Severity], Mapping[int, int]]) -> Callable[[Severity], list[int]]:
    return lambda severity: [changes(severity).get(step, step) for step in range(NUM_STEPS)]


def _pattern(image: ByteArray, step: int, severity: Severity) -> ByteArray:
    side = max(1, round((4, 8, 16, 32)[severity] * len(image) / HEIGHT_PX))
    v, u = np.indices(image.shape[:2]) // side
    tiles: ByteArray = np.asarray(40 + 160 * ((u + v) % 2), np.uint8)
    return np.repeat(tiles[:, :, None], 3, axis=2)


def _camera(
    change: Callable[[Intrinsics, Intrinsics, Severity], Intrinsics],
) -> Callable[[Context, Severity], Context]:
    """Crop and whole frame seen by a camera that was calibrated wrongly."""

    def changed(context: Context, severity: Severity) -> Context:
        crop, wide = context.intrinsics, context.full
        if wide is not None:
            wide = replace(wide, intrinsics=change(wide.intrinsics, crop, severity))
        return replace(context, intrinsics=change(crop, crop, severity), full=wide)

    return changed


def _focal(camera: Intrinsics, crop: Intrinsics, severity: Severity) -> Intrinsics:
    factor = (1.05, 1.1, 1.2, 1.4)[severity]
    return replace(camera, fx_px=camera.fx_px * factor, fy_px=camera.fy_px * factor)


def _centre(camera: Intrinsics, crop: Intrinsics, severity: Severity) -> Intrinsics:
    off = (
        (0.05, 0.1, 0.2, 0.4)[severity] * crop.cx_px / crop.fx_px
    )  # the tangent of one angle for both
    return replace(camera, cx_px=camera.cx_px + off * camera.fx_px)


def _jittered_times(context: Context, severity: Severity) -> Context:
    step_s = float(np.diff(context.times_s).mean())
    shifts = (
        np.random.default_rng(severity).uniform(-0.5, 0.5, len(context.times_s))
        * (0.1, 0.3, 0.6, 0.9)[severity]
    )
    return replace(context, times_s=context.times_s + shifts * step_s)


STATIONARY: Callable[[Severity], list[int]] = lambda severity: [NUM_PAST - 1] * NUM_STEPS  # noqa: E731
CORRUPTIONS = {
    "none": Corruption(),
    "black frames": Corruption(_flat(0)),
    "white frames": Corruption(_flat(255)),
    "repeated frames": Corruption(
        order=_shown(
            lambda n: dict.fromkeys(range(6, 7 + (0, 0, 1, 2)[n]), 5) | ({9: 8} if n else {})
        )
    ),
    "swapped frames": Corruption(
        order=_shown(
            lambda n: ({4: 5, 5: 4}, {7: 8, 8: 7}, {8: 9, 9: 8}, {2: 3, 3: 2, 8: 9, 9: 8})[n]
        )
    ),
    "another scene before": Corruption(
        lambda image, step, n: image[:, ::-1] if step < (3, 5, 7, 8)[n] else image
    ),
    "one blurred frame": Corruption(_blur),
    "noise": Corruption(_noise),
    "rain": Corruption(_rain),
    "dim": Corruption(_gain(0.5, 0.25, 0.1, 0.05)),
    "low contrast": Corruption(
        lambda image, step, n: _scaled(image, (0.5, 0.25, 0.1, 0.05)[n], 100)
    ),
    "darker from frame 5 on": Corruption(_gain(0.7, 0.5, 0.25, 0.1, steps=range(5, NUM_STEPS))),
    "darker from the last frame on": Corruption(
        _gain(0.7, 0.5, 0.25, 0.1, steps=range(NUM_PAST - 1, NUM_STEPS))
    ),
    "flicker": Corruption(_flicker),
    "tilt": Corruption(_tilt, crop_from_full=True),
    "hood": Corruption(_hood),
    "black bars": Corruption(_bars),
    "lorry ahead": Corruption(_lorry),
    "wrong focal length": Corruption(context=_camera(_focal)),
    "wrong principal point": Corruption(context=_camera(_centre)),
    "jittered times": Corruption(context=_jittered_times),
    "stationary": Corruption(order=STATIONARY, poses_follow=True),
    "stationary with noise": Corruption(_noise, STATIONARY, poses_follow=True),
    "stationary behind a bus": Corruption(_bus, STATIONARY, poses_follow=True),
    "stationary before a pattern": Corruption(_pattern, STATIONARY, poses_follow=True),
}
