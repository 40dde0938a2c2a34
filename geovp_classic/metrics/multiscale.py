"""Structural similarity over several scales, the score of the FVS protocol."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.metrics.image import MaskedMetric
from geovp_classic.types import BoolArray, ByteArray, FloatArray


@dataclass(frozen=True)
class MsSsim(MaskedMetric):
    """MS-SSIM (Wang, Simoncelli & Bovik 2003, eq. 7).

    Contrast and structure count at five scales, luminance at the last. The paper leaves choices
    open; these are TensorFlow's and pytorch-msssim's, which published numbers come from. The score
    is the mean over the channels. Scales are means over 2x2 pixels; a last odd row or column counts
    twice. A negative mean at a scale counts as 0, so that its power is real. With a mask, a window
    counts with the fraction of masked pixels under its centre.
    """

    # of the scales, the finest first (section 3.2)
    exponents = (
        0.0448,
        0.2856,
        0.3001,
        0.2363,
        0.1333,
    )
    bounds = (0.0, 1.0)
    protocol = (
        "Wang 2003, 5 scales by 2x2 means, Gaussian 11 px, sigma 1.5, valid region, mean over "
        "RGB, negative terms 0"
    )

    @property
    def min_size_px(self) -> int:
        """Return the size at which the coarsest scale holds one window."""
        return 161

    def score_frame(self, predicted: ByteArray, target: ByteArray, masks: BoolArray) -> FloatArray:
        """Return the similarity, 0 to 1, under each mask."""
        scores = np.ones((len(masks), 3))
        p: FloatArray = predicted / 255.0
        t: FloatArray = target / 255.0
        weights: FloatArray = np.moveaxis(masks, 0, -1) * 1.0  # [H, W, M]
        for exponent in self.exponents:
            terms, luminance = _compare(p, t)
            if exponent == self.exponents[-1]:
                terms *= luminance
            inner = weights[5:-5, 5:-5]
            with np.errstate(invalid="ignore"):  # NaN where all weights are 0
                means = np.einsum("hwc,hwm->mc", terms, inner) / inner.sum(axis=(0, 1))[:, None]
            scores *= np.maximum(means, 0.0) ** exponent
            p, t, weights = _halved(p), _halved(t), _halved(weights)
        return scores.mean(axis=-1)


def _compare(p: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return contrast times structure, and luminance, of all windows and channels (eqs. 1 to 3)."""
    c1 = 0.01**2
    c2 = 0.03**2
    mean_p = _blurred(p)
    mean_t = _blurred(t)
    variances = _blurred(p**2) - mean_p**2 + _blurred(t**2) - mean_t**2
    covariance = _blurred(p * t) - mean_p * mean_t
    structure = (2 * covariance + c2) / (variances + c2)
    luminance = (2 * mean_p * mean_t + c1) / (mean_p**2 + mean_t**2 + c1)
    return structure, luminance


def _blurred(image: FloatArray) -> FloatArray:
    """Return the Gaussian means of the windows of 11 pixels inside the image."""
    return cv2.GaussianBlur(image, (11, 11), 1.5)[5:-5, 5:-5]


def _halved(image: FloatArray) -> FloatArray:
    """Return the means over 2x2 pixels of [H, W, C]."""
    height_px, width_px, channels = image.shape
    even = np.pad(image, ((0, height_px % 2), (0, width_px % 2), (0, 0)), mode="edge")
    return even.reshape(len(even) // 2, 2, -1, 2, channels).mean(axis=(1, 3))
