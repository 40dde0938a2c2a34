"""Structural similarity over several scales (Wang, Simoncelli & Bovik 2003), the score of the FVS
protocol.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.metrics.image import PEAK, check_frames
from geovp_classic.types import BoolArray, ByteArray, FloatArray

WEIGHTS = np.array(
    [0.0448, 0.2856, 0.3001, 0.2363, 0.1333]
)  # of the scales, the finest first: section 3.2
C1, C2 = 0.01**2, 0.03**2  # for values in [0, 1]
RADIUS_PX = 5
KERNEL = cv2.getGaussianKernel(2 * RADIUS_PX + 1, 1.5)
MIN_SIZE_PX = (
    2 * RADIUS_PX * 2 ** (len(WEIGHTS) - 1) + 1
)  # the coarsest scale still holds one window


@dataclass(frozen=True)
class MsSsim:
    """MS-SSIM (Wang, Simoncelli & Bovik 2003, eq. 7): contrast and structure at five scales,
    luminance at the last.

    The paper leaves choices open; these are those of TensorFlow's and pytorch-msssim's code, which
    published numbers come from. Every channel has a score of its own, and their mean is the
    frame's. Scales are means over 2x2 pixels (a last odd row or column counts twice, as in
    TensorFlow). A negative mean at a scale counts as 0, so that its power is real. With a mask,
    each window counts with the share of masked pixels under its centre.
    """

    unit: ClassVar[str] = ""
    higher_is_better: ClassVar[bool] = True
    bounds: ClassVar[tuple[float, float]] = (0.0, 1.0)
    protocol: ClassVar[str] = (
        "Wang 2003, 5 scales by 2x2 means, Gaussian 11 px, sigma 1.5, valid region, mean over "
        "RGB, negative terms 0"
    )

    def __call__(
        self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None
    ) -> FloatArray:
        """Similarity per frame [F], 0 to 1; BadData when the arrays do not fit together or are
        below 161 pixels.
        """
        return self.over(predicted, target, [mask])[0]

    def over(
        self, predicted: ByteArray, target: ByteArray, masks: Sequence[BoolArray | None]
    ) -> list[FloatArray]:
        """The same for each of several masks; windows are compared once for all."""
        for mask in masks:
            check_frames(predicted, target, mask)
        if min(target.shape[1:3]) < MIN_SIZE_PX:
            raise BadData(
                f"MS-SSIM of frames of shape {target.shape[1:]}, expected at least "
                f"{MIN_SIZE_PX}x{MIN_SIZE_PX} pixels "
                "for its five scales: use larger ones"
            )
        scores = np.empty((len(masks), len(target)))
        for step, (ours, real) in enumerate(zip(predicted, target, strict=True)):
            chosen = (None if mask is None else mask[step] for mask in masks)
            shares = [
                np.ones(real.shape[:2]) if mask is None else mask.astype(np.float64)
                for mask in chosen
            ]
            scores[:, step] = _frame(ours / PEAK, real / PEAK, shares)
        return list(scores)


def _frame(
    predicted: FloatArray,  # [H, W, 3], 0..1
    target: FloatArray,
    shares: Sequence[FloatArray],  # [H, W] each, how much every pixel counts
) -> list[float]:
    """The score under each mask."""
    products = np.ones((len(shares), 3))
    for scale, weight in enumerate(WEIGHTS):
        structure, luminance = _terms(predicted, target)
        terms = structure * luminance if scale == len(WEIGHTS) - 1 else structure
        products *= np.maximum([_weighted_mean(terms, share) for share in shares], 0.0) ** weight
        predicted, target, *shares = (_halved(image) for image in (predicted, target, *shares))
    return [float(product.mean()) for product in products]


def _terms(predicted: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Contrast times structure, and luminance, of each window wholly inside and each channel (eqs.
    1 to 3).
    """
    mean_p, mean_t = _blurred(predicted), _blurred(target)
    variances = _blurred(predicted**2) - mean_p**2 + _blurred(target**2) - mean_t**2
    covariance = _blurred(predicted * target) - mean_p * mean_t
    structure = (2 * covariance + C2) / (variances + C2)
    return structure, (2 * mean_p * mean_t + C1) / (mean_p**2 + mean_t**2 + C1)


def _blurred(image: FloatArray) -> FloatArray:
    inside = slice(RADIUS_PX, -RADIUS_PX)
    return np.asarray(cv2.sepFilter2D(image, -1, KERNEL, KERNEL), dtype=np.float64)[inside, inside]


def _weighted_mean(
    terms: FloatArray,  # [H - 10, W - 10, 3]
    share: FloatArray,  # [H, W]
) -> FloatArray:
    """The mean of each channel [3]; NaN where nothing counts."""
    inner = share[RADIUS_PX:-RADIUS_PX, RADIUS_PX:-RADIUS_PX]
    total = float(inner.sum())
    return np.einsum("hwc,hw->c", terms, inner) / (total if total > 0 else np.nan)


def _halved(image: FloatArray) -> FloatArray:
    """Means over 2x2 pixels of [H, W, ...]."""
    even = np.pad(
        image, [(0, n % 2) for n in image.shape[:2]] + [(0, 0)] * (image.ndim - 2), mode="edge"
    )
    return (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]) / 4
