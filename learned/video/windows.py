"""What video predictors learn from: windows of clips at the network's own size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import torch
from torch import Tensor

from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray, Clip
from learned.methods import Batch

LUMA = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601


def windows(clips: Iterable[Clip], size_px: int, num_frames: int, stride: int) -> list[ByteArray]:
    """Every `stride`-th run of frames [num_frames, size, size, 3] of each clip; runs of a clip share their memory."""
    found = []
    for clip in clips:
        frames = resized(clip.frames, size_px, size_px)
        found += [frames[first : first + num_frames] for first in range(0, len(frames) - num_frames + 1, stride)]
    return found


def resized(frames: ByteArray, width_px: int, height_px: int) -> ByteArray:
    """Frames [T, H, W, 3] at another size."""
    return np.stack([pinhole.resize(frame, (width_px, height_px)) for frame in frames])


def batch(chosen: Sequence[ByteArray], rng: np.random.Generator, grey_share: float) -> Batch:
    """Half of the windows mirrored, a share of them grey: "images" [B, T, 3, H, W], bytes."""
    return {"images": stacked([_augmented(frames, rng, grey_share) for frames in chosen])}


def stacked(chosen: Sequence[ByteArray]) -> Tensor:
    """Windows as they are, [B, T, 3, H, W], bytes."""
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(np.stack(chosen), -1, -3)))


def _augmented(frames: ByteArray, rng: np.random.Generator, grey_share: float) -> ByteArray:
    if rng.random() < 0.5:
        frames = frames[:, :, ::-1]
    if rng.random() < grey_share:
        frames = np.repeat((frames @ LUMA).round().astype(np.uint8)[..., None], 3, axis=-1)
    return frames
