"""Film the street: rays from every pixel to the nearest surface, more of them where edges are, shadows from the sun."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import open3d as o3d

from geovp_classic.data.synthetic.mesh import Soup
from geovp_classic.data.synthetic.shading import Surfaces, shade, surfaces_of
from geovp_classic.data.synthetic.textures import Texture, atlas
from geovp_classic.data.synthetic.world import World
from geovp_classic.geometry import pinhole
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Intrinsics

SUBPIXELS = np.array([(-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)])  # a rotated grid
LEAF_GAP_M = 0.7  # leaves are not shaded by their nearest neighbours, which would be all flicker


@dataclass(frozen=True)
class Optics:
    """What lies between the street and the sensor; `Optics(0, 0)` looks the same from everywhere."""

    haze_per_m: float = 0.0012  # how quickly far things fade
    gloss: float = 1.0  # scales what glass and paint mirror
    finest_detail_m: float = 0.0  # smooths textures to this size, so that pictures survive resampling


@dataclass(frozen=True)
class Footage:
    """What a camera saw on a drive, without noise."""

    light: FloatArray  # [T, H, W, 3] float32, linear
    depths: FloatArray  # [T, H, W] float32 z-depth at pixel centres; inf = sky
    moving: BoolArray  # [T, H, W]; True on moving things and in their shadows

    @property
    def frames(self) -> ByteArray:
        """Pictures [T, H, W, 3]."""
        return developed(self.light)


def developed(light: FloatArray) -> ByteArray:
    """Bytes of linear light."""
    return np.asarray(np.sqrt(np.clip(light, 0.0, 1.0)) * 255 + 0.5, dtype=np.uint8)


def render_drive(
    world: World,
    world_from_cam: FloatArray,  # [T, 4, 4]
    camera: Intrinsics,
    times_s: FloatArray,  # [T]; where the traffic is
    optics: Optics | None = None,
) -> Footage:
    """The street from any camera at any times; pixels at edges are averages of five rays."""
    stage = _Stage(world, optics or Optics())
    shots = [stage.shoot(pose, camera, float(time_s)) for pose, time_s in zip(world_from_cam, times_s, strict=True)]
    light, depths, moving = (np.stack(parts) for parts in zip(*shots, strict=True))
    return Footage(light, depths, moving)


@dataclass(frozen=True)
class _Hits:
    """What rays met."""

    depths: FloatArray  # [N]
    triangles: FloatArray  # [N], -1 for nothing
    lit: FloatArray  # [N], 0 or 1
    moving: BoolArray  # [N]


class _Stage:
    """The street ready for rays; the traffic is put in its place for every shot."""

    def __init__(self, world: World, optics: Optics) -> None:
        self.world = world
        self.weather = replace(
            world.weather, haze_per_m=optics.haze_per_m, gloss=optics.gloss, finest_m=optics.finest_detail_m
        )
        self.scene = _scene(world.static)
        self.num_static = len(world.static)
        self.static = surfaces_of(world.static)

    def shoot(
        self, world_from_cam: FloatArray, camera: Intrinsics, time_s: float
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Light [H, W, 3], depth [H, W] and moving [H, W] of one picture."""
        traffic = self.world.traffic_at(time_s)
        shot = _Shot(self, traffic, world_from_cam, camera)
        margin = camera.cropped(-1, -1, camera.width_px + 2, camera.height_px + 2)
        grid = pinhole.pixel_grid(margin)
        hits, light = shot.trace(grid.reshape(-1, 2) - 1.0)
        size = grid.shape[:2]
        edge = _edges(shot.surfaces, hits, size)[1:-1, 1:-1]
        light = light.reshape(*size, 3)[1:-1, 1:-1].copy()
        moving = hits.moving.reshape(size)[1:-1, 1:-1].copy()
        depths = hits.depths.reshape(size)[1:-1, 1:-1]
        rows, columns = np.nonzero(edge)
        if len(rows):
            pixels = np.stack([columns, rows], axis=-1)[:, None] + SUBPIXELS
            more, more_light = shot.trace(pixels.reshape(-1, 2))
            total = light[rows, columns] + more_light.reshape(len(rows), -1, 3).sum(axis=1)
            light[rows, columns] = total / (len(SUBPIXELS) + 1)
            moving[rows, columns] |= more.moving.reshape(len(rows), -1).any(axis=1)
        return light, depths.astype(np.float32), moving


