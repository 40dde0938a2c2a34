"""Film the street: rays from every pixel to the nearest surface, more of them where edges are, shadows from the sun."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import open3d as o3d

from geovp_classic.data.synthetic.mesh import Soup, joined
from geovp_classic.data.synthetic.shading import Optics, Weather, dot, shade, sky_light
from geovp_classic.data.synthetic.surfaces import Patches, Rays, patches, surfaces_of
from geovp_classic.data.synthetic.textures import IntArray, Texture, atlas
from geovp_classic.data.synthetic.world import World
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

SUBPIXELS = np.array([(-0.36, -0.2), (0.36, -0.24), (0.0, 0.44)])  # with the centre, a spread of four
LEAF_GAP_M = 0.7  # leaves are not shaded by their nearest neighbours, which would be all flicker
SHADOW_REACH_M = 7.0  # no car throws a longer shadow, measured from its middle
MOST_THREADS = 4
CLEAR_DAY = Optics()


@dataclass(frozen=True)
class Footage:
    """What a camera saw on a drive, without noise."""

    light: FloatArray  # [T, H, W, 3] float32, linear
    depths: FloatArray  # [T, H, W] float32 z-depth at pixel centres; inf = sky
    moving: BoolArray  # [T, H, W]; True on moving things and in their shadows

    @property
    def frames(self) -> ByteArray:
        """Images [T, H, W, 3]."""
        return np.asarray(np.sqrt(np.clip(self.light, 0.0, 1.0)) * 255 + 0.5, dtype=np.uint8)


def render_drive(
    world: World,
    world_from_cam: FloatArray,  # [T, 4, 4]
    camera: Intrinsics,
    times_s: FloatArray,  # [T]; where the traffic is
    optics: Optics = CLEAR_DAY,
) -> Footage:
    """The street from any camera at any times; pixels at edges are averages of four rays."""
    static = _Body(world.static)

    def shoot(step: int) -> tuple[FloatArray, FloatArray, BoolArray]:
        traffic = _Traffic(world.traffic_at(float(times_s[step])), world_from_cam[step], camera)
        return _Shot(static, traffic, world.weather, optics, world_from_cam[step], camera).image()

    with ThreadPoolExecutor(min(MOST_THREADS, os.cpu_count() or 1)) as pool:
        shots = list(pool.map(shoot, range(len(times_s))))
    light, depths, moving = (np.stack(parts) for parts in zip(*shots, strict=True))
    return Footage(light, depths, moving)


class _Body:
    """Triangles ready for rays."""

    def __init__(self, soup: Soup) -> None:
        vertices = o3d.core.Tensor(soup.corners.reshape(-1, 3))  # type: ignore[call-overload]
        faces = o3d.core.Tensor(np.arange(3 * len(soup), dtype=np.uint32).reshape(-1, 3))  # type: ignore[call-overload]
        self.scene = o3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(vertices, faces)
        self.surfaces = surfaces_of(soup)

    def cast(self, eye: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
        """Depths [N] (inf for nothing) and triangles [N]."""
        rays = np.concatenate([np.broadcast_to(eye.astype(np.float32), directions.shape), directions], axis=-1)
        answer = self.scene.cast_rays(o3d.core.Tensor(rays))  # type: ignore[call-overload]
        return answer["t_hit"].numpy(), answer["primitive_ids"].numpy().astype(np.int64)

    def blocks(self, points: FloatArray, to_sun: FloatArray) -> BoolArray:
        """Whether something stands between the points [N, 3] and the sun."""
        rays = np.concatenate([points, np.broadcast_to(to_sun, points.shape)], axis=-1).astype(np.float32)
        blocked: BoolArray = self.scene.test_occlusions(o3d.core.Tensor(rays)).numpy()  # type: ignore[call-overload]
        return blocked


class _Traffic:
    """The moving cars of one instant; only rays that come near them are tried."""

    def __init__(self, soups: Sequence[Soup], world_from_cam: FloatArray, camera: Intrinsics) -> None:
        self.body = _Body(joined(soups)) if soups else None
        self.middles = np.array([soup.corners.mean(axis=(0, 1)) for soup in soups]).reshape(-1, 3)
        cam_from_world = se3.inverse(world_from_cam)
        corners = [se3.transform(cam_from_world, soup.corners.reshape(-1, 3)) for soup in soups]
        self.windows = [_window(points, camera) for points in corners if (points[:, 2] > 0).any()]

    def in_sight(self, pixels: FloatArray) -> IntArray:
        """Which of the pixels [N, 2] may show a car."""
        near = np.zeros(len(pixels), dtype=bool)
        u, v = np.ascontiguousarray(pixels.T)
        for low, high in self.windows:
            near |= (u >= low[0]) & (u <= high[0]) & (v >= low[1]) & (v <= high[1])
        return np.nonzero(near)[0]

    def in_reach(self, points: FloatArray) -> IntArray:
        """Which of the points [N, 3] a car may shade."""
        near = np.zeros(len(points), dtype=bool)
        x, z = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 2])
        for middle in self.middles:
            near |= (np.abs(x - middle[0]) < SHADOW_REACH_M) & (np.abs(z - middle[2]) < SHADOW_REACH_M)
        return np.nonzero(near)[0]


@dataclass(frozen=True)
class _Hits:
    """What rays met."""

    depths: FloatArray  # [N], inf for the sky
    look: IntArray  # [N], one number for every texture and colour, 0 for the sky
    normal: FloatArray  # [N, 3]
    lit: BoolArray  # [N]
    moving: BoolArray  # [N]
    light: FloatArray  # [N, 3]

    @staticmethod
    def of_sky(depths: FloatArray, moving: BoolArray) -> _Hits:
        """Rays that met nothing yet, to be filled in."""
        count = len(depths)
        look, normal = np.zeros(count, dtype=np.int32), np.zeros((count, 3), dtype=np.float32)
        normal[:, 1] = 1.0  # all of the sky faces the same way, so that it has no edges
        return _Hits(depths, look, normal, np.ones(count, dtype=bool), moving, np.empty_like(normal))


class _Shot:
    """One instant seen from one place."""

    def __init__(
        self,
        static: _Body,
        traffic: _Traffic,
        weather: Weather,
        optics: Optics,
        world_from_cam: FloatArray,
        camera: Intrinsics,
    ) -> None:
        self.static, self.traffic, self.camera = static, traffic, camera
        self.weather, self.optics = weather, optics
        self.rotation, self.eye = world_from_cam[:3, :3], world_from_cam[:3, 3]

    def image(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Light [H, W, 3], depth [H, W] and moving [H, W]; edges and blur look beyond the border."""
        kernel = _bell(self.optics.blur_px)
        margin = len(kernel) // 2 + 1
        size = (self.camera.height_px + 2 * margin, self.camera.width_px + 2 * margin)
        grid = pinhole.pixel_grid(self.camera.cropped(-margin, -margin, size[1], size[0])) - margin
        hits = self.trace(grid.reshape(-1, 2))
        light, moving = hits.light.reshape(*size, 3).copy(), hits.moving.reshape(size).copy()
        rows, columns = np.nonzero(_edges(hits, size))
        more = self.trace((grid[rows, columns][:, None] + SUBPIXELS).reshape(-1, 2))
        total = light[rows, columns] + more.light.reshape(len(rows), len(SUBPIXELS), 3).sum(axis=1)
        light[rows, columns] = total / (len(SUBPIXELS) + 1)
        moving[rows, columns] |= more.moving.reshape(len(rows), len(SUBPIXELS)).any(axis=1)
        inner = (slice(margin, -margin), slice(margin, -margin))
        return _blurred(light[1:-1, 1:-1], kernel), hits.depths.reshape(size)[inner].astype(np.float32), moving[inner]

    def trace(self, pixels: FloatArray) -> _Hits:
        """What rays through pixels [N, 2] meet."""
        rays = pinhole.unproject(pixels, np.ones(len(pixels)), self.camera).astype(np.float32)
        directions = rays @ self.rotation.T.astype(np.float32)
        steps = np.stack([self.rotation[:, 0] / self.camera.fx_px, self.rotation[:, 1] / self.camera.fy_px])
        depths, triangles, moving = self._nearest(pixels, directions)
        hits = _Hits.of_sky(depths, moving)
        up = directions[np.isinf(depths)]
        hits.light[np.isinf(depths)] = sky_light(atlas(), self.weather, up / np.sqrt(dot(up, up)))
        for body, its in ((self.static, np.isfinite(depths) & ~moving), (self.traffic.body, moving.copy())):
            where = np.nonzero(its)[0]
            if body is None or not len(where):
                continue
            met = Rays(self.eye, directions.take(where, axis=0), depths[where], triangles[where], steps)
            seen = patches(body.surfaces, met)
            lit, shaded_by_traffic = self._sunlight(seen)
            hits.light[where] = shade(atlas(), seen, self.eye, lit, self.weather, self.optics)
            hits.lit[where], hits.normal[where] = lit, seen.normal
            hits.look[where] = 1 + seen.texture + 64 * (seen.tint[:, 0] * 255).astype(np.int32)
            hits.moving[where] |= shaded_by_traffic
        return hits

    def _nearest(self, pixels: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray, BoolArray]:
        """Depth [N], triangle [N], and whether that is one of the traffic's [N]."""
        depths, triangles = self.static.cast(self.eye, directions)
        depths, moving = depths.copy(), np.zeros(len(depths), dtype=bool)
        near = self.traffic.in_sight(pixels)
        if self.traffic.body is not None and len(near):
            car_depths, car_triangles = self.traffic.body.cast(self.eye, directions[near])
            nearer = car_depths < depths[near]
            moving[near] = nearer
            depths[near[nearer]], triangles[near[nearer]] = car_depths[nearer], car_triangles[nearer]
        return depths, triangles, moving

    def _sunlight(self, seen: Patches) -> tuple[BoolArray, BoolArray]:
        """Whether the sun reaches the patches [K], and whether only the traffic keeps it off [K]."""
        to_sun = self.weather.to_sun.astype(np.float32)
        lit, by_traffic = np.zeros(len(seen.points), dtype=bool), np.zeros(len(seen.points), dtype=bool)
        leaf = seen.texture == Texture.LEAVES
        facing = np.nonzero((seen.normal @ to_sun > 0) | leaf)[0]
        gap = np.where(leaf[facing], np.float32(LEAF_GAP_M), np.float32(0.01))[:, None]
        points = seen.points[facing] + np.float32(0.01) * seen.normal[facing] + gap * to_sun
        free = ~self.static.blocks(points, to_sun)
        near = self.traffic.in_reach(points)
        if self.traffic.body is not None and len(near):
            by_traffic[facing[near]] = free[near] & self.traffic.body.blocks(points[near], to_sun)
        lit[facing] = free
        return lit & ~by_traffic, by_traffic


