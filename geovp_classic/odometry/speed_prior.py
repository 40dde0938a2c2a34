"""How fast cars drive: what is left to say of metres where a camera does not see the road."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray, Trajectory

# relative standard deviation above which a scale counts as assumed; measured ones are below it
LEAST_SPREAD = 0.2
AT_REST_M_S = 0.5  # who is slower does not drive
NUM_POSES, STRIDE = 10, 5  # of a window that has one mean speed, and between two windows' starts


@dataclass(frozen=True)
class SpeedPrior:
    """Log-normal mean speeds of a moving car over a second.

    The defaults are of KITTI odometry (Geiger et al. 2012), by `geovp forecast fit-speeds`: the
    median of 00, 02, 08 and 09, which are drives through towns; the spread around it on these and
    on 01 and 04, every sequence with the same say, since a drive elsewhere is off by more than
    these four are from each other. A motorway, with 25 m/s, lies two standard deviations from the
    median.
    """

    median_m_s: float = 9.2
    spread: float = 0.51  # standard deviation of the speed's logarithm

    def __post_init__(self) -> None:
        if not (
            np.isfinite(self.median_m_s)
            and self.median_m_s > 0
            and LEAST_SPREAD <= self.spread < np.inf
        ):
            given = f"median_m_s {self.median_m_s:g} and spread {self.spread:g}"
            raise BadData(
                f"speed prior: {given}, expected a positive speed and a spread of "
                f"{LEAST_SPREAD:g} or more"
            )


def fit(drives: Mapping[str, Trajectory], others: Mapping[str, Trajectory]) -> SpeedPrior:
    """The median of all windows of the drives; the spread is the root mean square over all
    sequences, others as well.

    BadData when nobody drives.
    """
    by_drive = [_log_speeds(drive) for drive in drives.values()]
    moving = [
        speeds
        for speeds in by_drive + [_log_speeds(other) for other in others.values()]
        if len(speeds)
    ]
    if not any(map(len, by_drive)):
        raise BadData(
            f"nobody drives faster than {AT_REST_M_S} m/s in "
            f"{', '.join(drives) or 'no sequence'}: give others"
        )
    median = float(np.median(np.concatenate(by_drive)))
    spread = float(np.sqrt(np.mean([((speeds - median) ** 2).mean() for speeds in moving])))
    return SpeedPrior(float(np.exp(median)), max(spread, LEAST_SPREAD))


def _log_speeds(drive: Trajectory) -> FloatArray:
    """Logarithms [N] of the mean speeds of a drive's windows in which it moves."""
    steps_m = np.linalg.norm(np.diff(drive.world_from_cam[:, :3, 3], axis=0), axis=1)
    path_m = np.append(0.0, np.cumsum(steps_m))
    first = np.arange(0, len(drive) - NUM_POSES + 1, STRIDE)
    last = first + NUM_POSES - 1
    speeds = (path_m[last] - path_m[first]) / (drive.times_s[last] - drive.times_s[first])
    return np.asarray(np.log(speeds[speeds > AT_REST_M_S]))
