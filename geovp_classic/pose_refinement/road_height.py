"""The height above the road: future positions drawn to a constant height over the road that the
last image shows.

Recorded rotations are right to hundredths of a degree, recorded heights drift by up to half a
degree of the path, and a camera that comes too high makes the road below it slide. The road ahead
lies in the last image already: the camera's height above it should neither grow nor shrink along
the path.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from geovp_classic.geometry import pinhole
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.types import FloatArray, Intrinsics

NEAR_PLANE = 0.1  # relative difference of inverse depths up to which a pixel is of the road
CORRIDOR = 0.5  # camera heights to both sides of the path that count as the road ahead
NEAREST, FARTHEST = 2.0, 10.0  # camera heights ahead, between which the road is measured
AT_LEAST = 5.0  # camera heights ahead that are measured even for a shorter path
LENGTH = 0.5  # camera heights, of the segments of the road
MIN_SEGMENTS, MIN_PIXELS = 4, 10  # with fewer the slope is 0
ROBUST = 0.012  # camera heights: segments this far off the line count half (Cauchy)
STEEPEST = 0.02  # largest slope that is corrected
# Share of the slope that is corrected: it is nearly as uncertain as the given path's. Chosen on
# train and val.
WEIGHT = 0.4


@dataclass(frozen=True)
class RoadProfile:
    """The road points of an image, in the camera's frame, in units of the camera's height above the
    road.
    """

    ground: GroundPlane
    points: FloatArray  # [N, 3], in camera heights

    @classmethod
    def of(cls, inverse_depth: FloatArray, camera: Intrinsics, ground: GroundPlane) -> Self:
        """The road of an image with this inverse depth [H, W]."""
        plane = ground.inverse_depth(camera)
        is_road = ground.is_near(inverse_depth) & (
            np.abs(inverse_depth - plane) < NEAR_PLANE * plane
        )
        depths = 1 / (inverse_depth[is_road] * ground.height)
        return cls(ground, pinhole.rays(camera)[is_road] * depths[:, None])

    def correct_heights(self, reference_from_cam: FloatArray) -> FloatArray:
        """Poses [F, 4, 4], one after the other, moved along the road's normal; rotations stay."""
        path = reference_from_cam[:, :3, 3]
        better = reference_from_cam.copy()
        distance = np.linalg.norm(path, axis=1, keepdims=True)
        better[:, :3, 3] += WEIGHT * self.slope(path) * distance * self.ground.normal
        return better

    def slope(
        self,
        path: FloatArray,  # [F, 3], future positions
    ) -> float:
        """The slope of the road against the path [F, 3]; 0 where too little road is visible."""
        path = np.concatenate([np.zeros((1, 3)), path]) / self.ground.height
        path = path[: 1 + int(np.argmax(path[:, 2]))]  # while it goes ahead
        path = path[np.concatenate([[True], np.diff(np.maximum.accumulate(path[:, 2])) > 0])]
        if len(path) < 2:
            return 0.0
        last = path[-1] - path[-2]
        path = np.concatenate([path, [path[-1] + last * (FARTHEST + 1) / last[2]]])
        ahead = self.points[:, 2]
        aside = np.abs(self.points[:, 0] - np.interp(ahead, path[:, 2], path[:, 0]))
        end = min(FARTHEST, max(path[-2, 2], AT_LEAST))
        under = (aside < CORRIDOR) & (ahead > NEAREST) & (ahead < end)
        ahead = ahead[under]
        above = self.points[under] @ self.ground.normal - np.interp(
            ahead, path[:, 2], path @ self.ground.normal
        )
        return _robust_slope(*_segments(ahead, above))


def _segments(ahead: FloatArray, above: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The mean distance and the median height of each segment of the road [K]."""
    segment = ((ahead - NEAREST) / LENGTH).astype(int)
    members = [segment == number for number in np.flatnonzero(np.bincount(segment) >= MIN_PIXELS)]
    return np.array([ahead[m].mean() for m in members]), np.array(
        [np.median(above[m]) for m in members]
    )


def _robust_slope(ahead: FloatArray, above: FloatArray) -> float:
    """The slope of a straight line through the segments, by iteratively reweighted
    least squares.
    """
    if len(ahead) < MIN_SEGMENTS:
        return 0.0
    line = np.stack([np.ones_like(ahead), ahead], axis=1)
    weight = np.ones_like(ahead)
    for _ in range(5):
        solution = np.linalg.lstsq(line * weight[:, None], above * weight, rcond=None)[0]
        weight = 1 / np.hypot(1, (above - line @ solution) / ROBUST)
    return float(np.clip(solution[1], -STEEPEST, STEEPEST))
