"""The map: paths that roads and cars follow, the gentle hills below them, and the ground with its
roads.

A place on the map is (x, z) in metres; yaw is 0 towards +z and grows to the right, towards +x.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.distance import cdist

from geovp_classic.data.synthetic.images import Texture
from geovp_classic.data.synthetic.mesh import WHITE, TriangleMesh, joined, sheet
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

STEP_M = 0.25
HALF_WIDTH_M = 4.6  # of the carriageway
KERB_HEIGHT_M = 0.12
CORNER_RADIUS_M = 6.0
JUNCTION_M = (
    HALF_WIDTH_M + CORNER_RADIUS_M + 0.5
)  # from the middle of a junction to its zebra crossings
ZEBRA_M, ROAD_TILE_M = 3.0, 18.0
STONE = (Texture.ASPHALT, (1.45, 1.45, 1.42))
SURFACES = (
    STONE,
    STONE,
    (Texture.PAVEMENT, WHITE),
    (Texture.GRASS, WHITE),
)  # between the points of the profile
PROFILE_M = np.array(
    [(0, -0.1), (0, 0.12), (0.2, 0.12), (2.2, 0.12), (9, 0.12)]
)  # from the kerb outwards, height
HILLS_M = (
    (288, 304, 330, 450),
    (-0.25, 5, 12, 34),
    (0, 1.5, 3.5, 7),
)  # radii; heights there; of waves on them


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
        self, along_m: FloatArray | float, right_m: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Places [..., 2] and yaw_rad [...]; beyond its ends the path goes straight on."""
        along = np.asarray(along_m, dtype=np.float64)
        inside = np.clip(along, 0.0, self.length_m)
        known_m = np.arange(len(self.points)) * STEP_M
        yaw_rad = np.interp(inside, known_m, self.yaw_rad)
        place = np.stack(
            [np.interp(inside, known_m, self.points[:, axis]) for axis in (0, 1)], axis=-1
        )
        ahead, right = _directions(yaw_rad)
        beyond = (along - inside)[..., None]
        return place + beyond * ahead + np.asarray(right_m)[..., None] * right, yaw_rad

    def right_m(self, places: FloatArray) -> FloatArray:
        """How far to the right [N] of the nearest point of the path the places [N, 2] lie."""
        nearest = cdist(places, self.points).argmin(axis=-1)
        _, right = _directions(self.yaw_rad[nearest])
        return ((places - self.points[nearest]) * right).sum(axis=-1)


def from_bends(bends: Sequence[tuple[float, float]], easing_m: float = 2.0) -> Path:
    """The path from the origin towards +z through pieces of (length_m, turn_rad), eased like a
    steered car's.
    """
    curvature = np.concatenate(
        [np.full(round(length_m / STEP_M), turn_rad / length_m) for length_m, turn_rad in bends]
    )
    curvature = gaussian_filter1d(curvature, easing_m / STEP_M, mode="nearest")
    yaw_rad = np.concatenate([[0.0], np.cumsum(curvature) * STEP_M])
    middle_rad = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
    steps = STEP_M * np.stack([np.sin(middle_rad), np.cos(middle_rad)], axis=-1)
    return Path(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), yaw_rad)


def straight(start: tuple[float, float], yaw_rad: float, length_m: float) -> Path:
    """A straight line on the map."""
    ahead, _ = _directions(np.array(yaw_rad))
    along_m = np.arange(round(length_m / STEP_M) + 1) * STEP_M
    return Path(np.asarray(start) + along_m[:, None] * ahead, np.full(len(along_m), yaw_rad))


@dataclass(frozen=True)
class Terrain:
    """Gentle hills: a sum of waves over the map."""

    amplitudes_m: FloatArray  # [W]
    waves_rad_m: FloatArray  # [W, 2], wave vectors
    phases_rad: FloatArray  # [W]

    def height_m(self, places: FloatArray) -> FloatArray:
        """Height [...] above the datum at places [..., 2]."""
        return np.sin(places @ self.waves_rad_m.T + self.phases_rad) @ self.amplitudes_m

    def points(self, places: FloatArray, above_m: FloatArray | float) -> FloatArray:
        """Points [..., 3] over places [..., 2]; y points down."""
        return np.stack([places[..., 0], -self.height_m(places) - above_m, places[..., 1]], axis=-1)

    def world_from_vehicle(self, places: FloatArray, yaw_rad: FloatArray) -> FloatArray:
        """world_from_vehicle [..., 4, 4] of vehicles on the ground: x right, y down along its
        normal, z ahead.
        """
        slope = (
            np.cos(places @ self.waves_rad_m.T + self.phases_rad)
            * self.amplitudes_m
            @ self.waves_rad_m
        )
        down = np.stack([slope[..., 0], np.ones(slope.shape[:-1]), slope[..., 1]], axis=-1)
        down /= np.linalg.norm(down, axis=-1, keepdims=True)
        heading = np.stack([np.sin(yaw_rad), np.zeros_like(yaw_rad), np.cos(yaw_rad)], axis=-1)
        right = np.cross(down, heading)
        right /= np.linalg.norm(right, axis=-1, keepdims=True)
        rotation = np.stack([right, down, np.cross(right, down)], axis=-1)
        return se3.compose(rotation, self.points(places, 0.0))


def rolling(rng: np.random.Generator, steepest: float) -> Terrain:
    """Hills of wavelengths 60 to 200 m whose slopes stay below about `steepest` (0.03 = 3 %)."""
    lengths_m, directions_rad = rng.uniform(60, 200, 4), rng.uniform(0, 2 * np.pi, 4)
    waves = (
        2
        * np.pi
        / lengths_m[:, None]
        * np.stack([np.sin(directions_rad), np.cos(directions_rad)], axis=-1)
    )
    amplitudes_m = steepest / 4 * lengths_m / (2 * np.pi) * rng.uniform(0.6, 1.4, 4)
    return Terrain(amplitudes_m, waves, rng.uniform(0, 2 * np.pi, 4))


