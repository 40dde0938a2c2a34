"""A small test clip: a drive between two walls, ray-traced exactly in milliseconds."""

import functools

import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, Clip, ExtraView, FloatArray, Intrinsics, Trajectory

CAMERA_HEIGHT_M = 1.65
HALF_WIDTH_M = 5.0
BASELINE_M = 0.5
CAMERA = Intrinsics(150.0, 150.0, 63.5, 63.5, 128, 128)
WIDE = CAMERA.cropped(-32, 0, 192, 128)
START = se3.exp(
    np.array([3.0, -2.0, 7.0, 0.1, -0.4, 0.2])
)  # so that the first pose is not the identity
WAVES = np.random.default_rng(20).uniform(-1, 1, (9, 4))  # direction and phase


@functools.cache
def clip(num_frames: int = 10, step_m: float = 0.5) -> Clip:
    """`num_frames` frames, 0.1 s apart, with everything a clip can have; `step_m = 0`
    stands still.
    """
    start_from_cam = se3.exp(
        np.outer(np.arange(num_frames) * step_m, [0.0, 0.0, 1.0, 0.002, 0.02, 0.0])
    )
    start_from_right = start_from_cam @ se3.compose(np.eye(3), np.array([BASELINE_M, 0.0, 0.0]))
    times_s = 20.0 + 0.1 * np.arange(num_frames)
    frames, depths = _render(start_from_cam, CAMERA)
    right_from_cam = se3.compose(np.eye(3), np.array([-BASELINE_M, 0.0, 0.0]))
    return Clip(
        name="contract/street",
        frames=frames,
        times_s=times_s,
        intrinsics=CAMERA,
        trajectory=Trajectory(START @ start_from_cam, times_s, is_metric=True),
        depths=depths,
        moving=np.zeros(depths.shape, dtype=bool),
        full=ExtraView(_render(start_from_cam, WIDE)[0], WIDE, np.eye(4)),
        right=ExtraView(_render(start_from_right, WIDE)[0], WIDE, right_from_cam),
        camera_height_m=CAMERA_HEIGHT_M,
    )


def _render(start_from_cam: FloatArray, camera: Intrinsics) -> tuple[ByteArray, FloatArray]:
    frames, depths = zip(*(_ray_trace(pose, camera) for pose in start_from_cam), strict=True)
    return np.stack(frames), np.stack(depths)


def _ray_trace(start_from_cam: FloatArray, camera: Intrinsics) -> tuple[ByteArray, FloatArray]:
    """Image [H, W, 3] and depth [H, W]: every ray meets the road, a wall 6 m high, or the sky."""
    rays, eye = pinhole.rays(camera) @ start_from_cam[:3, :3].T, start_from_cam[:3, 3]
    with np.errstate(divide="ignore"):
        road = np.where(rays[..., 1] > 0, (CAMERA_HEIGHT_M - eye[1]) / rays[..., 1], np.inf)
        wall = (np.sign(rays[..., 0]) * HALF_WIDTH_M - eye[0]) / rays[..., 0]
    depth = np.minimum(road, wall)
    high = eye[1] + depth * rays[..., 1] < CAMERA_HEIGHT_M - 6.0
    depth = np.where(high | (depth > 200), np.inf, depth)
    reach = np.where(np.isfinite(depth), depth, 0)[..., None] * rays
    sky = 3 * rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    point = np.where(np.isfinite(depth)[..., None], eye + reach, sky)
    waves = np.sin((point @ WAVES[:, :3].T) * np.arange(1, 10) + 3 * WAVES[:, 3])  # [H, W, 9]
    grey = 120 + 80 * (waves / np.arange(2, 11)).sum(axis=-1)
    colour = grey[..., None] + 12 * waves[..., :3] + np.where(np.isinf(depth), 40, 0)[..., None]
    return np.clip(colour, 0, 255).astype(np.uint8), depth.astype(np.float32)
