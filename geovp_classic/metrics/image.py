"""Similarity of predicted and real frames: per pixel (PSNR) and per neighbourhood (SSIM).

The same images score several dB and .15 SSIM apart under the definitions in use, so each metric
states its own in `protocol`, and tables print it. All take uint8 RGB frames [F, H, W, 3] and give
one float64 per frame [F]; with a mask [F, H, W] only its pixels count, and a frame with none scores
NaN.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from skimage.metrics import structural_similarity

from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, ByteArray, FloatArray

PEAK = 255.0
SSIM_SIGMA_PX = 1.5  # Wang et al. 2004, section III-B: 11x11 circular Gaussian
WINDOW_RADIUS_PX = {"gaussian": 5, "uniform": 3}


@dataclass(frozen=True)
class Psnr:
    """Peak signal-to-noise ratio, 10 log10(peak^2 / MSE), with one MSE over all pixels and channels
    of a frame.

    Equal frames have no finite ratio; everything above `ceiling_db` counts as the ceiling, so that
    means stay finite. One grey level wrong in one number of a 256x256 frame is 101.1 dB: beyond 100
    dB nobody sees a difference. With `channels = "each"`, R, G and B have a ratio (and the ceiling)
    each, whose mean is the frame's, as SVG, SRVP and SLAMP compute it; it is never below the joint
    one.
    """

    ceiling_db: float = 100.0
    channels: Literal["jointly", "each"] = "jointly"

    unit: ClassVar[str] = "dB"
    higher_is_better: ClassVar[bool] = True

    @property
    def bounds(self) -> tuple[float, float]:
        """The lowest and highest value: all pixels wrong by the peak, and the ceiling."""
        return 0.0, self.ceiling_db

    @property
    def protocol(self) -> str:
        """The definition in words."""
        return (
            f"{'RGB jointly' if self.channels == 'jointly' else 'mean over R, G and B'}, 8 bit, "
            "per frame"
        )

    def __call__(
        self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None
    ) -> FloatArray:
        """Decibels per frame [F]; BadData when the arrays do not fit together."""
        return self.over(predicted, target, [mask])[0]

    def over(
        self, predicted: ByteArray, target: ByteArray, masks: Sequence[BoolArray | None]
    ) -> list[FloatArray]:
        """The same for each of several masks; differences are computed once for all."""
        for mask in masks:
            check_frames(predicted, target, mask)
        groups = 1 if self.channels == "jointly" else 3
        errors = np.empty((len(masks), len(target), groups))
        for step in range(len(target)):
            squares = np.square(predicted[step].astype(np.int32) - target[step])
            squares = squares.sum(axis=-1, keepdims=True) / 3.0 if groups == 1 else squares
            chosen = (None if mask is None else mask[step] for mask in masks)
            errors[:, step] = [
                [_masked_mean(squares[..., i], mask) for i in range(groups)] for mask in chosen
            ]
        with np.errstate(divide="ignore"):
            return list(
                np.minimum(10.0 * np.log10(PEAK**2 / errors), self.ceiling_db).mean(axis=-1)
            )


@dataclass(frozen=True)
class Ssim:
    """Structural similarity of Wang et al. 2004: Gaussian window of 11 pixels and sigma 1.5, K =
    (.01, .03), peak 255.

    Every channel on its own, averaged over R, G and B and over the windows that lie wholly inside
    the frame, by scikit-image. A mask selects windows by their centre pixel; the windows extend
    over unmasked neighbours, too.

    The other settings are there to compare with published numbers. `window = "uniform"` is
    scikit-image's default (7 pixels, variances of a sample). `data_range` is L of the constants
    over the real range of values: 2 is what scikit-image took for fractions before 0.20. `border =
    "zero"` takes windows around all pixels and black beyond.
    """

    window: Literal["gaussian", "uniform"] = "gaussian"
    data_range: float = 1.0
    border: Literal["valid", "zero"] = "valid"

    unit: ClassVar[str] = ""
    higher_is_better: ClassVar[bool] = True
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    @property
    def protocol(self) -> str:
        """The definition in words."""
        window = (
            "Gaussian 11 px, sigma 1.5"
            if self.window == "gaussian"
            else "uniform 7 px, sample variances"
        )
        border = "valid region" if self.border == "valid" else "zero padding"
        data_range = (
            ""
            if self.data_range == 1
            else f", data range {self.data_range:g} for values of range 1"
        )
        return f"Wang 2004, {window}, {border}, mean over RGB{data_range}"

    def __call__(
        self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None
    ) -> FloatArray:
        """Similarity per frame [F], at most 1; BadData when the arrays do not fit together or are
        below a window.
        """
        return self.over(predicted, target, [mask])[0]

    def over(
        self, predicted: ByteArray, target: ByteArray, masks: Sequence[BoolArray | None]
    ) -> list[FloatArray]:
        """The same for each of several masks; windows are compared once for all."""
        for mask in masks:
            check_frames(predicted, target, mask)
        radius = WINDOW_RADIUS_PX[self.window]
        side = 2 * radius + 1
        if min(target.shape[1:3]) < side:
            raise BadData(
                f"SSIM of frames of shape {target.shape[1:]}, expected at least {side}x{side} "
                "pixels: use larger ones"
            )
        cut = slice(radius, -radius) if self.border == "valid" else slice(None)
        scores = np.empty((len(masks), len(target)))
        for step in range(len(target)):
            similarity = self._map(predicted[step], target[step]).mean(axis=-1)
            scores[:, step] = [
                _masked_mean(similarity, None if mask is None else mask[step, cut, cut])
                for mask in masks
            ]
        return list(scores)

    def _map(
        self,
        predicted: ByteArray,  # [H, W, 3]
        target: ByteArray,  # [H, W, 3]
    ) -> FloatArray:
        """SSIM of every window and channel [H', W', 3] (Wang et al. 2004, eq. 13), H' = H - 2
        radius when valid.
        """
        radius, is_gaussian = WINDOW_RADIUS_PX[self.window], self.window == "gaussian"
        if self.border == "zero":
            predicted, target = (
                np.pad(one, ((radius, radius), (radius, radius), (0, 0)))
                for one in (predicted, target)
            )
        _, similarity = structural_similarity(
            predicted,
            target,
            data_range=PEAK * self.data_range,
            channel_axis=-1,
            gaussian_weights=is_gaussian,
            sigma=SSIM_SIGMA_PX,
            use_sample_covariance=not is_gaussian,
            full=True,
        )
        return np.asarray(similarity)[radius:-radius, radius:-radius]


def check_frames(predicted: ByteArray, target: ByteArray, mask: BoolArray | None) -> None:
    """Raise BadData unless both are uint8 [F, H, W, 3] of one shape and the mask, if any, is bool
    [F, H, W].
    """
    for what, frames in (("predicted", predicted), ("target", target)):
        if (
            frames.dtype != np.uint8
            or frames.ndim != 4
            or frames.shape[-1] != 3
            or frames.shape != target.shape
        ):
            raise BadData(
                f"metric: {what} frames are {frames.dtype} of shape {frames.shape}, expected "
                "uint8 [F, H, W, 3] like"
                f" the target's {target.shape}"
            )
    if mask is not None and (mask.dtype != np.bool_ or mask.shape != target.shape[:3]):
        raise BadData(
            f"metric: mask is {mask.dtype} of shape {mask.shape}, expected bool of shape "
            f"{target.shape[:3]}"
        )


def _masked_mean(values: FloatArray, mask: BoolArray | None) -> float:
    """The mean over the mask's pixels; NaN for none."""
    chosen = values if mask is None else values[mask]
    return float(chosen.mean()) if chosen.size else float("nan")
