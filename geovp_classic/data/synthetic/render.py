"""Render the street: a ray from every pixel to the nearest surface, more of them at edges, shadows
from the sun.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from geovp_classic.data.synthetic.images import IntArray, Texture
from geovp_classic.data.synthetic.mesh import Hits, Surfaces, joined
from geovp_classic.data.synthetic.shading import Optics, Weather, shade, sky_light
from geovp_classic.data.synthetic.street import Street
from geovp_classic.geometry import pinhole
from geovp_classic.types import BoolArray, FloatArray, Intrinsics

SUBPIXELS = np.array(
    [(-0.36, -0.2), (0.36, -0.24), (0.0, 0.44)]
)  # with the centre, a spread of four
LEAF_GAP_M = 0.7  # leaves are not shaded by their nearest neighbours, which would be all flicker
UP = np.array([0, -1, 0], dtype=np.float32)
BLUR_REACH = 3.0  # in spreads
MAX_THREADS = 4


@dataclass(frozen=True)
class Rendering:
    """The frames of a drive, without noise."""

    light: FloatArray  # [T, H, W, 3] float32, linear
    depths: FloatArray  # [T, H, W] float32 z-depth at pixel centres; inf = sky
    moving: BoolArray  # [T, H, W]; True on moving cars and in their shadows


def render_drive(
    street: Street,
    world_from_cam: FloatArray,
    camera: Intrinsics,
    times_s: FloatArray,
    optics: Optics,
) -> Rendering:
    """The street from cameras [T, 4, 4] at any times [T]; pixels at edges are averages of four
    rays.
    """
    static = street.surfaces

    def image(step: int) -> tuple[FloatArray, FloatArray, BoolArray]:
        traffic = street.traffic_at(float(times_s[step]))
        layers = [static, Surfaces(joined(traffic))] if traffic else [static]
        return _Frame(layers, street.weather, optics, world_from_cam[step], camera).image()

    with ThreadPoolExecutor(min(MAX_THREADS, os.cpu_count() or 1)) as pool:
        frames = list(pool.map(image, range(len(times_s))))
    return Rendering(*(np.stack(parts) for parts in zip(*frames, strict=True)))


@dataclass(frozen=True)
class _Frame:
    """One instant seen from one place."""

    layers: list[Surfaces]  # the street, and the traffic if there is any
    weather: Weather
    optics: Optics
    world_from_cam: FloatArray  # [4, 4]
    camera: Intrinsics

    def image(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Light [H, W, 3], depth [H, W] and moving [H, W]; edges and blur look beyond the
        border.
        """
        blur_px = self.optics.blur_px
        margin = int(BLUR_REACH * blur_px + 0.5) + 1
        size = (self.camera.height_px + 2 * margin, self.camera.width_px + 2 * margin)
        grid = pinhole.pixel_grid(self.camera.cropped(-margin, -margin, size[1], size[0])) - margin
        light, moving, depths, label, normal = self.trace(grid)
        edge = _edges(depths, label, normal)
        more_light, more_moving, *_ = self.trace(grid[edge][:, None] + SUBPIXELS)
        light[edge] = (light[edge] + more_light.sum(axis=1)) / (len(SUBPIXELS) + 1)
        moving[edge] |= more_moving.any(axis=1)
        inner = (slice(margin, -margin), slice(margin, -margin))
        blurred = gaussian_filter(light, (blur_px, blur_px, 0), truncate=BLUR_REACH)
        return blurred[inner], depths[inner], moving[inner]

    def trace(
        self, pixels: FloatArray
    ) -> tuple[FloatArray, BoolArray, FloatArray, IntArray, FloatArray]:
        """What rays through pixels [..., 2] meet: light [..., 3], moving, depth and a label [...],
        normal [..., 3].

        The label differs between textures, colours, and sun and shadow. Leaves and sky all have the
        same normal.
        """
        rotation, eye = self.world_from_cam[:3, :3], self.world_from_cam[:3, 3]
        rays_cam = pinhole.unproject(pixels, np.ones(pixels.shape[:-1]), self.camera).reshape(-1, 3)
        rays = rays_cam.astype(np.float32) @ rotation.T.astype(np.float32)
        steps = np.stack([rotation[:, 0] / self.camera.fx_px, rotation[:, 1] / self.camera.fy_px])
        found = [surfaces.cast(eye, rays) for surfaces in self.layers]
        depths = np.min([depth for depth, _ in found], axis=0)
        label, moving = np.zeros(len(rays), np.int32), np.zeros(len(rays), dtype=bool)
        normal, light = np.zeros_like(rays) + UP, np.empty_like(rays)
        free = np.isinf(depths)
        light[free] = sky_light(
            self.weather, rays[free] / np.linalg.norm(rays[free], axis=-1, keepdims=True)
        )
        for number, (surfaces, (depth, triangles)) in enumerate(
            zip(self.layers, found, strict=True)
        ):
            where = np.nonzero(~free & (depth == depths))[0]
            hits = surfaces.hits(eye, rays[where], depths[where], triangles[where], steps)
            lit, shaded_by_traffic = self._sunlight(hits)
            light[where] = shade(hits, eye, lit, self.weather, self.optics)
            label[where] = (
                1 + hits.texture + 64 * ((hits.tint[:, 0] * 255).astype(np.int32) + 512 * lit)
            )
            normal[where] = np.where(
                hits.texture[:, None] == Texture.LEAVES, normal[where], hits.normal
            )
            moving[where] = shaded_by_traffic | (number > 0)
        shape = pixels.shape[:-1]
        surface = (depths.reshape(shape), label.reshape(shape), normal.reshape(*shape, 3))
        return light.reshape(*shape, 3), moving.reshape(shape), *surface

    def _sunlight(self, hits: Hits) -> tuple[BoolArray, BoolArray]:
        """Whether the sun reaches the hits [K], and whether only the traffic keeps it off [K]."""
        to_sun, leaf = self.weather.to_sun, hits.texture == Texture.LEAVES
        facing = np.nonzero((hits.normal @ to_sun > 0) | leaf)[0]
        gap = np.where(leaf[facing], np.float32(LEAF_GAP_M), np.float32(0.01))[:, None]
        points = hits.points[facing] + np.float32(0.01) * hits.normal[facing] + gap * to_sun
        blocked = np.array([surfaces.blocks(points, to_sun) for surfaces in self.layers])
        lit, by_traffic = np.zeros((2, len(leaf)), dtype=bool)
        lit[facing] = ~blocked.any(axis=0)
        by_traffic[facing] = blocked.any(axis=0) & ~blocked[0]
        return lit, by_traffic


def _edges(depths: FloatArray, label: IntArray, normal: FloatArray) -> BoolArray:
    """Pixels [H, W] whose neighbours show something else, or the same in another light."""
    inverse, edge = 1.0 / depths, np.zeros(depths.shape, dtype=bool)
    jump = np.where(
        label % 64 == Texture.LEAVES + 1, 0.2, 0.06
    )  # leaves before leaves show little of an edge
    for here, there in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        turned = np.einsum("hwk,hwk->hw", normal[here], normal[there]) < 0.8
        step = np.abs(inverse[here] - inverse[there]) > jump[here] * np.maximum(
            inverse[here], inverse[there]
        )
        differs = (label[here] != label[there]) | step | turned
        edge[here] |= differs
        edge[there] |= differs
    return edge