class _Shot:
    """One instant seen from one place."""

    def __init__(self, stage: _Stage, traffic: Soup | None, world_from_cam: FloatArray, camera: Intrinsics) -> None:
        self.stage, self.camera, self.eye = stage, camera, world_from_cam[:3, 3]
        self.rotation = world_from_cam[:3, :3]
        self.traffic = None if traffic is None else _scene(traffic)
        self.surfaces = stage.static if traffic is None else _appended(stage.static, surfaces_of(traffic))

    def trace(self, pixels: FloatArray) -> tuple[_Hits, FloatArray]:
        """What rays through pixels [N, 2] meet, and the light [N, 3] that comes along them."""
        rays = pinhole.unproject(pixels, np.ones(len(pixels)), self.camera)
        directions = (rays @ self.rotation.T).astype(np.float32)
        depths, triangles = _cast(self.stage.scene, self.eye, directions)
        moving = np.zeros(len(depths), dtype=bool)
        if self.traffic is not None:
            near, which = _cast(self.traffic, self.eye, directions)
            moving = near < depths
            depths = np.where(moving, near, depths)
            triangles = np.where(moving, which + self.stage.num_static, triangles)
        lit, shaded_by_traffic = self._sunlight(directions, depths, triangles)
        hits = _Hits(depths, triangles, lit, moving | shaded_by_traffic)
        steps = np.stack([self.rotation[:, 0] / self.camera.fx_px, self.rotation[:, 1] / self.camera.fy_px])
        light = shade(atlas(), self.surfaces, self.stage.weather, self.eye, directions, depths, triangles, lit, steps)
        return hits, light

    def _sunlight(
        self, directions: FloatArray, depths: FloatArray, triangles: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Whether the sun reaches the points [N], and whether it would but for the traffic [N]."""
        to_sun = self.stage.weather.to_sun
        lit, by_traffic = np.ones(len(depths), dtype=np.float32), np.zeros(len(depths), dtype=bool)
        hit = np.nonzero(triangles >= 0)[0]
        normal = self.surfaces.normal[triangles[hit]]
        away = np.sign((normal * directions[hit]).sum(axis=-1, keepdims=True))
        leaf = self.surfaces.texture[triangles[hit]] == Texture.LEAVES
        turned = ((-away * normal) @ to_sun <= 0) & ~leaf
        lit[hit[turned]] = 0.0
        hit, normal, away, leaf = hit[~turned], normal[~turned], away[~turned], leaf[~turned]
        gap = np.where(leaf, LEAF_GAP_M, 0.01)[:, None]
        points = self.eye + depths[hit, None] * directions[hit] - 0.01 * away * normal + gap * to_sun
        blocked = _blocked(self.stage.scene, points, to_sun)
        if self.traffic is not None:
            by_traffic[hit] = ~blocked & _blocked(self.traffic, points, to_sun)
        lit[hit] = ~(blocked | by_traffic[hit])
        return lit, by_traffic


def _scene(soup: Soup) -> o3d.t.geometry.RaycastingScene:
    scene = o3d.t.geometry.RaycastingScene()
    vertices = o3d.core.Tensor(soup.corners.reshape(-1, 3).astype(np.float32))
    scene.add_triangles(vertices, o3d.core.Tensor(np.arange(3 * len(soup), dtype=np.uint32).reshape(-1, 3)))
    return scene


def _cast(
    scene: o3d.t.geometry.RaycastingScene, eye: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Depths [N] (inf for nothing) and triangles [N] (-1 for nothing)."""
    rays = np.concatenate([np.broadcast_to(eye.astype(np.float32), directions.shape), directions], axis=-1)
    answer = scene.cast_rays(o3d.core.Tensor(rays))
    depths = answer["t_hit"].numpy()
    return depths, np.where(np.isfinite(depths), answer["primitive_ids"].numpy().astype(np.int64), -1)


def _blocked(scene: o3d.t.geometry.RaycastingScene, points: FloatArray, to_sun: FloatArray) -> BoolArray:
    rays = np.concatenate([points, np.broadcast_to(to_sun, points.shape)], axis=-1).astype(np.float32)
    blocked: BoolArray = scene.test_occlusions(o3d.core.Tensor(rays)).numpy()
    return blocked


def _appended(first: Surfaces, second: Surfaces) -> Surfaces:
    pairs = {name: (value, getattr(second, name)) for name, value in vars(first).items()}
    return Surfaces(**{name: np.concatenate(pair) for name, pair in pairs.items()})


def _edges(surfaces: Surfaces, hits: _Hits, size: tuple[int, int]) -> BoolArray:
    """Pixels [H, W] whose neighbours show something else, or the same in another light."""
    triangles = hits.triangles.reshape(size)
    known = np.maximum(triangles, 0)
    look = np.where(triangles >= 0, surfaces.texture[known] + 1, 0) + 64 * (surfaces.tint[known, 0] * 255).astype(int)
    lit, inverse = hits.lit.reshape(size), 1.0 / hits.depths.reshape(size)
    normal = surfaces.normal[known]
    edge = np.zeros(size, dtype=bool)
    for here, there in (
        ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
        ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
    ):
        turned = np.abs((normal[here] * normal[there]).sum(axis=-1)) < 0.8
        leaves = surfaces.texture[known][here] == Texture.LEAVES
        step = np.abs(inverse[here] - inverse[there]) > 0.06 * np.maximum(inverse[here], inverse[there])
        differs = (look[here] != look[there]) | (lit[here] != lit[there]) | step | (turned & ~leaves)
        edge[here] |= differs
        edge[there] |= differs
    return edge
