"""Multi-view depth where there is parallax, and another depth source where there is none."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.depth.multiview import Multiview
from geovp_classic.interfaces import DepthSource
from geovp_classic.types import Context, FloatArray, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class Hybrid:
    """Plane sweep, supported by another depth source such as a network.

    Inverse depths are averaged with the confidence of the plane sweep, from 0 to 1, as its weight:
    near the epipole, in the sky and on uniform surfaces, the other source decides.
    """

    other: DepthSource
    sweep: DepthSource = Multiview()
    # Confidence of the plane sweep from which it decides alone
    sufficient_confidence: float = 0.5

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of both sources."""
        return self.other.needs | self.sweep.needs

    def inverse_depths(
        self, context: Context, past: Trajectory
    ) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth and confidence [P, H, W]; raise the errors of both sources."""
        sweep, reliability = self.sweep.inverse_depths(
            context.only(self.sweep.needs), past
        )
        other, confidence = self.other.inverse_depths(
            context.only(self.other.needs), past
        )
        weight = np.clip(reliability / self.sufficient_confidence, 0, 1)
        weight = np.where(confidence > 0, weight, 1)
        blended = weight * sweep + (1 - weight) * other
        return blended.astype(np.float32), np.maximum(reliability, confidence)
