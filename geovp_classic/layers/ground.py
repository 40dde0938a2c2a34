"""The ground below the scene: the plane that no static surface lies below.

The inverse depth of a plane is linear in the pixel: q = n . K^-1 (u, v, 1) / h for the plane
n . X = h. Hence a plane is fitted to a depth map by three coefficients.
"""

from dataclasses import dataclass

import numpy as np

from geovp_classic.types import BoolArray, FloatArray


@dataclass(frozen=True)
class GroundFit:
    """RANSAC (Fischler & Bolles 1981) of the lowest plane of a depth map.

    A plane is no ground if much of the scene lies below it, if it does not come nearer towards the
    bottom of the image, or if few points lie on it. Settings were chosen on the synthetic street
    and on videos of other cameras.
    """

    min_confidence: float = 0.5
    max_rows: float = 0.55  # of the image, from below: where the points of the ground are sought
    # Relative, of inverse depths on the plane, as of one surface in two frames
    tolerance: float = 0.1
    # A point below the plane takes away as much as this many points on it
    below_penalty: float = 2.0
    min_points: int = 200
    max_points: int = 1000  # random ones; more cost time
    num_trials: int = 200
    # Of the points below the horizon of the plane
    min_inlier_fraction: float = 0.35
    max_below_fraction: float = 0.2
    max_roll: float = 0.36  # tangent of 20 degrees, of the camera

    def inverse_depths(
        self,
        inverse_depth: FloatArray,  # [H, W]
        confidence: FloatArray,  # [H, W]
    ) -> FloatArray | None:
        """Return the inverse depths [H, W] of the ground, 0 above its horizon; None without it."""
        height, width = inverse_depth.shape
        first = round((1 - self.max_rows) * height)
        is_point = (confidence[first:] > self.min_confidence) & (inverse_depth[first:] > 0)
        rows, columns = np.nonzero(is_point)
        if len(rows) < self.min_points:
            return None
        rng = np.random.default_rng(0)
        drawn = rng.choice(len(rows), min(len(rows), self.max_points), replace=False)
        rows, columns = rows[drawn] + first, columns[drawn]
        points = np.column_stack([columns, rows, np.ones(len(rows))]) / height
        observed = inverse_depth[rows, columns].astype(np.float64)

        # Planes through three points each; of many through points on a line, the smallest one
        triples = rng.integers(len(points), size=(self.num_trials, 3))
        planes = np.linalg.pinv(points[triples]) @ observed[triples][..., None]
        planes = planes[..., 0]
        aside, down, _ = planes.T
        planes = planes[(down > 0) & (np.abs(aside) < self.max_roll * down)]
        if not len(planes):
            return None
        is_on, is_below = self._compare(planes @ points.T, observed)
        score = is_on.sum(axis=1) - self.below_penalty * is_below.sum(axis=1)
        plane = planes[np.argmax(score)]

        # Refine by least squares of relative errors over the inliers.
        for _ in range(3):
            expected = points @ plane
            is_on, _ = self._compare(expected, observed)
            if is_on.sum() < 3:
                return None
            weights = 1 / expected[is_on]
            weighted = points[is_on] * weights[:, None]
            plane = np.linalg.lstsq(weighted, observed[is_on] * weights, rcond=None)[0]

        expected = points @ plane
        is_on, is_below = self._compare(expected, observed)
        num_below_horizon = max((expected > 0).sum(), 1)
        is_ground = is_on.sum() >= self.min_inlier_fraction * num_below_horizon
        is_ground &= is_below.sum() <= self.max_below_fraction * num_below_horizon
        is_ground &= abs(plane[0]) <= self.max_roll * plane[1]
        if not is_ground:
            return None
        row, column = np.mgrid[:height, :width] / height
        ground = plane[0] * column + plane[1] * row + plane[2] / height
        return np.maximum(ground, 0).astype(np.float32)

    def _compare(self, expected: FloatArray, observed: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return which observed inverse depths lie on the expected ones, and which below them."""
        is_ground = expected > 0
        is_on = is_ground & (np.abs(observed - expected) < self.tolerance * expected)
        is_below = is_ground & (observed < (1 - 2 * self.tolerance) * expected)
        return is_on, is_below
