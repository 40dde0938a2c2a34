"""Similarity of predicted and real frames: per pixel (PSNR) and per neighbourhood (SSIM).

The definitions in use differ by several dB and .15 SSIM. Each metric therefore states its own in
`protocol`, and tables print it. All metrics take uint8 RGB frames [F, H, W, 3] and return one
float64 per frame [F]. With a mask [F, H, W], only its pixels count; a frame with none scores NaN.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from skimage.metrics import structural_similarity

from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, ByteArray, FloatArray


class MaskedMetric(ABC):
    """A frame metric that scores several masks for little more than the cost of one."""

    unit = ""
    higher_is_better = True

    @property
    def min_size_px(self) -> int:
        """Return the smallest height and width of frames."""
        return 1

    def __call__(
        self,
        predicted: ByteArray,
        target: ByteArray,
        mask: BoolArray | None = None,
    ) -> FloatArray:
        """Return the score of each frame [F].

        Raises BadData if shapes or types do not match, or if frames are smaller than the window.
        """
        return self.over(predicted, target, [mask])[0]

    def over(
        self,
        predicted: ByteArray,
        target: ByteArray,
        masks: Sequence[BoolArray | None],
    ) -> list[FloatArray]:
        """Return the scores [F] for each mask; frames are compared once for all masks."""
        for mask in masks:
            check_frames(predicted, target, mask)
        shape = target.shape[:3]
        if min(shape[1:]) < self.min_size_px:
            raise BadData(
                f"{type(self).__name__} of frames of shape {target.shape[1:]}, expected at least "
                f"{self.min_size_px}x{self.min_size_px} pixels: use larger frames"
            )
        full = np.ones(shape, bool)
        stacked = np.stack([full if mask is None else mask for mask in masks], axis=1)
        return list(np.stack(list(map(self.score_frame, predicted, target, stacked)), axis=-1))

    @abstractmethod
    def score_frame(self, predicted: ByteArray, target: ByteArray, masks: BoolArray) -> FloatArray:
        """Return the score of one frame [H, W, 3] under each mask [M, H, W]."""


@dataclass(frozen=True)
class Psnr(MaskedMetric):
    """Peak signal-to-noise ratio, 10 log10(peak^2 / MSE), with one MSE per frame.

    The ratio of equal frames is infinite. Scores are clipped to `ceiling_db`, so that means stay
    finite: beyond 100 dB nobody sees a difference. With `channels = "each"`, the score is the mean
    of the ratios of R, G and B, as in SVG, SRVP and SLAMP; it is never below the joint one.
    """

    ceiling_db: float = 100.0
    channels: Literal["jointly", "each"] = "jointly"

    unit = "dB"

    @property
    def bounds(self) -> tuple[float, float]:
        """Return the lowest and highest value: all pixels wrong by the peak, and the ceiling."""
        return 0.0, self.ceiling_db

    @property
    def protocol(self) -> str:
        """Return the definition in words."""
        texts = {"jointly": "RGB jointly", "each": "mean over R, G and B"}
        return f"{texts[self.channels]}, 8 bit, per frame"

    def score_frame(self, predicted: ByteArray, target: ByteArray, masks: BoolArray) -> FloatArray:
        """Return decibels under each mask."""
        squares = np.square(predicted.astype(np.int32) - target)
        if self.channels == "jointly":
            squares = squares.mean(axis=-1, keepdims=True)
        errors = masked_means(squares, masks)  # [M, channels]
        with np.errstate(divide="ignore"):
            decibels = 10.0 * np.log10(255.0**2 / errors)
        return np.minimum(decibels, self.ceiling_db).mean(axis=-1)


@dataclass(frozen=True)
class Ssim(MaskedMetric):
    """Structural similarity (Wang et al. 2004).

    The window is a Gaussian of 11 pixels and sigma 1.5; K = (.01, .03). scikit-image computes the
    map of each channel. The score is the mean over R, G and B and over the windows inside the
    frame. A mask selects windows by their centre pixel; they extend over unmasked neighbours, too.

    Other settings serve comparison with published numbers.
    """

    # "uniform" is scikit-image's default: 7 pixels, sample variances.
    window: Literal["gaussian", "uniform"] = "gaussian"
    # L of the constants over the real range; 2 is what scikit-image took for fractions before 0.20.
    data_range: float = 1.0
    # "zero" takes windows around all pixels and black beyond the border.
    border: Literal["valid", "zero"] = "valid"

    bounds = (-1.0, 1.0)

    @property
    def min_size_px(self) -> int:
        """Return the width of the window."""
        return 11 if self.window == "gaussian" else 7

    @property
    def protocol(self) -> str:
        """Return the definition in words."""
        windows = {
            "gaussian": "Gaussian 11 px, sigma 1.5",
            "uniform": "uniform 7 px, sample variances",
        }
        borders = {"valid": "valid region", "zero": "zero padding"}
        text = f"Wang 2004, {windows[self.window]}, {borders[self.border]}, mean over RGB"
        if self.data_range != 1:
            text += f", data range {self.data_range:g} for values of range 1"
        return text

    def score_frame(self, predicted: ByteArray, target: ByteArray, masks: BoolArray) -> FloatArray:
        """Return the similarity under each mask (Wang et al. 2004, eq. 13)."""
        is_gaussian = self.window == "gaussian"
        radius = self.min_size_px // 2
        if self.border == "zero":
            margins = ((radius, radius), (radius, radius), (0, 0))
            predicted = np.pad(predicted, margins)
            target = np.pad(target, margins)
            masks = np.pad(masks, ((0, 0), *margins[:2]))
        _, similarity = structural_similarity(
            predicted,
            target,
            data_range=255.0 * self.data_range,
            channel_axis=-1,
            gaussian_weights=is_gaussian,
            sigma=1.5,
            use_sample_covariance=not is_gaussian,
            full=True,
        )
        valid = slice(radius, -radius)
        means = similarity[valid, valid].mean(axis=-1)
        return masked_means(means, masks[:, valid, valid])


def check_frames(predicted: ByteArray, target: ByteArray, mask: BoolArray | None) -> None:
    """Raise BadData unless frames are uint8 [F, H, W, 3] of one shape and the mask fits."""
    shape = target.shape[:3]
    for name, frames in (("predicted", predicted), ("target", target)):
        if frames.dtype != np.uint8 or frames.shape != (*shape, 3):
            raise BadData(
                f"metric: {name} frames are {frames.dtype} of shape {frames.shape}, expected uint8 "
                f"[F, H, W, 3] like the target's {target.shape}"
            )
    if mask is not None and (mask.dtype != bool or mask.shape != shape):
        raise BadData(
            f"metric: mask is {mask.dtype} of shape {mask.shape}, expected bool of shape {shape}"
        )


def masked_means(values: FloatArray, masks: BoolArray) -> FloatArray:
    """Return the means of values [H, W, ...] over masks [M, H, W]; NaN for an empty mask."""
    with np.errstate(invalid="ignore"):
        return np.stack([values[mask].sum(axis=0) / mask.sum() for mask in masks])