def _directions(yaw_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors [..., 2] ahead and to the right."""
    sin, cos = np.sin(yaw_rad), np.cos(yaw_rad)
    return np.stack([sin, cos], axis=-1), np.stack([cos, -sin], axis=-1)


@dataclass(frozen=True)
class Roads:
    """Streets by their centre lines: one, or two straight ones that cross at the
    origin of the map.
    """

    paths: list[Path]
    crossing_m: tuple[float, ...] = ()  # metres along each path to the crossing

    def distance_m(self, places: FloatArray) -> FloatArray:
        """Signed distance [N] of places [N, 2] from the kerb, negative on the carriageway, corners
        rounded.
        """
        first, *others = (np.abs(path.right_m(places)) - HALF_WIDTH_M for path in self.paths)
        for other in others:
            inside = np.hypot(
                np.maximum(CORNER_RADIUS_M - first, 0), np.maximum(CORNER_RADIUS_M - other, 0)
            )
            first = np.maximum(CORNER_RADIUS_M, np.minimum(first, other)) - inside
        return first

    def kerbs(self) -> list[tuple[FloatArray, FloatArray]]:
        """Every kerb as places [K, 2] and unit vectors [K, 2] away from the road."""
        if not self.crossing_m:
            along_m = np.arange(0.0, self.paths[0].length_m)
            left, middle, right = (self.paths[0].at(along_m, side)[0] for side in (-1.0, 0.0, 1.0))
            return [
                (middle + HALF_WIDTH_M * away, away) for away in (left - middle, right - middle)
            ]
        centre_m, angle_rad = HALF_WIDTH_M + CORNER_RADIUS_M, np.linspace(0, np.pi / 2, 13)[:, None]
        away = np.hstack([np.cos(angle_rad), -np.sin(angle_rad)])
        reach_m = np.arange(300.0, centre_m, -1.0)[:, None]
        edge_m = np.full_like(reach_m, HALF_WIDTH_M)
        corner = np.array([centre_m, -centre_m]) - CORNER_RADIUS_M * away
        places = np.vstack(
            [np.hstack([edge_m, -reach_m]), corner, np.hstack([reach_m[::-1], -edge_m])]
        )
        away = away[np.clip(np.arange(len(places)) - len(reach_m), 0, len(away) - 1)]
        turns = [np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), k) for k in range(4)]
        return [(places @ turn, away @ turn) for turn in turns]


def ground(
    roads: Roads, terrain: Terrain, centre: FloatArray, rng: np.random.Generator
) -> TriangleMesh:
    """The roads with kerbs, pavements and verges, grass 300 m around a place [2], and hills behind
    it.
    """
    angle_rad = np.linspace(0, 2 * np.pi, 289)
    radius_m = np.concatenate([np.arange(0.0, 304.0, 16.0), [330.0, 450.0]])[:, None]
    places = centre + radius_m[..., None] * np.stack(
        [np.sin(angle_rad), np.cos(angle_rad)], axis=-1
    )
    waves = sum(np.sin(k * angle_rad + rng.uniform(0, 6.3)) / k**0.7 for k in (2, 3, 5, 8, 13, 21))
    rise_m = (
        np.interp(radius_m, HILLS_M[0], HILLS_M[1])
        + np.interp(radius_m, HILLS_M[0], HILLS_M[2]) * waves
    )
    meshes = [
        sheet(
            terrain.points(places, rise_m), Texture.GRASS, WHITE, np.moveaxis(places, -1, 0) / 60.0
        )
    ]
    for line, away in roads.kerbs():
        strips = terrain.points(line + PROFILE_M[:, :1, None] * away, PROFILE_M[:, 1:])
        meshes += [sheet(strips[row : row + 2], *surface) for row, surface in enumerate(SURFACES)]
    for path, crossing_m in zip(roads.paths, roads.crossing_m, strict=False):
        before, after = crossing_m - JUNCTION_M - ZEBRA_M, crossing_m + JUNCTION_M
        meshes += [
            _lane(path, terrain, start, start + ZEBRA_M, Texture.ZEBRA, ZEBRA_M)
            for start in (before, after)
        ]
        pieces = [(0.0, before), (after + ZEBRA_M, path.length_m)]
        meshes += [_lane(path, terrain, *piece, Texture.ROAD, ROAD_TILE_M) for piece in pieces]
    if roads.crossing_m:
        square = np.stack(np.meshgrid(*2 * [np.linspace(-JUNCTION_M, JUNCTION_M, 23)]), axis=-1)
        return joined([*meshes, sheet(terrain.points(square, 0.0), Texture.ASPHALT)])
    return joined(
        [
            *meshes,
            _lane(roads.paths[0], terrain, 0.0, roads.paths[0].length_m, Texture.ROAD, ROAD_TILE_M),
        ]
    )


def _lane(
    path: Path, terrain: Terrain, start_m: float, end_m: float, texture: Texture, tile_m: float
) -> TriangleMesh:
    """The carriageway along a piece of a path."""
    along_m, right_m = np.meshgrid(
        np.linspace(start_m, end_m, int(end_m - start_m) + 2),
        np.linspace(-HALF_WIDTH_M - 0.02, HALF_WIDTH_M + 0.02, 5),
    )
    uv = (right_m / (2 * HALF_WIDTH_M) + 0.5, (along_m - start_m) / tile_m)
    return sheet(terrain.points(path.at(along_m, right_m)[0], 0.0), texture, WHITE, uv)
