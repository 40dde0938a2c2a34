"""Ray-traced images of the street: one ray per pixel, four at edges, and shadows of the sun."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from geovp_classic.data.synthetic.shading import Hits, Optics, shade
from geovp_classic.data.synthetic.solids import RayCaster
from geovp_classic.data.synthetic.street import Street
from geovp_classic.data.synthetic.textures import TILE_M, Texture
from geovp_classic.geometry import pinhole
from geovp_classic.parallel import parallel_map
from geovp_classic.types import BoolArray, FloatArray, IntArray, Intrinsics

UV_AXES = np.array([[2, 1], [0, 2], [0, 1]])  # of the textures across x, y, z


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
        caster = RayCaster(street.solids_at(float(times_s[step])))
        frame = _Frame(caster, street, optics, world_from_cam[step], camera)
        return frame.render()

    frames = parallel_map(render, range(len(times_s)))
    return Rendering(*map(np.stack, zip(*frames, strict=True)))


@dataclass(frozen=True)
class _Frame:
    """One instant seen from one place."""

    caster: RayCaster
    street: Street
    optics: Optics
    world_from_cam: FloatArray  # [4, 4]
    camera: Intrinsics
    blur_reach: float = 3.0  # in standard deviations
    # contrast of light among neighbours at edges, (high - low) / (high + low)
    max_contrast: float = 0.5

    def render(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return light [H, W, 3], depth [H, W] and moving [H, W].

        Pixels are averages of four rays if their neighbours show another texture, or if the
        contrast exceeds `max_contrast` (Mitchell 1987). Both look beyond the border of the image.
        """
        blur_px = self.optics.blur_px
        margin_px = int(self.blur_reach * blur_px + 0.5) + 1
        size_px = (self.camera.width_px, self.camera.height_px)
        width_px, height_px = np.add(size_px, 2 * margin_px).tolist()
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
        eye = self.world_from_cam[:3, 3]
        rays = pinhole.unproject(pixels, np.ones(shape), self.camera)
        rays = rays.reshape(-1, 3) @ self.world_from_cam[:3, :3].T
        depth, solids, faces = self.caster.cast(eye, rays)

        weather = self.street.weather
        is_sky = solids < 0
        light = np.empty_like(rays)
        sky_rays = rays[is_sky]
        sky_rays /= np.linalg.norm(sky_rays, axis=-1, keepdims=True)
        light[is_sky] = weather.sky_light(sky_rays)
        texture = np.full(len(rays), -1)
        is_moving = self._is_traffic(solids)

        seen = np.flatnonzero(~is_sky)
        points = eye + depth[seen, None] * rays[seen]
        pixel_m = depth[seen] / self.camera.fx_px
        hits = self._hits(points, pixel_m, solids[seen], faces[seen])
        above = hits.points + 0.02 * (hits.normal + weather.to_sun)
        _, blockers, _ = self.caster.cast(above, weather.to_sun)
        is_lit = blockers < 0
        light[seen] = shade(hits, eye, is_lit, weather, self.optics)
        texture[seen] = hits.texture
        is_turned_to_sun = hits.normal @ weather.to_sun > 0
        is_moving[seen] |= self._is_traffic(blockers) & is_turned_to_sun
        maps = (depth, is_moving, texture)
        return [
            light.reshape(*shape, 3),
            *(values.reshape(shape) for values in maps),
        ]

    def _is_traffic(self, solids: IntArray) -> BoolArray:
        """Return whether solids are parts of moving cars, which come last."""
        return solids >= len(self.street.static.is_round)

    def _hits(
        self,
        points: FloatArray,  # [N, 3]
        pixel_m: FloatArray,  # [N]
        numbers: IntArray,  # [N], of the solids
        faces: IntArray,  # [N]
    ) -> Hits:
        """Return the hits at points on solids, with the road's surface on the ground."""
        solids = self.caster.solids
        frame = self.caster.local_from_world[numbers]  # [N, 3, 4]
        local = np.einsum("nij,nj->ni", frame[..., :3], points) + frame[..., 3]
        axis = faces // 2
        direction = np.eye(3)[axis] * (2 * (faces % 2) - 1)[:, None]
        direction[:, 1] -= solids.taper[numbers, faces]
        is_round = solids.is_round[numbers]
        direction[is_round] = local[is_round] - 0.5
        axis[is_round] = np.abs(direction[is_round]).argmax(axis=-1)
        normal = np.einsum("nij,ni->nj", frame[..., :3], direction)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)

        texture = solids.textures[numbers, axis]
        size_m = 1 / np.linalg.norm(frame[..., :3], axis=-1)  # [N, 3]
        pick = (np.arange(len(points))[:, None], UV_AXES[axis])
        tile_m = TILE_M[texture]
        tiles = np.where(tile_m > 0, size_m[pick] / np.maximum(tile_m, 1e-9), 1)
        uv = tiles * local[pick]
        uv_axes = tiles[..., None] * frame[..., :3][pick]
        ground = np.flatnonzero(texture == Texture.GROUND)
        surface = self.street.roads.surface(points[ground][:, [0, 2]])
        texture[ground], uv[ground], uv_axes[ground] = surface
        tint = solids.tints[numbers, axis]
        return Hits(points, normal, texture, tint, uv, uv_axes, pixel_m)
