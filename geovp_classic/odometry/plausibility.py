"""Plausibility checks of a vehicle's trajectory."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Plausibility:
    """Checks of a vehicle's trajectory in any unit."""

    max_sideways_ratio: float = 0.5  # to the motion along the axis
    step_tolerance: float = 0.3  # of a median step, from constant acceleration
    min_inlier_fraction: float = (
        0.6  # with fewer the acceleration is not constant
    )

    def is_sideways(self, world_from_cam: FloatArray) -> bool:
        """Return whether poses [P, 4, 4] move more to the side than those of a vehicle."""
        steps = se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:]
        distance = np.abs(steps[:, :3, 3]).sum(axis=0)
        return bool(distance[0] > self.max_sideways_ratio * distance[2])

    def fits_acceleration(
        self,
        world_from_cam: FloatArray,  # [P, 4, 4]
        times_s: FloatArray,  # [P]
    ) -> BoolArray:
        """Return which poses [P] agree with a constant acceleration along the path.

        This is a least median of squares (Rousseeuw 1984) over parabolas through three poses. All
        agree if no step goes backwards among forward ones, or if no parabola fits most poses.
        """
        all_inliers = np.ones(len(times_s), dtype=bool)
        if len(times_s) < 5:
            return all_inliers
        ahead = (se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:])[:, 2, 3]
        tolerance = self.step_tolerance * float(np.median(np.abs(ahead)))
        if (ahead >= -tolerance).all():
            return all_inliers
        progress = np.append(0.0, np.cumsum(ahead))
        powers = np.vander(times_s - times_s[0], 3)
        triples = np.array(list(combinations(range(len(times_s)), 3)))
        parabolas = np.linalg.solve(
            powers[triples], progress[triples][..., None]
        )[..., 0]
        errors = np.abs(parabolas @ powers.T - progress)  # [trials, P]
        best = np.median(errors, axis=1).argmin()
        inliers = errors[best] <= tolerance
        return (
            inliers
            if inliers.mean() >= self.min_inlier_fraction
            else all_inliers
        )


def longest_segment(
    tracked: BoolArray,  # [P]
    max_bridged: int,  # images in a row, before tracking restarts
) -> BoolArray:
    """Return which poses [P] belong to the restart with most tracked ones.

    Poses of different restarts are related by continued motion only. The image of a restart, which
    is the last one of a gap, counts as well.
    """
    steps = np.flatnonzero(tracked)
    restarts = np.flatnonzero(np.diff(steps) > max_bridged + 1) + 1
    segments = np.split(steps, restarts)
    segment = max(
        reversed(segments), key=len
    )  # the last one of equally long ones
    is_measured: BoolArray = np.zeros(len(tracked), dtype=bool)
    is_measured[segment] = True
    if len(segment) and segment[0] > steps[0]:
        is_measured[segment[0] - 1] = True
    return is_measured
