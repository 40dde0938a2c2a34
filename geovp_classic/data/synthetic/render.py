"""Ray-traced images of the street: one ray per pixel, four at edges, and shadows of the sun."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from geovp_classic.data.synthetic.mesh import joined
from geovp_classic.data.synthetic.ray_casting import Hits, RayCaster
from geovp_classic.data.synthetic.shading import Optics, Weather, shade
from geovp_classic.data.synthetic.street import Street
from geovp_classic.data.synthetic.textures import Texture
from geovp_classic.geometry import pinhole
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, FloatArray, Intrinsics


class Rendering(NamedTuple):
    """The frames of a drive without noise."""

    light: FloatArray  # [T, H, W, 3], linear
    depths: (
        FloatArray  # [T, H, W], float32, z-depth at pixel centres; inf = sky
    )
    moving: BoolArray  # [T, H, W], on moving cars and in their shadows


def render_drive(
    street: Street,
    world_from_cam: FloatArray,  # [T, 4, 4]
    camera: Intrinsics,
    times_s: FloatArray,  # [T]
    optics: Optics,
) -> Rendering:
    """Render the street at any times; pixels at edges are averages of four rays."""

    def render(step: int) -> tuple[FloatArray, FloatArray, BoolArray]:
        layers = [street.ray_caster]
        if street.traffic:
            traffic = street.traffic_at(float(times_s[step]))
            layers.append(RayCaster(joined(traffic)))
        frame = _Frame(
            layers, street.weather, optics, world_from_cam[step], camera
        )
        return frame.render()

    frames = parallel_map(render, range(len(times_s)))
    return Rendering(
        *(np.stack(images) for images in zip(*frames, strict=True))
    )


@dataclass(frozen=True)
class _Frame:
    """One instant seen from one place."""

    layers: list[RayCaster]  # the street, and the traffic if there is any
    weather: Weather
    optics: Optics
    world_from_cam: FloatArray  # [4, 4]
    camera: Intrinsics
    blur_reach: float = 3.0  # in standard deviations
    max_contrast: float = (
        0.5  # of light among neighbours, (high - low) / (high + low)
    )
    leaf_gap_m: float = (
        0.7  # leaves are not shaded by closer neighbours, to avoid flicker
    )

    def render(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return light [H, W, 3], depth [H, W] and moving [H, W].

        Pixels are averages of four rays if their neighbours show another texture, or if the
        contrast exceeds `max_contrast` (Mitchell 1987). Both look beyond the border of the image.
        """
        blur_px = self.optics.blur_px
        margin_px = int(self.blur_reach * blur_px + 0.5) + 1
        width_px = self.camera.width_px + 2 * margin_px
        height_px = self.camera.height_px + 2 * margin_px
        padded = self.camera.cropped(
            -margin_px, -margin_px, width_px, height_px
        )
        pixels = pinhole.pixel_grid(padded) - margin_px
        light, depth, is_moving, texture = self._trace(pixels)

        channels = np.dstack([light, texture])
        high = cv2.dilate(channels, np.ones((3, 3)))
        low = cv2.erode(channels, np.ones((3, 3)))
        max_contrast = [self.max_contrast] * 3 + [0.0]
        is_edge = (high - low > max_contrast * (high + low)).any(axis=-1)
        offsets_px = np.array([(-0.36, -0.2), (0.36, -0.24), (0.0, 0.44)])
        more_light, _, more_moving, _ = self._trace(
            pixels[is_edge][:, None] + offsets_px
        )
        light[is_edge] = (light[is_edge] + more_light.sum(axis=1)) / 4
        is_moving[is_edge] |= more_moving.any(axis=1)

        light = gaussian_filter(
            light, (blur_px, blur_px, 0), truncate=self.blur_reach
        )
        inner = np.s_[margin_px:-margin_px, margin_px:-margin_px]
        return light[inner], depth[inner].astype(np.float32), is_moving[inner]

    def _trace(self, pixels: FloatArray) -> list[npt.NDArray[Any]]:
        """Return light [..., 3], depth, moving and texture [...] of rays through pixels [..., 2].

        The texture of the sky is -1.
        """
        shape = pixels.shape[:-1]
        rotation = self.world_from_cam[:3, :3]
        eye = self.world_from_cam[:3, 3]
        rays_cam = pinhole.unproject(pixels, np.ones(shape), self.camera)
        rays = rays_cam.reshape(-1, 3) @ rotation.T
        focal_px = np.array([self.camera.fx_px, self.camera.fy_px])
        pixel_steps = rotation[:, :2].T / focal_px[:, None]
        casts = [layer.cast(eye, rays) for layer in self.layers]
        depth = np.min([lengths for lengths, _ in casts], axis=0)

        light = np.empty_like(rays)
        is_sky = np.isinf(depth)
        sky_rays = rays[is_sky]
        sky_rays /= np.linalg.norm(sky_rays, axis=-1, keepdims=True)
        light[is_sky] = self.weather.sky_light(sky_rays)
        is_moving = np.zeros(len(rays), dtype=bool)
        texture = np.full(len(rays), -1)
        for layer, (lengths, triangles) in zip(self.layers, casts, strict=True):
            index = np.flatnonzero(~is_sky & (lengths == depth))
            hits = layer.hits(
                eye, rays[index], depth[index], triangles[index], pixel_steps
            )
            is_lit, is_shaded_by_traffic = self._sunlight(hits)
            light[index] = shade(hits, eye, is_lit, self.weather, self.optics)
            texture[index] = hits.texture
            is_moving[index] = is_shaded_by_traffic | (
                layer is not self.layers[0]
            )
        maps = (depth, is_moving, texture)
        return [
            light.reshape(*shape, 3),
            *(values.reshape(shape) for values in maps),
        ]

    def _sunlight(self, hits: Hits) -> tuple[BoolArray, BoolArray]:
        """Return whether the sun reaches the hits [N], and whether only traffic blocks it [N]."""
        to_sun = self.weather.to_sun
        is_leaf = hits.texture == Texture.LEAVES
        facing = np.flatnonzero((hits.normal @ to_sun > 0) | is_leaf)
        gap_m = np.where(is_leaf, self.leaf_gap_m, 0.01)[facing, None]
        points = (
            hits.points[facing] + 0.01 * hits.normal[facing] + gap_m * to_sun
        )
        is_blocked, *by_traffic = (
            layer.is_blocked(points, to_sun) for layer in self.layers
        )
        is_lit, is_shaded_by_traffic = np.zeros((2, len(is_leaf)), dtype=bool)
        is_shaded_by_traffic[facing] = ~is_blocked & np.any(by_traffic, axis=0)
        is_lit[facing] = ~is_blocked
        return is_lit & ~is_shaded_by_traffic, is_shaded_by_traffic
