"""Small test clip: a drive between two walls, ray-traced exactly in milliseconds."""

import functools

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, Clip, ExtraView, FloatArray, Intrinsics, Trajectory

CAMERA = Intrinsics(150.0, 150.0, 63.5, 63.5, 128, 128)
WIDE = CAMERA.cropped(-32, 0, 192, 128)
CAMERA_HEIGHT_M = 1.65


@functools.cache
def clip(num_frames: int = 10, step_m: float = 0.5) -> Clip:
    """Render frames, 0.1 s apart, with all ground truth; `step_m = 0` is stationary."""
    world_from_start = se3.exp(np.array([3.0, -2.0, 7.0, 0.1, -0.4, 0.2]))  # not the identity
    twist = np.array([0.0, 0.0, 1.0, 0.002, 0.02, 0.0])
    start_from_cam = se3.exp(np.outer(np.arange(num_frames) * step_m, twist))
    cam_from_right = se3.compose(np.eye(3), np.array([0.5, 0.0, 0.0]))
    times_s = 20.0 + 0.1 * np.arange(num_frames)
    frames, depths = _render(start_from_cam, CAMERA)
    full_frames, _ = _render(start_from_cam, WIDE)
    right_frames, _ = _render(start_from_cam @ cam_from_right, WIDE)
    return Clip(
        name="contract/street",
        frames=frames,
        times_s=times_s,
        intrinsics=CAMERA,
        trajectory=Trajectory(world_from_start @ start_from_cam, times_s, is_metric=True),
        depths=depths,
        moving=np.zeros(depths.shape, dtype=bool),
        full=ExtraView(full_frames, WIDE, np.eye(4)),
        right=ExtraView(right_frames, WIDE, se3.inverse(cam_from_right)),
        camera_height_m=CAMERA_HEIGHT_M,
    )


def _render(start_from_cam: FloatArray, camera: Intrinsics) -> tuple[ByteArray, FloatArray]:
    images = [_ray_trace(pose, camera) for pose in start_from_cam]
    frames, depths = zip(*images, strict=True)
    return np.stack(frames), np.stack(depths)


def _ray_trace(start_from_cam: FloatArray, camera: Intrinsics) -> tuple[ByteArray, FloatArray]:
    """Return image [H, W, 3] and depth [H, W] of the road, two walls 6 m high, and the sky."""
    rays = pinhole.rays(camera) @ start_from_cam[:3, :3].T
    origin = start_from_cam[:3, 3]
    road = np.where(rays[..., 1] > 0, (CAMERA_HEIGHT_M - origin[1]) / rays[..., 1], np.inf)
    wall = (5.0 * np.sign(rays[..., 0]) - origin[0]) / rays[..., 0]
    depth = np.minimum(road, wall)
    is_above_wall = origin[1] + depth * rays[..., 1] < CAMERA_HEIGHT_M - 6.0
    is_sky = is_above_wall | (depth > 200)
    surface = origin + np.where(is_sky, 0, depth)[..., None] * rays
    sky = 3 * rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    points = np.where(is_sky[..., None], sky, surface)
    colour = _texture(points) + 40 * is_sky[..., None]
    depth = np.where(is_sky, np.inf, depth).astype(np.float32)
    return np.clip(colour, 0, 255).astype(np.uint8), depth


def _texture(points: FloatArray) -> FloatArray:
    """Return the colours [..., 3] of points [..., 3]: nine plane waves of random direction."""
    waves = np.random.default_rng(20).uniform(-1, 1, (9, 4))  # direction and phase
    frequencies = np.arange(1, 10)
    values = np.sin((points @ waves[:, :3].T) * frequencies + 3 * waves[:, 3])
    grey = 120 + 80 * (values / (frequencies + 1)).sum(axis=-1)
    return grey[..., None] + 12 * values[..., :3]
