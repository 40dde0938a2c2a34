"""Recorded depth as a depth source: the upper bound for the estimated ones."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.types import Context, FloatArray, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class Given:
    """The recorded depth of the observed frames, in metres."""

    needs = PrivilegedInput.PAST_DEPTHS

    def inverse_depths(self, context: Context, past: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Return inverse depth [P, H, W] per metre and confidence [P, H, W]: 1 where depth is
        recorded, 0 where it is unknown.

        Incompatible when the clip has no depth or the poses are not in metres.
        """
        if context.past_depths is None:
            raise Incompatible(
                "given depth needs recorded depth, the clip has none: choose an estimating "
                "depth source"
            )
        if not past.is_metric:
            raise Incompatible(
                "recorded depth is in metres, the poses are not: give the odometry a scale"
            )
        depths = context.past_depths
        if not (depths >= 0).all():
            raise BadData(
                "recorded depth has negative numbers or NaN: write 0 where it is unknown, inf "
                "for the sky"
            )
        confidence = (depths > 0).astype(np.float32)
        inverse_depths = confidence / np.where(depths > 0, depths, 1)
        return inverse_depths.astype(np.float32), confidence
