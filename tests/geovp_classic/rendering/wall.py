"""A smoothly painted wall, whose images and depths are known from all poses."""

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, Context, FloatArray, Intrinsics, Trajectory

CAMERA = Intrinsics(60, 60, 31.5, 23.5, 64, 48)


def wall(
    world_from_cam: FloatArray,
    distance: float = 8.0,
    camera: Intrinsics = CAMERA,
    contrast: float = 50.0,
) -> tuple[ByteArray, FloatArray]:
    """Return image [H, W, 3] and depth [H, W] of a wall at z = distance, with a mean of 100."""
    rays = pinhole.rays(camera) @ world_from_cam[:3, :3].T
    depth = (distance - world_from_cam[2, 3]) / rays[..., 2]
    place = (world_from_cam[:3, 3] + depth[..., None] * rays) * 8 / distance
    waves = np.sin(1.3 * place[..., 0]) + 0.8 * np.cos(1.7 * place[..., 1])
    image = np.repeat(100 + contrast * waves[..., None], 3, axis=2).astype(np.uint8)
    return image, depth.astype(np.float32)


def at(*positions: tuple[float, float]) -> FloatArray:
    """Return poses [N, 4, 4] at positions (x, z)."""
    return se3.compose(np.eye(3), np.array([(x, 0.0, z) for x, z in positions]))


def past_of(poses: FloatArray, distance: float = 8.0) -> tuple[Context, Trajectory]:
    """Return the observation of the wall from past poses, with recorded depth."""
    images, depths = zip(*(wall(pose, distance) for pose in poses), strict=True)
    times_s = np.arange(len(poses) + 1) * 0.1
    past = Trajectory(poses, times_s[:-1], True)
    return Context(np.stack(images), times_s, CAMERA, past=past, past_depths=np.stack(depths)), past
