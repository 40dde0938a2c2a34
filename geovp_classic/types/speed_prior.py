"""Prior of driving speeds, for a metric scale where the camera does not see the road."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData

# Relative standard deviation from which a scale counts as assumed: twice that of measured ones
MIN_SPREAD = 0.2


@dataclass(frozen=True)
class SpeedPrior:
    """Log-normal distribution of a moving car's mean speed over a second.

    The defaults are statistics of KITTI odometry (Geiger et al. 2012).
    The median is that of 00, 02, 08 and 09, which are drives through towns. The spread around it
    also covers 01 and 04, equally weighted: a motorway, with 25 m/s, is two deviations faster.
    """

    median_m_s: float = 9.2
    spread: float = 0.51  # standard deviation of the speed's logarithm

    def __post_init__(self) -> None:
        is_speed = 0 < self.median_m_s < np.inf
        is_spread = MIN_SPREAD <= self.spread < np.inf
        if not (is_speed and is_spread):
            raise BadData(
                f"speed prior: median_m_s is {self.median_m_s:g} and spread {self.spread:g}, "
                f"expected a positive speed and a spread of {MIN_SPREAD:g} or more"
            )
