"""Paths and roads on the map.

A place on the map is (x, z) in metres. Yaw is 0 towards +z and grows to the right, towards +x.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.distance import cdist

from geovp_classic.types import FloatArray

STEP_M = 0.25  # between the points of a path


@dataclass(frozen=True)
class Path:
    """A smooth line, sampled every STEP_M."""

    points: FloatArray  # [K, 2] as (x, z)
    yaw_rad: FloatArray  # [K]

    @property
    def length_m(self) -> float:
        """Return the length of the path."""
        return (len(self.points) - 1) * STEP_M

    def at(
        self, along_m: FloatArray | float, right_m: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return places [..., 2] and yaw_rad [...] along the path and to its right.

        Beyond its ends, the path is straight.
        """
        inside_m = np.clip(along_m, 0.0, self.length_m)
        knots_m = np.arange(len(self.points)) * STEP_M
        yaw_rad = np.interp(inside_m, knots_m, self.yaw_rad)
        x, z = (
            np.interp(inside_m, knots_m, values) for values in self.points.T
        )
        ahead, right = _directions(yaw_rad)
        beyond_m = np.asarray(along_m - inside_m)[..., None]
        offset = beyond_m * ahead + np.asarray(right_m)[..., None] * right
        return np.stack([x, z], axis=-1) + offset, yaw_rad

    def right_m(self, places: FloatArray) -> FloatArray:
        """Return how far right [N] of the nearest point of the path the places [N, 2] lie."""
        nearest = cdist(places, self.points).argmin(axis=-1)
        _, right = _directions(self.yaw_rad[nearest])
        return ((places - self.points[nearest]) * right).sum(axis=-1)


def from_bends(
    bends: Sequence[tuple[float, float]], easing_m: float = 2.0
) -> Path:
    """Return the path from the origin towards +z through pieces of (length_m, turn_rad).

    The curvature is smoothed like that of a steered car.
    """
    pieces = [
        np.full(round(length_m / STEP_M), turn / length_m)
        for length_m, turn in bends
    ]
    curvature = gaussian_filter1d(
        np.concatenate(pieces), easing_m / STEP_M, mode="nearest"
    )
    yaw_rad = np.concatenate([[0.0], np.cumsum(curvature) * STEP_M])
    steps, _ = _directions(0.5 * (yaw_rad[1:] + yaw_rad[:-1]))
    points = np.cumsum(STEP_M * steps, axis=0)
    return Path(np.concatenate([np.zeros((1, 2)), points]), yaw_rad)


def straight(
    start: tuple[float, float], yaw_rad: float, length_m: float
) -> Path:
    """Return a straight line on the map."""
    ahead, _ = _directions(np.array(yaw_rad))
    along_m = np.arange(round(length_m / STEP_M) + 1) * STEP_M
    return Path(
        np.asarray(start) + along_m[:, None] * ahead,
        np.full(len(along_m), yaw_rad),
    )


@dataclass(frozen=True)
class Roads:
    """Centre lines of one road, or of two straight roads that cross at the origin of the map."""

    paths: list[Path]
    crossing_m: tuple[float, ...] = ()  # along each path
    half_width_m: float = 4.6  # of the carriageway
    kerb_height_m: float = 0.12
    corner_radius_m: float = 6.0
    zebra_m: float = 3.0  # length of a zebra crossing along the road

    @property
    def junction_m(self) -> float:
        """Return the distance from the middle of a junction to its zebra crossings."""
        return self.half_width_m + self.corner_radius_m + 0.5

    def distance_m(self, places: FloatArray) -> FloatArray:
        """Return the signed distance [N] of places [N, 2] from the kerb, negative on the road."""
        sides_m = [
            np.abs(path.right_m(places)) - self.half_width_m
            for path in self.paths
        ]
        if len(sides_m) == 1:
            return sides_m[0]
        outside_m = np.minimum(*sides_m)
        inside_m = [
            np.maximum(self.corner_radius_m - side_m, 0) for side_m in sides_m
        ]
        return np.maximum(self.corner_radius_m, outside_m) - np.hypot(*inside_m)

    def kerbs(self) -> list[FloatArray]:
        """Return each kerb as places [K, 2] with the road on the left."""
        if self.crossing_m:
            return self._junction_kerbs()
        along_m = np.arange(0.0, self.paths[0].length_m)
        right, _ = self.paths[0].at(along_m, self.half_width_m)
        left, _ = self.paths[0].at(along_m, -self.half_width_m)
        return [right, left[::-1]]

    def _junction_kerbs(self) -> list[FloatArray]:
        """Return the kerb around each of the four corners."""
        centre_m = self.half_width_m + self.corner_radius_m
        reach_m = np.arange(300.0, centre_m, -1.0)
        angle_rad = np.linspace(0, np.pi / 2, 13)
        arc_x = centre_m - self.corner_radius_m * np.cos(angle_rad)
        arc_z = centre_m - self.corner_radius_m * np.sin(angle_rad)
        edge_m = np.full_like(reach_m, self.half_width_m)
        x = np.concatenate([edge_m, arc_x, reach_m[::-1]])
        z = -np.concatenate([reach_m, arc_z, edge_m])
        corner = np.stack([x, z], axis=-1)
        quarter_turn = np.array([[0.0, -1.0], [1.0, 0.0]])
        return [
            corner @ np.linalg.matrix_power(quarter_turn, turns)
            for turns in range(4)
        ]


def _directions(yaw_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors [..., 2] ahead and to the right."""
    sin = np.sin(yaw_rad)
    cos = np.cos(yaw_rad)
    return np.stack([sin, cos], axis=-1), np.stack([cos, -sin], axis=-1)