def _window(points_cam: FloatArray, camera: Intrinsics) -> tuple[FloatArray, FloatArray]:
    """The lowest and highest pixel at which points [N, 3] can be seen; everything when some are beside the camera."""
    if (points_cam[:, 2] < 0.2).any():
        return np.full(2, -np.inf), np.full(2, np.inf)
    pixels, _ = pinhole.project(points_cam, camera)
    return pixels.min(axis=0) - 1.0, pixels.max(axis=0) + 1.0


def _bell(spread_px: float) -> FloatArray:
    """The weights of a Gaussian out to three spreads; (1,) for none."""
    reach = int(np.ceil(3 * spread_px))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(spread_px, 1e-9)) ** 2)
    return (weights / weights.sum()).astype(np.float32)


def _blurred(light: FloatArray, kernel: FloatArray) -> FloatArray:
    """The light [H, W, 3] blurred by a kernel [K] both ways, K - 1 smaller; the same for any crop, to the last bit."""
    for axis in (0, 1):
        length = light.shape[axis] - len(kernel) + 1
        parts = (weight * np.take(light, range(k, k + length), axis=axis) for k, weight in enumerate(kernel))
        light = sum(parts, start=np.zeros((), dtype=np.float32))
    return light


def _edges(hits: _Hits, size: tuple[int, int]) -> BoolArray:
    """Pixels [H, W] whose neighbours show something else, or the same in another light."""
    look, lit, inverse = hits.look.reshape(size), hits.lit.reshape(size), 1.0 / hits.depths.reshape(size)
    normal = hits.normal.reshape(*size, 3)
    edge = np.zeros(size, dtype=bool)
    for axis in (0, 1):
        here, there = (
            tuple(slice(*ends) if axis == k else slice(None) for k in (0, 1)) for ends in ((1, None), (None, -1))
        )
        turned = np.abs(np.einsum("hwk,hwk->hw", normal[here], normal[there])) < 0.8
        leaves = (look[here] == look[there]) & (look[here] % 64 == Texture.LEAVES + 1)
        jump = np.where(leaves, 0.2, 0.06)  # leaves before leaves show little of an edge
        step = np.abs(inverse[here] - inverse[there]) > jump * np.maximum(inverse[here], inverse[there])
        differs = (look[here] != look[there]) | (lit[here] != lit[there]) | step | (turned & ~leaves)
        edge[here] |= differs
        edge[there] |= differs
    return edge
