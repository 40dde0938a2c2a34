"""A few representative futures of any forecaster (Graf & Luschgy 2000, quantisation).

Most independent draws lie close together. Here each further future is the draw that brings all
draws closest to a selected one (greedy k-medoids), so that few futures include one near the truth,
as minADE and the best of N reward.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from geovp_classic.errors import BadData
from geovp_classic.forecasting import past_motion
from geovp_classic.forecasting.motion_prior import MotionPrior
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.types import FloatArray, Trajectory


@dataclass(frozen=True)
class ImageDistance:
    """Distance of two futures as the angle by which the image content moves, in rad."""

    # Of the scene: a metre to the side moves it as much as 1 / 10 rad. Walls and parked cars of a
    # street are about as far away.
    depth_m: float = 10.0
    # effect of a metre ahead to a metre aside, half-way to the border
    ahead_ratio: float = 0.5
    roll_ratio: float = 0.5  # effect of a roll to a yaw, half-way to the border as well
    # Images further apart have nothing in common: 10 pixels of 256 at 55 degrees
    max_distance_rad: float = 0.04
    num_steps: int = 10  # future steps that are compared: every other one of the protocol

    def motions(
        self,
        centre: FloatArray,  # [F, 4, 4]
        futures: FloatArray,  # [S, F, 4, 4]
        metres_per_unit: float = 1.0,  # of both
    ) -> FloatArray:
        """Return the motions in the image from the centre to the futures [S, K, 6]."""
        steps = np.linspace(0, len(centre) - 1, self.num_steps).round().astype(int)
        steps = np.unique(steps)
        twists = se3.log(se3.inverse(centre[steps]) @ futures[:, steps])
        rad_per_unit = metres_per_unit / self.depth_m
        twists[..., :3] *= rad_per_unit
        twists[..., 2] *= self.ahead_ratio
        twists[..., 5] *= self.roll_ratio
        return twists

    def between(
        self,
        motions_a: FloatArray,  # [A, K, 6]
        motions_b: FloatArray,  # [B, K, 6]
    ) -> FloatArray:
        """Return the distances [A, B] between futures, averaged over the steps."""
        steps = range(motions_a.shape[1])
        distances = np.stack([cdist(motions_a[:, step], motions_b[:, step]) for step in steps])
        return np.minimum(distances, self.max_distance_rad).mean(axis=0)


@dataclass(frozen=True)
class Representative:
    """The source's central future, followed by its most representative draws.

    They are nested: the first k of N futures are those of k.
    """

    source: Forecaster = MotionPrior()
    # Time and memory grow with the square: 200 take a few milliseconds.
    num_draws: int = 200
    distance: ImageDistance = ImageDistance()

    def __post_init__(self) -> None:
        if self.num_draws < 2:
            raise BadData(f"representative: num_draws is {self.num_draws}, expected 2 or more")

    def forecast(
        self,
        past: Trajectory,
        times_s: FloatArray,  # [F]
        num_samples: int = 1,
    ) -> FloatArray:
        """Return futures [S, F, 4, 4]; raise BadData if there are fewer draws."""
        centre = self.source.forecast(past, times_s)
        if num_samples == 1:
            return centre
        if num_samples > self.num_draws:
            raise BadData(
                f"representative: {num_samples} of {self.num_draws} draws asked for: set "
                "num_draws higher"
            )
        draws = self.source.forecast(past, times_s, self.num_draws)
        futures = np.concatenate([centre, draws])
        metres_per_unit = past_motion.in_metres(past)[1]
        motions = self.distance.motions(centre[0], futures, metres_per_unit)
        selected = _medoids(self.distance.between(motions, motions), num_samples)
        return futures[selected]


def _medoids(
    distances: FloatArray,  # [N, N]
    count: int,
) -> list[int]:
    """Return greedy medoids of items with given distances [N, N]; the first one is item 0."""
    selected = [0]
    closest = distances[0]
    while len(selected) < count:
        remaining = np.minimum(closest, distances).sum(axis=1)
        remaining[selected] = np.inf
        selected.append(remaining.argmin())
        closest = np.minimum(closest, distances[selected[-1]])
    return selected
