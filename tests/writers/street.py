"""Small test clip: a drive between two walls, ray-traced exactly in milliseconds."""

import functools

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, Clip, ExtraView, FloatArray, Intrinsics, Trajectory

CAMERA_HEIGHT_M = 1.65


@functools.cache
def clip(num_frames: int = 10, step_m: float = 0.5, size_px: int = 128) -> Clip:
    """Render frames, 0.1 s apart, with all ground truth; `step_m = 0` is stationary."""
    camera = Intrinsics(150.0, 150.0, 63.5, 63.5, 128, 128).resized(size_px, size_px)
    full_camera = camera.cropped(-size_px // 4, 0, size_px * 3 // 2, size_px)
    world_from_start = se3.exp(np.array([3.0, -2.0, 7.0, 0.1, -0.4, 0.2]))  # not the identity
    twist = np.array([0.0, 0.0, 1.0, 0.002, 0.02, 0.0])
    start_from_cam = se3.exp(np.outer(np.arange(num_frames) * step_m, twist))
    cam_from_right = se3.compose(np.eye(3), np.array([0.5, 0.0, 0.0]))
    times_s = 20.0 + 0.1 * np.arange(num_frames)
    frames, depths = render(start_from_cam, camera)
    full_frames, _ = render(start_from_cam, full_camera)
    right_frames, _ = render(start_from_cam @ cam_from_right, full_camera)
    return Clip(
        name="street/000000",
        frames=frames,
        times_s=times_s,
        intrinsics=camera,
        trajectory=Trajectory(world_from_start @ start_from_cam, times_s, is_metric=True),
        depths=depths,
        moving=np.zeros(depths.shape, dtype=bool),
        full=ExtraView(full_frames, full_camera, np.eye(4)),
        right=ExtraView(right_frames, full_camera, se3.inverse(cam_from_right)),
        camera_height_m=CAMERA_HEIGHT_M,
    )


def render(start_from_cam: FloatArray, camera: Intrinsics) -> tuple[ByteArray, FloatArray]:
    """Return frames [T, H, W, 3] and depths [T, H, W] of a road, two walls 6 m high, and sky."""
    rays = pinhole.rays(camera) @ np.swapaxes(start_from_cam[:, None, :3, :3], -1, -2)
    origins = start_from_cam[:, None, None, :3, 3]
    road = np.where(rays[..., 1] > 0, (CAMERA_HEIGHT_M - origins[..., 1]) / rays[..., 1], np.inf)
    wall = (5.0 * np.sign(rays[..., 0]) - origins[..., 0]) / rays[..., 0]
    depths = np.minimum(road, wall)
    surfaces = origins + np.minimum(depths, 200.0)[..., None] * rays
    is_sky = (surfaces[..., 1] < CAMERA_HEIGHT_M - 6.0) | (depths > 200.0)
    sky = 3.0 * rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    colours = _texture(np.where(is_sky[..., None], sky, surfaces)) + 40.0 * is_sky[..., None]
    depths = np.where(is_sky, np.inf, depths).astype(np.float32)
    return np.clip(colours, 0, 255).astype(np.uint8), depths


def _texture(points: FloatArray) -> FloatArray:
    """Return the colours [..., 3] of points [..., 3]: nine plane waves of random direction."""
    waves = np.random.default_rng(20).uniform(-1, 1, (9, 4))  # direction and phase
    frequencies = np.arange(1, 10)
    values = np.sin((points @ waves[:, :3].T) * frequencies + 3 * waves[:, 3])
    grey = 120 + 80 * (values / (frequencies + 1)).sum(axis=-1)
    return grey[..., None] + 12 * values[..., :3]
