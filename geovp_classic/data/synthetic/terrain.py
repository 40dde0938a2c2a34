"""Gentle hills, and the mesh of the ground with its roads."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from geovp_classic.data.synthetic.mesh import WHITE, TriangleMesh, joined, sheet
from geovp_classic.data.synthetic.roads import Path, Roads
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Terrain:
    """A sum of waves over the map."""

    amplitudes_m: FloatArray  # [W]
    waves_rad_m: FloatArray  # [W, 2], wave vectors
    phases_rad: FloatArray  # [W]

    def height_m(self, places: FloatArray) -> FloatArray:
        """Return the height [...] above the datum at places [..., 2]."""
        return (
            np.sin(places @ self.waves_rad_m.T + self.phases_rad)
            @ self.amplitudes_m
        )

    def points(
        self, places: FloatArray, above_m: FloatArray | float
    ) -> FloatArray:
        """Return points [..., 3] above places [..., 2]; y points down."""
        y = -self.height_m(places) - above_m
        return np.stack([places[..., 0], y, places[..., 1]], axis=-1)

    def world_from_vehicle(
        self, places: FloatArray, yaw_rad: FloatArray
    ) -> FloatArray:
        """Return world_from_vehicle [..., 4, 4] of vehicles on the ground.

        A vehicle has x to the right, y down along the normal of the ground, and z ahead.
        """
        cosine = np.cos(places @ self.waves_rad_m.T + self.phases_rad)
        slope = cosine * self.amplitudes_m @ self.waves_rad_m
        first = np.ones(slope.shape[:-1])
        down = np.stack([slope[..., 0], first, slope[..., 1]], axis=-1)
        down /= np.linalg.norm(down, axis=-1, keepdims=True)
        heading = np.stack(
            [np.sin(yaw_rad), 0 * first, np.cos(yaw_rad)], axis=-1
        )
        right = np.cross(down, heading)
        right /= np.linalg.norm(right, axis=-1, keepdims=True)
        rotation = np.stack([right, down, np.cross(right, down)], axis=-1)
        return se3.compose(rotation, self.points(places, 0.0))


def rolling_hills(rng: Generator, max_slope: float) -> Terrain:
    """Return hills of wavelengths 60 to 200 m; slopes stay below about `max_slope` (0.03 = 3 %)."""
    lengths_m = rng.uniform(60, 200, 4)
    directions_rad = rng.uniform(0, 2 * np.pi, 4)
    directions = np.stack(
        [np.sin(directions_rad), np.cos(directions_rad)], axis=-1
    )
    waves_rad_m = 2 * np.pi / lengths_m[:, None] * directions
    amplitudes_m = (
        max_slope / 4 * lengths_m / (2 * np.pi) * rng.uniform(0.6, 1.4, 4)
    )
    return Terrain(amplitudes_m, waves_rad_m, rng.uniform(0, 2 * np.pi, 4))


def ground(
    roads: Roads, terrain: Terrain, centre: FloatArray, rng: Generator
) -> TriangleMesh:
    """Return the ground around a place [2]: roads, kerbs, pavements, grass and distant hills."""
    meshes = [
        _grass_and_hills(terrain, centre, rng),
        *_pavements(roads, terrain),
    ]
    if not roads.crossing_m:
        path = roads.paths[0]
        return joined(
            [*meshes, _lane(roads, terrain, path, 0.0, path.length_m)]
        )
    for path, crossing_m in zip(roads.paths, roads.crossing_m, strict=True):
        before_m = crossing_m - roads.junction_m - roads.zebra_m
        after_m = crossing_m + roads.junction_m
        meshes += [
            _zebra(roads, terrain, path, before_m),
            _zebra(roads, terrain, path, after_m),
            _lane(roads, terrain, path, 0.0, before_m),
            _lane(roads, terrain, path, after_m + roads.zebra_m, path.length_m),
        ]
    side_m = np.linspace(-roads.junction_m, roads.junction_m, 23)
    square = np.stack(np.meshgrid(side_m, side_m), axis=-1)
    return joined(
        [*meshes, sheet(terrain.points(square, 0.0), Texture.ASPHALT)]
    )


def _grass_and_hills(
    terrain: Terrain, centre: FloatArray, rng: Generator
) -> TriangleMesh:
    """Return grass up to 300 m around a place [2], and hills behind it."""
    angle_rad = np.linspace(0, 2 * np.pi, 289)
    radius_m = np.concatenate([np.arange(0.0, 304.0, 16.0), [330.0, 450.0]])[
        :, None
    ]
    directions = np.stack([np.sin(angle_rad), np.cos(angle_rad)], axis=-1)
    places = centre + radius_m[..., None] * directions
    frequencies = np.array([2, 3, 5, 8, 13, 21])
    phases_rad = rng.uniform(0, 6.3, len(frequencies))
    waves = (
        np.sin(np.outer(angle_rad, frequencies) + phases_rad)
        @ frequencies**-0.7
    )
    knots_m = (288, 304, 330, 450)
    rise_m = np.interp(radius_m, knots_m, (-0.25, 5, 12, 34))
    rise_m = rise_m + np.interp(radius_m, knots_m, (0, 1.5, 3.5, 7)) * waves
    x, z = np.moveaxis(places, -1, 0) / 60.0
    return sheet(terrain.points(places, rise_m), Texture.GRASS, WHITE, (x, z))


def _pavements(roads: Roads, terrain: Terrain) -> list[TriangleMesh]:
    """Return kerbs, pavements and verges: strips between parallels of the kerb line."""
    height_m = roads.kerb_height_m
    from_kerb_m = np.array([0, 0, 0.2, 2.2, 9])[:, None, None]
    above_m = np.array([-0.1, height_m, height_m, height_m, height_m])[:, None]
    stone = (Texture.ASPHALT, (1.45, 1.45, 1.42))
    surfaces = [stone, stone, (Texture.PAVEMENT, WHITE), (Texture.GRASS, WHITE)]
    meshes = []
    for kerb in roads.kerbs():
        along = np.gradient(kerb, axis=0)
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        away = along[:, ::-1] * [1, -1]
        points = terrain.points(kerb + from_kerb_m * away, above_m)
        for row, (texture, tint) in enumerate(surfaces):
            meshes.append(sheet(points[row : row + 2], texture, tint))
    return meshes


def _zebra(
    roads: Roads, terrain: Terrain, path: Path, start_m: float
) -> TriangleMesh:
    """Return a zebra crossing of a road."""
    end_m = start_m + roads.zebra_m
    return _lane(
        roads, terrain, path, start_m, end_m, Texture.ZEBRA, roads.zebra_m
    )


def _lane(
    roads: Roads,
    terrain: Terrain,
    path: Path,
    start_m: float,
    end_m: float,
    texture: Texture = Texture.ROAD,
    tile_m: float = 18.0,
) -> TriangleMesh:
    """Return the carriageway along a piece of a path."""
    reach_m = roads.half_width_m + 0.02
    along_m, right_m = np.meshgrid(
        np.linspace(start_m, end_m, int(end_m - start_m) + 2),
        np.linspace(-reach_m, reach_m, 5),
    )
    places, _ = path.at(along_m, right_m)
    u = right_m / (2 * roads.half_width_m) + 0.5
    v = (along_m - start_m) / tile_m
    return sheet(terrain.points(places, 0.0), texture, WHITE, (u, v))
