"""Lines on the map that roads, lanes and cars follow, and the gentle hills they lie on.

A place on the map is (x, z) in metres; yaw is 0 towards +z and grows to the right, towards +x.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

STEP_M = 0.25


@dataclass(frozen=True)
class Path:
    """A smooth line, sampled every STEP_M."""

    points: FloatArray  # [K, 2] as (x, z)
    yaw_rad: FloatArray  # [K]

    @property
    def length_m(self) -> float:
        """How far it goes."""
        return (len(self.points) - 1) * STEP_M

    def at(
        self,
        along_m: FloatArray | float,  # [...]
        right_m: FloatArray | float = 0.0,  # [...], offset to the right
    ) -> tuple[FloatArray, FloatArray]:
        """Places [..., 2] and yaw_rad [...]; beyond its ends the path goes straight on."""
        along = np.asarray(along_m, dtype=np.float64)
        inside = np.clip(along, 0.0, self.length_m)
        known_m = np.arange(len(self.points)) * STEP_M
        yaw_rad = np.interp(inside, known_m, self.yaw_rad)
        place = np.stack([np.interp(inside, known_m, self.points[:, axis]) for axis in (0, 1)], axis=-1)
        ahead, right = _directions(yaw_rad)
        beyond = (along - inside)[..., None]
        return place + beyond * ahead + np.asarray(right_m)[..., None] * right, yaw_rad

    def locate(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the places [N, 2] lie: metres along [N] and to the right [N] of the nearest point."""
        nearest = self._tree.query(places)[1]
        ahead, right = _directions(self.yaw_rad[nearest])
        offset = places - self.points[nearest]
        along_m = nearest * STEP_M + (offset * ahead).sum(axis=-1)
        right_m = (offset * right).sum(axis=-1)
        beyond = np.maximum(-along_m, along_m - self.length_m)
        return along_m, np.where(beyond > STEP_M, np.copysign(np.hypot(right_m, beyond), right_m), right_m)

    @functools.cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    def shifted(self, offset: FloatArray) -> Path:
        """The same line moved by (x, z)."""
        return Path(self.points + offset, self.yaw_rad)


def from_bends(bends: Sequence[tuple[float, float]], easing_m: float = 2.0) -> Path:
    """The path from the origin towards +z through pieces of (length_m, turn_rad), eased like a steered car's."""
    curvature = np.concatenate([np.full(round(length_m / STEP_M), turn_rad / length_m) for length_m, turn_rad in bends])
    curvature = gaussian_filter1d(curvature, easing_m / STEP_M, mode="nearest")
    yaw_rad = np.concatenate([[0.0], np.cumsum(curvature) * STEP_M])
    middle_rad = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
    steps = STEP_M * np.stack([np.sin(middle_rad), np.cos(middle_rad)], axis=-1)
    return Path(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), yaw_rad)


def straight(start: tuple[float, float], yaw_rad: float, length_m: float) -> Path:
    """A straight line on the map."""
    along = np.arange(round(length_m / STEP_M) + 1) * STEP_M
    direction = np.array([np.sin(yaw_rad), np.cos(yaw_rad)])
    return Path(np.asarray(start) + along[:, None] * direction, np.full(len(along), yaw_rad))


@dataclass(frozen=True)
class Terrain:
    """Gentle hills: a sum of waves over the map."""

    amplitudes_m: FloatArray  # [W]
    waves_rad_m: FloatArray  # [W, 2], wave vectors
    phases_rad: FloatArray  # [W]

    def height_m(self, places: FloatArray) -> FloatArray:
        """Height [...] above the datum at places [..., 2]."""
        return np.sin(places @ self.waves_rad_m.T + self.phases_rad) @ self.amplitudes_m

    def slope(self, places: FloatArray) -> FloatArray:
        """The gradient [..., 2] of the height."""
        steepness = np.cos(places @ self.waves_rad_m.T + self.phases_rad) * self.amplitudes_m
        return steepness @ self.waves_rad_m

    def lifted(self, points: FloatArray) -> FloatArray:
        """Points [..., 3] raised by the height below them; y points down."""
        raised = np.array(points, dtype=np.float64)
        raised[..., 1] -= self.height_m(points[..., [0, 2]])
        return raised

    def stand(self, places: FloatArray, yaw_rad: FloatArray) -> FloatArray:
        """world_from_vehicle [..., 4, 4] of vehicles on the ground: x right, y down along its normal, z ahead."""
        slope = self.slope(places)
        down = np.stack([slope[..., 0], np.ones(slope.shape[:-1]), slope[..., 1]], axis=-1)
        down /= np.linalg.norm(down, axis=-1, keepdims=True)
        heading = np.stack([np.sin(yaw_rad), np.zeros_like(yaw_rad), np.cos(yaw_rad)], axis=-1)
        right = np.cross(down, heading)
        right /= np.linalg.norm(right, axis=-1, keepdims=True)
        rotation = np.stack([right, down, np.cross(right, down)], axis=-1)
        position = np.stack([places[..., 0], -self.height_m(places), places[..., 1]], axis=-1)
        return se3.compose(rotation, position)


def rolling(rng: np.random.Generator, steepest: float) -> Terrain:
    """Hills of wavelengths 60 to 200 m whose slopes stay below about `steepest` (0.03 = 3 %)."""
    lengths_m, directions_rad = rng.uniform(60, 200, 4), rng.uniform(0, 2 * np.pi, 4)
    waves = 2 * np.pi / lengths_m[:, None] * np.stack([np.sin(directions_rad), np.cos(directions_rad)], axis=-1)
    amplitudes_m = steepest / 4 * lengths_m / (2 * np.pi) * rng.uniform(0.6, 1.4, 4)
    return Terrain(amplitudes_m, waves, rng.uniform(0, 2 * np.pi, 4))


def _directions(yaw_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors [..., 2] ahead and to the right."""
    sin, cos = np.sin(yaw_rad), np.cos(yaw_rad)
    return np.stack([sin, cos], axis=-1), np.stack([cos, -sin], axis=-1)
