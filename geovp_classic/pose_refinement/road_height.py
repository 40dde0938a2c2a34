"""Height above the road: future positions drawn to a constant height over the road that the last
image shows.

Recorded rotations are right to hundredths of a degree, recorded heights drift by up to half a
degree of the path, and a camera that comes too high makes the road below it slide. The road ahead
lies in the last image already: the camera's height above it should neither grow nor shrink along
the path.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import binned_statistic

from geovp_classic.geometry import pinhole, robust
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.types import FloatArray, Intrinsics


@dataclass(frozen=True)
class RoadProfile:
    """Slope of the road ahead against a path; lengths are camera heights above the road."""

    max_plane_error: float = (
        0.1  # relative difference of inverse depths of a pixel of the road
    )
    corridor_heights: float = (
        0.5  # to both sides of the path, that count as the road ahead
    )
    nearest_heights: float = 2.0  # distances between which the road is measured
    farthest_heights: float = 10.0
    min_range_heights: float = 5.0  # measured even for a shorter path
    segment_heights: float = 0.5  # length of the segments of the road
    min_segments: int = 4  # with fewer the slope is 0
    min_pixels: int = 10  # of a segment
    error_scale_heights: float = (
        0.012  # segments this far off the line have half the weight
    )
    max_slope: float = 0.02  # that is corrected
    # Part of the slope that is corrected: it is nearly as uncertain as the given path's. Chosen on
    # train and val.
    weight: float = 0.4

    def points(
        self,
        inverse_depth: FloatArray,  # [H, W]
        camera: Intrinsics,
        ground: GroundPlane,
    ) -> FloatArray:
        """Return the points [N, 3] of the road in the camera's frame, in camera heights."""
        plane = ground.inverse_depth(camera)
        is_close = np.abs(inverse_depth - plane) < self.max_plane_error * plane
        is_road = ground.is_near(inverse_depth) & is_close
        depths = 1 / (inverse_depth[is_road] * ground.height)
        return pinhole.rays(camera)[is_road] * depths[:, None]

    def correct_heights(
        self,
        reference_from_cam: FloatArray,  # [F, 4, 4], one after the other
        points: FloatArray,  # [N, 3], of the road
        ground: GroundPlane,
    ) -> FloatArray:
        """Return the poses [F, 4, 4] moved along the road's normal; rotations stay."""
        path = reference_from_cam[:, :3, 3]
        distances = np.linalg.norm(path, axis=1, keepdims=True)
        slope = self.slope(path, points, ground)
        corrected = reference_from_cam.copy()
        corrected[:, :3, 3] += self.weight * slope * distances * ground.normal
        return corrected

    def slope(
        self,
        path: FloatArray,  # [F, 3], future positions
        points: FloatArray,  # [N, 3], of the road
        ground: GroundPlane,
    ) -> float:
        """Return the slope of the road against the path; 0 where too little road is visible."""
        path = np.concatenate([np.zeros((1, 3)), path]) / ground.height
        path = path[: 1 + int(np.argmax(path[:, 2]))]  # while it goes ahead
        is_ahead = np.diff(np.maximum.accumulate(path[:, 2]), prepend=-1) > 0
        path = path[is_ahead]
        if len(path) < 2:
            return 0.0
        end = np.clip(
            path[-1, 2], self.min_range_heights, self.farthest_heights
        )
        direction = path[-1] - path[-2]
        beyond = (
            path[-1] + direction * (self.farthest_heights + 1) / direction[2]
        )
        path = np.concatenate([path, [beyond]])
        distance = points[:, 2]
        aside = np.abs(
            points[:, 0] - np.interp(distance, path[:, 2], path[:, 0])
        )
        is_under = aside < self.corridor_heights
        is_under &= (distance > self.nearest_heights) & (distance < end)
        distance = distance[is_under]
        path_height = np.interp(distance, path[:, 2], path @ ground.normal)
        return self._robust_slope(
            distance, points[is_under] @ ground.normal - path_height
        )

    def _robust_slope(self, distance: FloatArray, height: FloatArray) -> float:
        """Return the slope of a straight line through the segments of the road."""
        edges = np.arange(
            self.nearest_heights,
            self.farthest_heights + 0.1,
            self.segment_heights,
        )
        num_pixels = np.histogram(distance, edges)[0]
        is_used = num_pixels >= self.min_pixels
        if is_used.sum() < self.min_segments:
            return 0.0
        means = binned_statistic(distance, distance, "mean", edges).statistic[
            is_used
        ]
        medians = binned_statistic(distance, height, "median", edges).statistic[
            is_used
        ]
        design = np.stack([np.ones_like(means), means], axis=1)

        def linearise(line: FloatArray) -> tuple[FloatArray, FloatArray]:
            return design @ line - medians, design

        line = robust.irls(
            np.zeros(2),
            linearise,
            np.add,
            self.error_scale_heights,
            num_rounds=5,
        )
        return float(np.clip(line[1], -self.max_slope, self.max_slope))
