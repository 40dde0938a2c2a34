"""Paths and roads on the map.

A place on the map is (x, z) in metres. Yaw is 0 towards +z and grows to the right, towards +x.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree

from geovp_classic.data.synthetic.textures import TILE_M, Texture
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray, IntArray

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
        ahead, right = directions(yaw_rad)
        beyond_m = np.asarray(along_m - inside_m)[..., None]
        offset = beyond_m * ahead + np.asarray(right_m)[..., None] * right
        return np.stack([x, z], axis=-1) + offset, yaw_rad

    def locate(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return where places [N, 2] lie as [N, 2] (right, along), and the yaw of the path [N]."""
        _, nearest = self._tree.query(places)
        yaw_rad = self.yaw_rad[nearest]
        ahead, right = directions(yaw_rad)
        offset = places - self.points[nearest]
        right_m = (offset * right).sum(axis=-1)
        along_m = nearest * STEP_M + (offset * ahead).sum(axis=-1)
        return np.stack([right_m, along_m], axis=-1), yaw_rad

    @functools.cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.points)


def directions(yaw_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors [..., 2] ahead and to the right."""
    sin = np.sin(yaw_rad)
    cos = np.cos(yaw_rad)
    return np.stack([sin, cos], axis=-1), np.stack([cos, -sin], axis=-1)


def world_from_vehicle(places: FloatArray, yaw_rad: FloatArray) -> FloatArray:
    """Return world_from_vehicle [N, 4, 4] of vehicles on the ground, y down and z ahead."""
    turns = np.pad(yaw_rad[:, None], ((0, 0), (4, 1)))
    poses = se3.exp(turns)
    poses[:, [0, 2], 3] = places
    return poses


def from_bends(
    bends: Sequence[tuple[float, float]],
    easing_m: float = 2.0,
    start: tuple[float, float] = (0.0, 0.0),
    start_yaw_rad: float = 0.0,
) -> Path:
    """Return the path through pieces of (length_m, turn_rad).

    The curvature is smoothed like that of a steered car.
    """
    pieces = [
        np.full(round(length_m / STEP_M), turn / length_m)
        for length_m, turn in bends
    ]
    curvature = gaussian_filter1d(
        np.concatenate(pieces), easing_m / STEP_M, mode="nearest"
    )
    yaw_rad = start_yaw_rad + np.append(0.0, np.cumsum(curvature) * STEP_M)
    steps, _ = directions(0.5 * (yaw_rad[1:] + yaw_rad[:-1]))
    points = np.cumsum([start, *(STEP_M * steps)], axis=0)
    return Path(points, yaw_rad)


@dataclass(frozen=True)
class Roads:
    """Centre lines of one road, or of two straight roads that cross at the origin of the map."""

    paths: list[Path]
    crossing_m: tuple[float, ...] = ()  # along each path
    half_width_m: float = 4.6  # of the carriageway
    kerb_m: float = 0.2  # width of the stones
    pavement_m: float = 2.2  # from the road to the grass
    corner_radius_m: float = 6.0
    zebra_m: float = 3.0  # length of a zebra crossing along the road

    def distance_m(self, places: FloatArray) -> FloatArray:
        """Return the signed distance [N] of places [N, 2] from the kerb, negative on the road."""
        right_m = [path.locate(places)[0][:, 0] for path in self.paths]
        return self._from_kerb_m(np.array(right_m))

    def _from_kerb_m(self, right_m: FloatArray) -> FloatArray:
        """Return distances from the kerb [N] for places to the right [paths, N] of the paths."""
        sides_m = np.abs(right_m) - self.half_width_m
        if len(sides_m) == 1:
            return sides_m[0]
        radius_m = self.corner_radius_m
        inside_m = np.maximum(radius_m - sides_m, 0)
        return np.maximum(radius_m, sides_m.min(axis=0)) - np.hypot(*inside_m)

    def surface(
        self, places: FloatArray
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the surface of the ground at places [N, 2].

        Returns its texture [N], the place on the texture [N, 2] in tiles, and the change of that
        place by a step in the world [N, 2, 3].
        """
        located = [path.locate(places) for path in self.paths]
        from_path_m = np.array([place for place, _ in located])  # [paths, N, 2]
        from_kerb_m = self._from_kerb_m(from_path_m[..., 0])
        # The textures of road, kerb, pavement and grass follow each other.
        bands_m = [0.0, self.kerb_m, self.pavement_m]
        texture = Texture.ROAD + np.digitize(from_kerb_m, bands_m)
        is_road = from_kerb_m < 0

        nearest = np.abs(from_path_m[..., 0]).argmin(axis=0)
        pick = (nearest, np.arange(len(places)))
        on_road_m = from_path_m[pick] + [self.half_width_m, 0.0]
        ahead, right = directions(np.array([yaw for _, yaw in located])[pick])
        if self.crossing_m:
            to_crossing_m = on_road_m[:, 1] - np.array(self.crossing_m)[nearest]
            beyond_m = np.abs(to_crossing_m) - self.half_width_m
            beyond_m -= self.corner_radius_m + 0.5
            texture[is_road & (beyond_m < self.zebra_m)] = Texture.ZEBRA
            texture[is_road & (beyond_m < 0)] = Texture.ASPHALT
        is_lane = np.isin(texture, (Texture.ROAD, Texture.ZEBRA))[:, None]
        axes = np.where(
            is_lane[..., None], np.stack([right, ahead], axis=1), np.eye(2)
        )
        tile_m = TILE_M[texture]
        uv = np.where(is_lane, on_road_m, places) / tile_m
        return texture, uv, np.insert(axes, 1, 0, axis=-1) / tile_m[..., None]
