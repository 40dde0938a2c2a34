"""Prior of driving speeds, for a metric scale where the camera does not see the road."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray, Trajectory

MIN_SPREAD = 0.2  # relative standard deviation from which a scale counts as assumed, not measured


@dataclass(frozen=True)
class SpeedPrior:
    """Log-normal distribution of a moving car's mean speed over a second.

    The defaults are fitted to KITTI odometry (Geiger et al. 2012) by `geovp forecast fit-speeds`.
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


def fit(
    drives: Mapping[str, Trajectory], others: Mapping[str, Trajectory]
) -> SpeedPrior:
    """Fit the median to all windows of the drives, and the spread to all sequences.

    Raise BadData if no drive moves.
    """
    log_speeds = [_log_speeds(drive) for drive in drives.values()]
    speeds = np.concatenate([np.zeros(0), *log_speeds])
    if len(speeds) == 0:
        raise BadData(
            f"no drive of {list(drives)} is faster than 0.5 m/s: use other sequences"
        )
    median = float(np.median(speeds))
    log_speeds += [_log_speeds(other) for other in others.values()]
    variances = [
        np.mean((speeds - median) ** 2) for speeds in log_speeds if len(speeds)
    ]
    spread = float(np.sqrt(np.mean(variances)))
    return SpeedPrior(float(np.exp(median)), max(spread, MIN_SPREAD))


def _log_speeds(
    drive: Trajectory,
    num_poses: int = 10,
    stride: int = 5,
    min_speed_m_s: float = 0.5,
) -> FloatArray:
    """Return logarithms [N] of the mean speeds of a drive's windows in which it moves."""
    steps_m = np.linalg.norm(
        np.diff(drive.world_from_cam[:, :3, 3], axis=0), axis=1
    )
    path_m = np.append(0.0, np.cumsum(steps_m))
    first = np.arange(0, len(drive) - num_poses + 1, stride)
    last = first + num_poses - 1
    speeds = (path_m[last] - path_m[first]) / (
        drive.times_s[last] - drive.times_s[first]
    )
    return np.asarray(np.log(speeds[speeds > min_speed_m_s]))
