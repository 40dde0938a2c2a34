"""A world that can be drawn exactly: a patterned plain under a patterned sky, and a box standing on
it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import Clip, FloatArray, Intrinsics, Trajectory

HEIGHT_M = 1.65


@dataclass(frozen=True)
class Plain:
    """The plain is y = HEIGHT_M, the sky is a pattern of directions, a wall stands at z = wall_z_m
    for |x| < 1.5.
    """

    wall_z_m: float | None = None

    def draw(self, world_from_cam: FloatArray, camera: Intrinsics) -> tuple[FloatArray, FloatArray]:
        """Image [H, W, 3] in [0, 255] and z-depth [H, W], by meeting each pixel's ray with the
        world.
        """
        rays = pinhole.rays(camera) @ world_from_cam[:3, :3].T
        origin = world_from_cam[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            ground = np.where(rays[..., 1] > 0, (HEIGHT_M - origin[1]) / rays[..., 1], np.inf)
            wall = self._wall(origin, rays)
        depth = np.minimum(ground, wall)
        point = origin + np.where(np.isfinite(depth), depth, 0)[..., None] * rays
        direction = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        sky = 128 + 60 * np.sin(12 * direction + np.array([0, 1, 2]))
        plain = 128 + 60 * np.sin(point[..., [0]] * 2 + np.array([0, 1, 2])) * np.cos(
            point[..., [2]]
        )
        bricks = 128 + 100 * np.sin(3 * point[..., [0]]) * np.cos(
            3 * point[..., [1]] + np.array([0, 2, 4])
        )
        colour = np.where((wall < ground)[..., None], bricks, plain)
        return np.where(np.isfinite(depth)[..., None], colour, sky), depth

    def _wall(self, origin: FloatArray, rays: FloatArray) -> FloatArray:
        if self.wall_z_m is None:
            return np.full(rays.shape[:2], np.inf)
        depth = (self.wall_z_m - origin[2]) / rays[..., 2]
        x, y = (origin[i] + depth * rays[..., i] for i in (0, 1))
        return np.where(
            (depth > 0) & (np.abs(x) < 1.5) & (y > -0.5) & (y < HEIGHT_M), depth, np.inf
        )

    def clip(self, world_from_cam: FloatArray, camera: Intrinsics) -> Clip:
        """The world seen from every pose."""
        frames, depths = zip(*(self.draw(pose, camera) for pose in world_from_cam), strict=True)
        times_s = 0.1 * np.arange(len(world_from_cam))
        return Clip(
            name="plain",
            frames=np.rint(frames).astype(np.uint8),
            times_s=times_s,
            intrinsics=camera,
            trajectory=Trajectory(world_from_cam, times_s, is_metric=True),
            depths=np.asarray(depths, dtype=np.float32),
            camera_height_m=HEIGHT_M,
        )


@pytest.fixture
def plain() -> Plain:
    return Plain()


@pytest.fixture
def walled_plain() -> Plain:
    return Plain(wall_z_m=12.0)


@pytest.fixture
def camera() -> Intrinsics:
    return Intrinsics(120.0, 118.0, 63.0, 60.0, 128, 120)


@pytest.fixture
def drive() -> FloatArray:
    """12 poses: 0.3 m a step along the plain, turning right by 0.4 degrees a step."""
    return se3.exp(np.outer(np.arange(12), [0.0, 0.0, 0.3, 0.0, np.deg2rad(0.4), 0.0]))
