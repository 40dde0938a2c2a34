"""Paths and roads on the map, and vehicles that drive along them.

A place on the map is the complex number x + iz in metres. Yaw is 0 towards +z and grows to the
right, towards +x. Multiplication by exp(-i yaw) turns (right + i ahead) from a vehicle to the map.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree

from geovp_classic.data.synthetic.textures import TILE_M, Texture
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, IntArray

Places = npt.NDArray[np.complexfloating[Any]]
STEP_M = 0.25  # between the points of a path


@dataclass(frozen=True)
class CentreLine:
    """A smooth line, sampled every `STEP_M`."""

    points: Places  # [K]
    yaw_rad: FloatArray  # [K]

    def at(self, along_m: FloatArray, right_m: float) -> tuple[Places, FloatArray]:
        """Return places [T] and yaw_rad [T] along the path and to its right.

        Beyond its ends, the path is straight.
        """
        knots_m = np.arange(len(self.points)) * STEP_M
        inside_m = np.clip(along_m, 0.0, knots_m[-1])
        yaw_rad = np.interp(inside_m, knots_m, self.yaw_rad)
        offset = right_m + 1j * (along_m - inside_m)
        places = np.interp(inside_m, knots_m, self.points)
        return places + offset * np.exp(-1j * yaw_rad), yaw_rad

    def locate(self, places: Places) -> tuple[Places, FloatArray]:
        """Return (right + i along) of places [N] from the start, and the yaw of the path [N]."""
        _, nearest = self._tree.query(pairs(places))
        yaw_rad = self.yaw_rad[nearest]
        offset = (places - self.points[nearest]) * np.exp(1j * yaw_rad)
        return offset + 1j * nearest * STEP_M, yaw_rad

    @functools.cached_property
    def _tree(self) -> KDTree:
        return KDTree(pairs(self.points))


def pairs(places: Places) -> FloatArray:
    """Return complex numbers [...] as pairs [..., 2]."""
    return np.stack([places.real, places.imag], axis=-1)


def from_bends(
    bends: Sequence[tuple[float, float]],
    easing_m: float = 2.0,
    start: tuple[float, float] = (0.0, 0.0),
    start_yaw_deg: float = 0.0,
    side: float = 1.0,
) -> CentreLine:
    """Return the path through pieces of (length_m, turn_rad); `side` -1 mirrors the turns.

    The curvature is smoothed like that of a steered car.
    """
    lengths_m, turns_rad = np.transpose(bends)
    num_steps = np.round(lengths_m / STEP_M).astype(int)
    curvature = np.repeat(side * turns_rad / lengths_m, num_steps)
    curvature = gaussian_filter1d(curvature, easing_m / STEP_M, mode="nearest")
    turned_rad = np.append(0.0, np.cumsum(curvature) * STEP_M)
    yaw_rad = np.deg2rad(start_yaw_deg) + turned_rad
    middle_rad = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
    steps = 1j * STEP_M * np.exp(-1j * middle_rad)
    return CentreLine(np.cumsum([complex(*start), *steps]), yaw_rad)


@dataclass(frozen=True)
class Journey:
    """Motion of a vehicle along a path; with negative `right_m` it drives back.

    The speed is constant before the first and after the last of `times_s`, linear in between, and
    smoothed like that of a driver.
    """

    path: CentreLine
    start_m: float  # along the path at time 0
    right_m: float  # of the path
    speeds_m_s: Sequence[float] | FloatArray
    times_s: Sequence[float] | FloatArray = (0.0,)

    def travelled_m(self, times_s: FloatArray) -> FloatArray:
        """Return the distance [T] travelled since time 0."""
        ticks_s = np.arange(-100, 500) / 50
        speeds = np.interp(ticks_s, self.times_s, self.speeds_m_s)
        smooth = gaussian_filter1d(speeds, 0.25 * 50, mode="nearest")
        travelled_m = make_interp_spline(ticks_s, smooth, k=1).antiderivative()
        return travelled_m(times_s) - travelled_m(0.0)

    def place_at(self, times_s: FloatArray) -> tuple[Places, FloatArray]:
        """Return places [T] and yaw_rad [T]."""
        is_oncoming = self.right_m < 0
        travelled_m = self.travelled_m(times_s) * (1 - 2 * is_oncoming)
        place, yaw_rad = self.path.at(self.start_m + travelled_m, self.right_m)
        return place, yaw_rad + np.pi * is_oncoming


def world_from_vehicle(places: Places, yaw_rad: FloatArray) -> FloatArray:
    """Return world_from_vehicle [N, 4, 4] of vehicles on the ground, y down and z ahead."""
    poses = se3.exp(np.pad(yaw_rad[:, None], ((0, 0), (4, 1))))
    poses[:, [0, 2], 3] = pairs(places)
    return poses


@dataclass(frozen=True)
class Roads:
    """Centre lines of one road, or of two straight roads that cross at the origin of the map."""

    paths: list[CentreLine]
    half_width_m: float = 4.6  # of the carriageway: a lane of 3.3 m and a strip for parked cars
    kerb_m: float = 0.2  # width of the stones, a round value
    pavement_m: float = 2.2  # from the road to the grass: two people and a lamp post
    corner_radius_m: float = 6.0  # a car turns in 5 to 6 m
    zebra_m: float = 3.0  # length of a zebra crossing along the road, a round value
    is_plain: bool = False  # asphalt without lines, cracks, stains and grain

    def locate(self, places: Places) -> tuple[Places, FloatArray, FloatArray]:
        """Return (right + i along) of places [N] and yaw_rad on each path [paths, N].

        The third is the signed distance [N] from the kerb, negative on the road.
        """
        rows = [path.locate(places) for path in self.paths]
        located, yaw_rad = map(np.array, zip(*rows, strict=True))
        sides_m = np.abs(located.real) - self.half_width_m
        radius_m = self.corner_radius_m
        inside_m = np.maximum(radius_m - sides_m, 0)
        outside_m = np.maximum(radius_m, sides_m.min(axis=0))
        from_kerb_m = outside_m - np.linalg.norm(inside_m, axis=0)
        return located, yaw_rad, from_kerb_m

    def surface(self, places: Places) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the surface of the ground at places [N].

        Returns its texture [N], the place on the texture [N, 2] in tiles, and the change of that
        place by a step in the world [N, 2, 3].
        """
        located, yaw_rad, from_kerb_m = self.locate(places)
        from_middle_m = np.abs(located.real)
        # The textures of road, kerb, pavement and grass follow each other.
        bands_m = [0.0, self.kerb_m, self.pavement_m]
        texture = Texture.ROAD + np.digitize(from_kerb_m, bands_m)
        is_road = from_kerb_m < 0
        if len(self.paths) > 1:
            from_junction_m = from_middle_m.max(axis=0) - self.half_width_m
            from_junction_m -= self.corner_radius_m + 0.5
            texture[is_road & (from_junction_m < self.zebra_m)] = Texture.ZEBRA
            texture[is_road & (from_junction_m < 0)] = Texture.ASPHALT
        if self.is_plain:
            texture[is_road] = Texture.PLAIN_ROAD

        pick = (from_middle_m.argmin(axis=0), np.arange(len(places)))
        is_lane = np.isin(texture, (Texture.ROAD, Texture.ZEBRA))
        right = np.where(is_lane, np.exp(-1j * yaw_rad[pick]), 1)
        in_lane = located[pick] + self.half_width_m
        on_texture = np.where(is_lane, in_lane, places)
        axes = pairs(np.stack([right, 1j * right], axis=1))  # [N, 2, 2]
        tile_m = TILE_M[texture]
        uv_axes = np.insert(axes, 1, 0, axis=-1) / tile_m[..., None]
        return texture, pairs(on_texture) / tile_m, uv_axes
