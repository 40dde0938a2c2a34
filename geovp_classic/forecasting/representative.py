"""A few futures that stand for a whole distribution: a quantisation of it (Graf & Luschgy 2000),
for any forecaster.

Independent draws waste their number: most lie where others do. Here each next future is the one of
many draws that brings all of them nearest to a chosen one (greedy k-medoids), so that few futures
suffice to have one near the truth, as minADE and the best of N reward. Distances are motions in the
image, where metres and degrees are comparable.
"""

from dataclasses import dataclass, field

import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, IntArray, Trajectory

DEPTH_M = 10.0  # of what the camera sees: a metre to the side moves it as much as 1 / 10 rad
AHEAD_SHARE = (
    0.5  # a metre ahead moves the image half as much as one to the side, halfway to its border
)
ROLL_SHARE = 0.5  # and a turn about the axis half as much as one of the axis
FARTHEST_RAD = 0.04  # beyond it two images have nothing in common, and more distance costs no more
NUM_STEPS = 10  # future steps that are compared, at the most


@dataclass(frozen=True)
class Representative:
    """The first future is the source's centre, each further one the draw that represents most of
    what is left.

    They are nested: the first k of N futures are those of k. Weights say how likely each is.
    """

    source: Forecaster = field(default_factory=MotionPrior)
    num_draws: int = 200

    def __post_init__(self) -> None:
        if self.num_draws < 2:
            raise BadData(
                f"representative: num_draws is {self.num_draws}, expected 2 or more draws to "
                "choose from"
            )

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        """Futures [S, F, 4, 4]; BadData when more are asked for than there are draws."""
        return self.weighted(past, times_s, num_samples)[0]

    def weighted(
        self, past: Trajectory, times_s: FloatArray, num_samples: int
    ) -> tuple[FloatArray, FloatArray]:
        """Futures [S, F, 4, 4] and the shares [S] of the draws that each is the nearest to; their
        sum is 1.
        """
        centre = self.source.forecast(past, times_s)
        if num_samples == 1 or len(times_s) == 0:
            return np.repeat(centre, num_samples, axis=0), np.full(num_samples, 1 / num_samples)
        if num_samples > self.num_draws:
            raise BadData(
                f"representative: {num_samples} of {self.num_draws} draws asked for: set "
                "num_draws higher"
            )
        draws = self.source.forecast(past, times_s, self.num_draws)
        motions = image_motions(centre[0], draws, past_motion.in_metres(past)[1])
        chosen, nearest = _medoids(motions, num_samples)
        shares = np.bincount(nearest, minlength=num_samples) / self.num_draws
        return np.concatenate([centre, draws[chosen]]), np.asarray(shares)


def image_motions(
    centre: FloatArray,  # [F, 4, 4]
    futures: FloatArray,  # [S, F, 4, 4]
    metres_per_unit: float = 1.0,  # of both
) -> FloatArray:
    """How futures differ from the centre at NUM_STEPS steps [S, K, 6], as angles in the image
    (rad).
    """
    steps = np.unique(np.linspace(0, len(centre) - 1, NUM_STEPS).round().astype(int))
    twists = se3.log(se3.inverse(centre[steps]) @ futures[:, steps])
    per_unit = metres_per_unit / DEPTH_M
    return twists * np.array([per_unit, per_unit, AHEAD_SHARE * per_unit, 1.0, 1.0, ROLL_SHARE])


def _medoids(
    motions: FloatArray,  # [S, K, 6]
    count: int,
) -> tuple[IntArray, IntArray]:
    """The chosen draws [count - 1], and for every draw [S] the nearest of the centre (0) and the
    chosen ones.
    """
    squared = (motions**2).sum(axis=-1)  # [S, K]
    products = np.einsum("ski,tki->stk", motions, motions, optimize=True)
    between = np.sqrt(np.maximum(squared[:, None] + squared - 2 * products, 0))
    distance: FloatArray = np.minimum(between, FARTHEST_RAD).mean(axis=-1)  # [S, S]
    least = np.minimum(np.sqrt(squared), FARTHEST_RAD).mean(axis=-1)
    chosen, nearest = np.empty(count - 1, dtype=np.int64), np.zeros(len(motions), dtype=np.int64)
    for k in range(count - 1):
        left = np.minimum(least, distance).sum(axis=1)
        left[chosen[:k]] = np.inf
        chosen[k] = int(left.argmin())
        nearest[distance[chosen[k]] < least] = k + 1
        least = np.minimum(least, distance[chosen[k]])
    return chosen, nearest
