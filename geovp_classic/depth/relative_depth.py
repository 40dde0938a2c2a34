"""Alignment of relative depth with multi-view depth.

Networks predict inverse depth up to a scale and a shift (Ranftl et al. 2022). Both are fitted to
reliable pixels of a plane sweep, whose noise is about uniform in inverse depth.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from geovp_classic.depth.multiview import Multiview
from geovp_classic.errors import Incompatible
from geovp_classic.geometry.robust import irls
from geovp_classic.interfaces import DepthSource
from geovp_classic.types import Context, FloatArray, PrivilegedInput, Trajectory

DepthValues = Literal["depth", "inverse-depth", "disparity"]


def inverse_of(values: FloatArray, kind: DepthValues, unit: float = 1.0) -> FloatArray:
    """Return inverse depth of the same shape, float32.

    `unit` is that of a value: metres, or 1/m of inverse depth and disparities. Negative values and
    a depth of 0 are unknown: NaN.
    """
    if kind == "depth":
        is_known = values > 0
        inverse_depth: FloatArray = 1 / (unit * np.where(is_known, values, 1))
    else:
        is_known = values >= 0
        inverse_depth = unit * values
    return np.where(is_known, inverse_depth, np.nan).astype(np.float32)


def metric(
    inverse_depths: FloatArray,  # [P, H, W] per metre; NaN = unknown
    past: Trajectory,
) -> tuple[FloatArray, FloatArray]:
    """Return inverse depth and confidence [P, H, W]: 1 where it is known, else 0.

    Raises Incompatible if the poses are not metric.
    """
    if not past.is_metric:
        raise Incompatible(
            "the depth maps are in metres, the poses are not: give the odometry a scale, or set "
            "align = true"
        )
    is_known = np.isfinite(inverse_depths)
    return np.where(is_known, inverse_depths, 0), is_known.astype(np.float32)


@dataclass(frozen=True)
class DepthAlignment:
    """Robust scale and shift of relative inverse depth."""

    reference: DepthSource = Multiview()
    # Of pixels of the reference that are fitted: half of the scale from 0 to 1.
    min_confidence: float = 0.5
    min_pixels: int = 200  # a hundred per parameter
    # Noise of the reference is at least this fraction of its median inverse depth: the median error
    # of a sweep in tests.
    min_noise: float = 0.02
    num_rounds: int = 20  # of the reweighted fit; it converges in fewer

    @property
    def needs(self) -> PrivilegedInput:
        """Return the inputs of the reference."""
        return self.reference.needs

    def align(
        self,
        relative: FloatArray,  # [P, H, W], larger is nearer; NaN = unknown
        context: Context,
        past: Trajectory,
    ) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth and confidence [P, H, W], in the unit of the past.

        The confidence is 1 where `relative` is known, and 0 in frames without enough reliable
        pixels of the reference, as of a stationary camera.
        """
        reference, reliability = self.reference.inverse_depths(context, past)
        inverse_depths = np.zeros(relative.shape, np.float32)
        confidence = np.zeros_like(inverse_depths)
        for step in range(len(relative)):
            is_known = np.isfinite(relative[step])
            is_fitted = is_known & (reliability[step] >= self.min_confidence)
            fitted = self.fit(relative[step][is_fitted], reference[step][is_fitted])
            if fitted is not None:
                scale, shift = fitted
                aligned = np.maximum(scale * relative[step] + shift, 0)
                inverse_depths[step] = np.where(is_known, aligned, 0)
                confidence[step] = is_known
        return inverse_depths, confidence

    def fit(
        self,
        relative: FloatArray,  # [N]
        reference: FloatArray,  # [N], inverse depth
    ) -> tuple[float, float] | None:
        """Return scale and shift from relative to reference; None if they cannot be fitted.

        Residuals have Cauchy's weights. The scale must be positive: otherwise the maps contradict
        each other.
        """
        if len(relative) < self.min_pixels or np.ptp(relative) == 0:
            return None
        # Both sides are normalised, so that the fit is well conditioned in any unit.
        unit = float(np.median(reference)) or 1.0
        centre = float(relative.mean())
        spread = float(relative.std())
        normalised = (relative - centre) / spread
        jacobian = np.stack([normalised, np.ones(len(relative))], axis=1).astype(np.float64)
        target = reference / unit

        def linearise(state: FloatArray) -> tuple[FloatArray, FloatArray]:
            return jacobian @ state - target, jacobian

        def noise(residual: FloatArray) -> float:
            # A normal distribution's standard deviation is 1.4826 times its median deviation.
            return max(1.4826 * float(np.median(np.abs(residual))), self.min_noise)

        start = np.linalg.lstsq(jacobian, target, rcond=None)[0]
        slope, level = irls(start, linearise, np.add, noise, num_rounds=self.num_rounds)
        if slope <= 0:
            return None
        scale = unit * slope / spread
        return float(scale), float(unit * level - scale * centre)
