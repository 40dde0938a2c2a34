"""Corruptions of the frames of a clip, each in four severities (0 to 3).

Ten frames are observed. Most functions change frames [T, H, W, 3] in place; lengths in pixels are
those of images of 256 rows.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from geovp_classic.types import ByteArray, Context, Intrinsics


@dataclass(frozen=True)
class Corruption:
    """Change of a clip."""

    change: Callable[[ByteArray, int], None] = lambda frames, severity: None
    context: Callable[[Context, int], Context] = lambda context, severity: context
    is_stationary: bool = False  # frames and poses are those of the last observed frame
    crop_from_full: bool = False  # the crop is cut from the corrupted full frame
    severities: int = 4


def _scale(frames: ByteArray, factor: float) -> None:
    for frame in frames:
        cv2.convertScaleAbs(frame, frame, factor)


def _dim(frames: ByteArray, severity: int) -> None:
    _scale(frames, (0.5, 0.25, 0.1, 0.05)[severity])


def _flicker(frames: ByteArray, severity: int) -> None:
    _scale(frames[1:10:2], 1 - (0.1, 0.2, 0.4, 0.6)[severity])


def _noise(frames: ByteArray, severity: int) -> None:
    for step, frame in enumerate(frames):
        rng = np.random.default_rng([step, severity])
        noise = rng.normal(0, (5, 15, 30, 60)[severity], frame.shape)
        frame[:] = np.clip(frame + noise, 0, 255)


def _hood(frames: ByteArray, severity: int) -> None:
    top = round(frames.shape[1] * (1 - (0.05, 0.1, 0.2, 0.3)[severity]))
    frames[:, top:] = 40  # brighter than a bar


def _tilt(frames: ByteArray, severity: int) -> None:
    height, width = frames.shape[1:3]
    turn = cv2.getRotationMatrix2D((width / 2 - 0.5, height / 2 - 0.5), (2, 5, 10, 20)[severity], 1)
    for frame in frames:
        frame[:] = cv2.warpAffine(frame, turn, (width, height), borderMode=cv2.BORDER_REFLECT)


def _blank(frames: ByteArray, severity: int) -> None:
    """Replace 1, 2, 3 or 5 frames by a black image."""
    frames[5 - severity : 6 + severity // 3] = 0


def _mirrored_start(frames: ByteArray, severity: int) -> None:
    start = frames[: (3, 5, 7, 8)[severity]]
    start[:] = start[:, :, ::-1].copy()


def _bus(frames: ByteArray, severity: int) -> None:
    """Add a vehicle that crosses from left to right, a third of the image height per second."""
    height, width = frames.shape[1:3]
    rows = slice(round(0.28 * height), round(0.88 * height))
    length = round((0.3, 0.6, 0.8, 1.0)[severity] * height)
    side = _spotted(length, rows.stop - rows.start, severity)
    for step, frame in enumerate(frames):
        left = round((0.035 * step - 0.2) * height) + (width - height) // 2
        columns = np.arange(max(left, 0), min(left + length, width))
        frame[rows, columns] = side[:, columns - left, None]


def _lorry(frames: ByteArray, severity: int) -> None:
    """Add a vehicle ahead at a constant distance on the road that shakes a little."""
    height, width = frames.shape[1:3]
    side = round((0.25, 0.35, 0.45, 0.6)[severity] * height)
    back = cv2.cvtColor(_spotted(side, round(0.95 * side), severity), cv2.COLOR_GRAY2RGB)
    rng = np.random.default_rng(severity)
    shakes = rng.normal(0, 0.05 * height / 256, (len(frames), 2)).cumsum(axis=0)
    corner = (width - side) / 2, 0.46 * height + 0.42 * side - 0.95 * side
    for frame, place in zip(frames, corner + shakes, strict=True):
        moved = np.column_stack([np.eye(2), place])
        cv2.warpAffine(back, moved, (width, height), frame, borderMode=cv2.BORDER_TRANSPARENT)


def _spotted(width: int, height: int, seed: int) -> ByteArray:
    spots = np.random.default_rng(seed).random((40, 60)).astype(np.float32)
    grey = 40 + 160 * cv2.resize(spots, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    return grey.astype(np.uint8)


def _repeat(frames: ByteArray, severity: int) -> None:
    if severity:
        frames[9] = frames[8]
    frames[6 : (7, 7, 8, 9)[severity]] = frames[5]


def _swap(frames: ByteArray, severity: int) -> None:
    for step in ([4], [7], [8], [2, 8])[severity]:
        frames[[step, step + 1]] = frames[[step + 1, step]]


def _with_cameras(context: Context, change: Callable[[Intrinsics], Intrinsics]) -> Context:
    """Return the context with other intrinsics of the crop and of the full frame."""
    full = context.full
    if full is not None:
        full = replace(full, intrinsics=change(full.intrinsics))
    return replace(context, intrinsics=change(context.intrinsics), full=full)


def _wrong_focal_length(context: Context, severity: int) -> Context:
    factor = (1.05, 1.1, 1.2, 1.4)[severity]
    return _with_cameras(
        context,
        lambda camera: replace(camera, fx_px=camera.fx_px * factor, fy_px=camera.fy_px * factor),
    )


def _wrong_centre(context: Context, severity: int) -> Context:
    crop = context.intrinsics
    tangent = (0.05, 0.1, 0.2, 0.4)[severity] * crop.cx_px / crop.fx_px
    return _with_cameras(
        context, lambda camera: replace(camera, cx_px=camera.cx_px + tangent * camera.fx_px)
    )


def _jittered_times(context: Context, severity: int) -> Context:
    step_s = float(np.diff(context.times_s).mean())
    rng = np.random.default_rng(severity)
    jitter = rng.uniform(-0.5, 0.5, len(context.times_s)) * (0.1, 0.3, 0.6, 0.9)[severity]
    return replace(context, times_s=context.times_s + jitter * step_s)


CORRUPTIONS = {
    "none": Corruption(severities=1),
    "black frames": Corruption(_blank),
    "repeated frames": Corruption(_repeat),
    "swapped frames": Corruption(_swap),
    "another scene before": Corruption(_mirrored_start),
    "noise": Corruption(_noise),
    "dim": Corruption(_dim),
    "flicker": Corruption(_flicker),
    "tilt": Corruption(_tilt, crop_from_full=True),
    "hood": Corruption(_hood),
    "lorry ahead": Corruption(_lorry),
    "wrong focal length": Corruption(context=_wrong_focal_length),
    "wrong principal point": Corruption(context=_wrong_centre),
    "jittered times": Corruption(context=_jittered_times),
    "stationary": Corruption(is_stationary=True, severities=1),
    "stationary with noise": Corruption(_noise, is_stationary=True),
    "stationary behind a bus": Corruption(_bus, is_stationary=True),
}
