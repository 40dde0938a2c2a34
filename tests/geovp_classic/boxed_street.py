"""A street of flat ground, a wall ahead and a box in front of it, with or without a moving car."""

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import Context, FloatArray, Intrinsics, Trajectory

CAMERA = Intrinsics(120.0, 120.0, 63.5, 55.0, 128, 112)
HEIGHT = 1.6  # of the camera above the ground
WALL = 24.0  # z of the wall, in world coordinates
BOX = (1.0, 4.0, 14.0)  # left and right x of a box's front that stands on the ground, and its z


def straight(num: int = 6, step: float = 0.8, yaw_rad: float = 0.0) -> FloatArray:
    """Return poses [T, 4, 4] that go ahead, and turn by `yaw_rad` a step."""
    return se3.exp(np.arange(num)[:, None] * np.array([0, 0, step, 0, yaw_rad, 0]))


def _texture(points: FloatArray, tint: float) -> FloatArray:
    """Return grey values [...] of points [..., 3]: plane waves with lengths of 0.4 or more."""
    rng = np.random.default_rng(7)
    value = np.full(points.shape[:-1], 128.0)
    for wavelength in (0.4, 0.55, 0.8, 1.3, 2.5, 5.0):
        for _ in range(3):
            direction = rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            phase = points @ (2 * np.pi / wavelength * direction)
            value += 14 * np.sin(phase + tint + rng.uniform(0, 6))
    return value


def _halve(image: FloatArray) -> FloatArray:
    """Return the means of 2x2 pixels [H, W], so that the texture does not flicker."""
    height_px, width_px = image.shape
    return image.reshape(height_px // 2, 2, width_px // 2, 2).mean(axis=(1, 3))


def _double(camera: Intrinsics) -> Intrinsics:
    return camera.resized(2 * camera.width_px, 2 * camera.height_px)


def depth_of_street(
    world_from_cam: FloatArray, camera: Intrinsics = CAMERA
) -> tuple[FloatArray, FloatArray]:
    """Return z-depth [H, W] and world points [H, W, 3]."""
    rays = pinhole.rays(camera) @ world_from_cam[:3, :3].T
    origin = world_from_cam[:3, 3]
    with np.errstate(divide="ignore"):
        ground = np.where(rays[..., 1] > 1e-9, (HEIGHT - origin[1]) / rays[..., 1], np.inf)
        wall = (WALL - origin[2]) / rays[..., 2]
        box = (BOX[2] - origin[2]) / rays[..., 2]
    on_box = origin + box[..., None] * rays
    is_box = (on_box[..., 0] > BOX[0]) & (on_box[..., 0] < BOX[1]) & (box > 0)
    is_box &= (on_box[..., 1] > HEIGHT - 3.0) & (on_box[..., 1] < HEIGHT)
    depth = np.minimum(np.minimum(ground, wall), np.where(is_box, box, np.inf))
    return depth, origin + depth[..., None] * rays


def image(world_from_cam: FloatArray, camera: Intrinsics = CAMERA) -> FloatArray:
    """Render the street, uint8 [H, W, 3]."""
    _, points = depth_of_street(world_from_cam, _double(camera))
    grey = np.clip(np.round(_halve(_texture(points, 0.0))), 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=-1)


def observe(world_from_cam: FloatArray) -> tuple[Context, Trajectory, FloatArray]:
    """Return context, past and true inverse depths [P, H, W] of the street from some poses."""
    times_s = 0.1 * np.arange(len(world_from_cam) + 1)
    frames = np.stack([image(pose) for pose in world_from_cam])
    depths = np.stack([depth_of_street(pose)[0] for pose in world_from_cam])
    past = Trajectory(world_from_cam, times_s[:-1], is_metric=True)
    return Context(frames, times_s, CAMERA), past, 1 / depths
