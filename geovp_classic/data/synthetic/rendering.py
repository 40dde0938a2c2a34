"""Ray-traced images of the street: one ray per pixel, four at edges, and shadows of the sun.

Light is linear; the byte of an image is its square root (gamma 2).
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from geovp_classic.data.synthetic.solids import RayCaster
from geovp_classic.data.synthetic.street import Street
from geovp_classic.data.synthetic.textures import (
    TILE_M,
    Texture,
    column,
    sample,
)
from geovp_classic.geometry import pinhole
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, FloatArray, IntArray, Intrinsics


@dataclass(frozen=True, kw_only=True)
class Optics:
    """Air, surfaces and lens.

    Without haze and gloss, surfaces look the same from everywhere.
    """

    # extinction: a visibility of 3.912 / 0.0012 = 3.3 km (Koschmieder 1924), slight haze
    haze_per_m: float = 0.0012
    gloss: float = 1.0  # scale of the reflections of glass and paint, 1: as in textures.toml
    # standard deviation of the lens: an edge rises from 10 to 90 % in 2.56 x 0.45 = 1.15 pixels
    blur_px: float = 0.45
    finest_detail_m: float = 0.0  # textures are smoothed to this size


class Rendering(NamedTuple):
    """The frames of a drive without noise."""

    light: FloatArray  # [T, H, W, 3], linear
    depths: FloatArray  # [T, H, W], float32, z-depth; inf = sky
    moving: BoolArray  # [T, H, W], on moving cars and in their shadows


def render_drive(
    street: Street,
    world_from_cam: FloatArray,  # [T, 4, 4]
    camera: Intrinsics,
    times_s: FloatArray,  # [T]
    optics: Optics,
) -> Rendering:
    """Render the street at any times, blurred with light from beyond the border of the image."""
    margin_px = int(3.0 * optics.blur_px + 0.5) + 1
    width_px = camera.width_px + 2 * margin_px
    height_px = camera.height_px + 2 * margin_px
    larger = camera.cropped(-margin_px, -margin_px, width_px, height_px)

    def render(step: int) -> Rendering:
        caster = RayCaster(street.solids_at(times_s[step]))
        view = _View(caster, street, optics, world_from_cam[step], larger)
        return view.render()

    frames = parallel_map(render, range(len(times_s)))
    inner = np.s_[:, margin_px:-margin_px, margin_px:-margin_px]
    images = zip(*frames, strict=True)
    return Rendering(*(np.stack(each)[inner] for each in images))


class _Hits(NamedTuple):
    """Surface points that rays hit."""

    points: FloatArray  # [N, 3]
    pixel_m: FloatArray  # [N], width of a pixel at this distance
    normal: FloatArray  # [N, 3], towards the eye
    texture: IntArray  # [N]
    tint: FloatArray  # [N, 3]
    uv: FloatArray  # [N, 2], place on the texture in tiles
    uv_axes: FloatArray  # [N, 2, 3], change of uv by a step in the world


@dataclass(frozen=True)
class _View:
    """The street at a time from a camera."""

    caster: RayCaster
    street: Street
    optics: Optics
    world_from_cam: FloatArray  # [4, 4]
    camera: Intrinsics

    def render(self) -> Rendering:
        """Return light [H, W, 3], depth [H, W] and moving [H, W].

        Pixels are averages of four rays if their neighbours show another texture or differ much in
        light (Mitchell 1987).
        """
        pixels = pinhole.pixel_grid(self.camera)
        shape = pixels.shape[:2]
        light, depth, is_moving, texture = self._trace(pixels.reshape(-1, 2))
        light = light.reshape(*shape, 3)
        is_moving = is_moving.reshape(shape)
        channels = np.dstack([light, texture.reshape(shape)])
        high = cv2.dilate(channels, np.ones((3, 3)))
        low = cv2.erode(channels, np.ones((3, 3)))
        max_contrast = [0.5, 0.5, 0.5, 0.0]  # (high - low) / (high + low)
        is_edge = (high - low > max_contrast * (high + low)).any(axis=-1)
        for offset_px in ((-0.36, -0.2), (0.36, -0.24), (0.0, 0.44)):
            more, _, more_moving, _ = self._trace(pixels[is_edge] + offset_px)
            light[is_edge] += more
            is_moving[is_edge] |= more_moving
        light[is_edge] /= 4

        blur_px = self.optics.blur_px
        light = gaussian_filter(light, (blur_px, blur_px, 0), truncate=3.0)
        depth = depth.reshape(shape).astype(np.float32)
        return Rendering(light, depth, is_moving)

    def _trace(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray, IntArray]:
        """Return light [N, 3], depth, moving and texture [N] of rays through pixels [N, 2].

        The texture of the sky is -1.
        """
        eye = self.world_from_cam[:3, 3]
        rays = pinhole.unproject(pixels, 1.0, self.camera)
        rays = rays @ self.world_from_cam[:3, :3].T
        depth, solids, faces = self.caster.cast(eye, rays)
        weather = self.street.weather
        light = weather.sky_light(_unit(rays))
        texture = np.full(len(rays), -1)

        seen = solids >= 0
        points = eye + depth[seen, None] * rays[seen]
        pixel_m = depth[seen] / self.camera.fx_px
        hits = self._hits(points, pixel_m, solids[seen], faces[seen])
        above = points + 0.02 * (hits.normal + weather.to_sun)
        _, blockers, _ = self.caster.cast(above, weather.to_sun)
        light[seen] = self._shade(hits, blockers < 0)
        texture[seen] = hits.texture

        num_static = len(self.street.static.is_round)  # moving cars follow
        is_moving = solids >= num_static
        is_turned_to_sun = hits.normal @ weather.to_sun > 0
        is_moving[seen] |= (blockers >= num_static) & is_turned_to_sun
        return light, depth, is_moving, texture

    def _hits(
        self,
        points: FloatArray,
        pixel_m: FloatArray,
        numbers: IntArray,
        faces: IntArray,
    ) -> _Hits:
        """Return the hits at points on faces of the numbered solids.

        The ground has the surface of the roads.
        """
        solids = self.caster.solids
        frame = self.caster.local_from_world[numbers]  # [N, 3, 4]
        local = np.einsum("nij,nj->ni", frame[..., :3], points) + frame[..., 3]
        direction = self.caster.planes[numbers, faces, :3]
        is_round = solids.is_round[numbers]
        direction[is_round] = local[is_round] - 0.5
        normal = _unit(np.einsum("nij,ni->nj", frame[..., :3], direction))

        axis = np.abs(direction).argmax(axis=-1)
        texture = solids.textures[numbers, axis]
        across = np.array([[2, 1], [0, 2], [0, 1]])[axis]  # axes of the texture
        pick = (np.arange(len(points))[:, None], across)
        uv_axes = frame[..., :3][pick]
        tiles = 1 / (np.linalg.norm(uv_axes, axis=-1) * TILE_M[texture])
        tiles[np.isnan(tiles)] = 1
        uv = tiles * local[pick]
        uv_axes *= tiles[..., None]
        ground = texture == Texture.GROUND
        places = points[ground, 0] + 1j * points[ground, 2]
        surface = self.street.roads.surface(places)
        texture[ground], uv[ground], uv_axes[ground] = surface
        tint = solids.tints[numbers, axis]
        return _Hits(points, pixel_m, normal, texture, tint, uv, uv_axes)

    def _shade(self, hits: _Hits, is_lit: BoolArray) -> FloatArray:
        """Return the light [N, 3] from hits to the eye; the sun reaches those that are lit [N]."""
        weather = self.street.weather
        sight = hits.points - self.world_from_cam[:3, 3]
        ray = _unit(sight)
        facing = -np.einsum("nj,nj->n", hits.normal, ray)[:, None]

        # The footprint of a pixel is longer along the surface, away from the eye.
        away = _unit(ray + facing * hits.normal)
        longer_m = hits.pixel_m[:, None] / np.maximum(facing, 0.02) * away
        shorter_m = np.maximum(hits.pixel_m, self.optics.finest_detail_m)
        longer = np.einsum("nkj,nj->nk", hits.uv_axes, longer_m)
        tiles_per_m = np.linalg.norm(hits.uv_axes, axis=-1).max(axis=-1)
        texel = sample(hits.texture, hits.uv, longer, shorter_m * tiles_per_m)
        is_tinted = texel[:, 3:]  # 0 to 1
        colour = texel[:, :3] * (1 + is_tinted * (hits.tint - 1))
        colour *= _stains(hits)
        is_leaf = hits.texture == Texture.LEAVES
        light = colour**2 * weather.irradiance(hits.normal, is_lit, is_leaf)

        reflected = weather.sky_light(ray + 2 * facing * hits.normal)
        gloss = self.optics.gloss * column("gloss", 0.0)[hits.texture, None]
        gloss *= 1 - 0.7 * is_tinted
        gloss *= 0.25 + 0.75 * (1 - np.clip(facing, 0, 1)) ** 5  # Schlick 1994
        light += gloss * (reflected - light)
        haze_lengths = self.optics.haze_per_m * np.linalg.norm(sight, axis=-1)
        transmission = np.exp(-haze_lengths)[:, None]
        return light * transmission + weather.horizon * (1 - transmission)


def _stains(hits: _Hits) -> FloatArray:
    """Return the factors [N, 1] of large stains, which hide the repetition of the textures."""
    tile_m = TILE_M[Texture.STAINS]
    uv = hits.points @ [[1.0, 0.0], [0.5, 0.7], [0.0, 1.0]] / tile_m
    blur = np.minimum(4 * hits.pixel_m, 8.0) / tile_m[0]
    pattern = sample(Texture.STAINS, uv, 0 * uv, blur)[:, :1]
    return 1 + column("stains", 0.0)[hits.texture, None] * (2 * pattern - 1)


def _unit(vectors: FloatArray) -> FloatArray:
    """Return vectors [N, 3] scaled to length 1."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.maximum(lengths, 1e-9)
