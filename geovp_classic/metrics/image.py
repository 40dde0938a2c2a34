"""Similarity of predicted and real frames: per pixel (PSNR) and per neighbourhood (SSIM).

The same images score several dB and .15 SSIM apart under the definitions in use, so each metric states its own in
`protocol`, and tables print it. All take uint8 RGB frames [F, H, W, 3] and give one float64 per frame [F]; with a mask
[F, H, W] only its pixels count, and a frame with none scores NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from skimage.metrics import structural_similarity

from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, ByteArray, FloatArray

PEAK = 255.0
SSIM_RADIUS_PX, SSIM_SIGMA_PX = 5, 1.5  # Wang et al. 2004, section III-B: 11x11 circular Gaussian


@dataclass(frozen=True)
class Psnr:
    """Peak signal-to-noise ratio, 10 log10(peak^2 / MSE), with one MSE over all pixels and channels of a frame.

    Equal frames have no finite ratio; everything above `ceiling_db` counts as the ceiling, so that means stay finite.
    One grey level wrong in one number of a 256x256 frame is 101.1 dB: beyond 100 dB nobody sees a difference.
    """

    ceiling_db: float = 100.0

    unit: ClassVar[str] = "dB"
    higher_is_better: ClassVar[bool] = True
    protocol: ClassVar[str] = "RGB jointly, 8 bit, per frame"

    def __call__(self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None) -> FloatArray:
        """Decibels per frame [F]; BadData when the arrays do not fit together."""
        return self.over(predicted, target, [mask])[0]

    def over(self, predicted: ByteArray, target: ByteArray, masks: Sequence[BoolArray | None]) -> list[FloatArray]:
        """The same for each of several masks; differences are computed once for all."""
        for mask in masks:
            check_frames(predicted, target, mask)
        errors = np.empty((len(masks), len(target)))
        for step in range(len(target)):
            difference = predicted[step].astype(np.int32) - target[step]
            squares = np.einsum("hwc,hwc->hw", difference, difference) / 3.0
            errors[:, step] = [_masked_mean(squares, None if mask is None else mask[step]) for mask in masks]
        with np.errstate(divide="ignore"):
            return list(np.minimum(10.0 * np.log10(PEAK**2 / errors), self.ceiling_db))


@dataclass(frozen=True)
class Ssim:
    """Structural similarity of Wang et al. 2004: Gaussian window of 11 pixels and sigma 1.5, K = (.01, .03), peak 255.

    Every channel on its own, averaged over R, G and B and over the windows that lie wholly inside the frame, by
    scikit-image. A mask selects windows by their centre pixel; the windows extend over unmasked neighbours, too.
    """

    unit: ClassVar[str] = ""
    higher_is_better: ClassVar[bool] = True
    protocol: ClassVar[str] = "Wang 2004, Gaussian 11 px, sigma 1.5, valid region, mean over RGB"

    def __call__(self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None) -> FloatArray:
        """Similarity per frame [F], at most 1; BadData when the arrays do not fit together or are below 11x11."""
        return self.over(predicted, target, [mask])[0]

    def over(self, predicted: ByteArray, target: ByteArray, masks: Sequence[BoolArray | None]) -> list[FloatArray]:
        """The same for each of several masks; windows are compared once for all."""
        for mask in masks:
            check_frames(predicted, target, mask)
        if min(target.shape[1:3]) < 2 * SSIM_RADIUS_PX + 1:
            raise BadData(
                f"SSIM of frames of shape {target.shape[1:]}, expected at least 11x11 pixels: use larger ones"
            )
        inside = slice(SSIM_RADIUS_PX, -SSIM_RADIUS_PX)
        scores = np.empty((len(masks), len(target)))
        for step in range(len(target)):
            similarity = ssim_map(predicted[step], target[step])[inside, inside].mean(axis=-1)
            inner = (None if mask is None else mask[step, inside, inside] for mask in masks)
            scores[:, step] = [_masked_mean(similarity, mask) for mask in inner]
        return list(scores)


def ssim_map(
    predicted: ByteArray,  # [H, W, 3]
    target: ByteArray,  # [H, W, 3]
) -> FloatArray:
    """SSIM of the window around every pixel and channel [H, W, 3] (Wang et al. 2004, eq. 13); borders are mirrored."""
    _, similarity = structural_similarity(
        predicted,
        target,
        data_range=PEAK,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=SSIM_SIGMA_PX,
        use_sample_covariance=False,
        full=True,
    )
    return np.asarray(similarity)


def check_frames(predicted: ByteArray, target: ByteArray, mask: BoolArray | None) -> None:
    """Raise BadData unless both are uint8 [F, H, W, 3] of one shape and the mask, if any, is bool [F, H, W]."""
    for what, frames in (("predicted", predicted), ("target", target)):
        if frames.dtype != np.uint8 or frames.ndim != 4 or frames.shape[-1] != 3 or frames.shape != target.shape:
            raise BadData(
                f"metric: {what} frames are {frames.dtype} of shape {frames.shape}, expected uint8 [F, H, W, 3] like"
                f" the target's {target.shape}"
            )
    if mask is not None and (mask.dtype != np.bool_ or mask.shape != target.shape[:3]):
        raise BadData(f"metric: mask is {mask.dtype} of shape {mask.shape}, expected bool of shape {target.shape[:3]}")


def _masked_mean(values: FloatArray, mask: BoolArray | None) -> float:
    """The mean over the mask's pixels; NaN for none."""
    chosen = values if mask is None else values[mask]
    return float(chosen.mean()) if chosen.size else float("nan")
