"""Multi-view depth where there is parallax, and another depth source where there is none."""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.depth.multiview import Multiview
from geovp_classic.interfaces import DepthSource
from geovp_classic.types import Context, FloatArray, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class Hybrid:
    """Plane sweep, supported by another depth source such as a network.

    Inverse depths are averaged with the confidence of the plane sweep as its weight: near the
    epipole, in the sky and on uniform surfaces, the other source decides. It is first corrected by
    its mean difference from the plane sweep nearby. All settings were chosen on val, with PyDNet.
    """

    other: DepthSource
    sweep: DepthSource = Multiview()
    # Confidence of the plane sweep from which it decides alone
    sufficient_confidence: float = 0.1
    # Standard deviation of the neighbourhood; 0: the other source is not corrected
    correction_px: float = 8.0
    # Mean confidence nearby from which a correction counts fully
    min_support: float = 0.05

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of both sources."""
        return self.other.needs | self.sweep.needs

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth and confidence [P, H, W]; raise the errors of both sources."""
        sweep, reliability = self.sweep.inverse_depths(context.only(self.sweep.needs), past)
        other, confidence = self.other.inverse_depths(context.only(self.other.needs), past)
        # The other source follows the plane sweep nearby, but keeps its own detail.
        if self.correction_px > 0:
            other = np.maximum(other + self._correction(sweep - other, reliability), 0)
        # The plane sweep decides where it is confident, and where the other source knows nothing.
        weight = np.clip(reliability / self.sufficient_confidence, 0, 1)
        weight = np.where(confidence > 0, weight, 1)
        blended = weight * sweep + (1 - weight) * other
        return blended.astype(np.float32), np.maximum(reliability, confidence)

    def _correction(self, difference: FloatArray, reliability: FloatArray) -> FloatArray:
        """Return the mean difference [P, H, W] around each pixel, weighted by reliability."""
        corrections = np.zeros_like(difference)
        for step in np.flatnonzero(reliability.any(axis=(1, 2))):
            total = self._smooth(reliability[step] * difference[step])
            support = self._smooth(reliability[step])
            corrections[step] = total / np.maximum(support, self.min_support)
        return corrections

    def _smooth(self, image: FloatArray) -> FloatArray:
        """Return the Gaussian mean [H, W] around each pixel."""
        return cv2.GaussianBlur(image, (0, 0), self.correction_px)
