"""A corridor to drive through: a textured road, two walls and a far end, ray-cast, so that every
pose is known.
"""

import cv2
import numpy as np

from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import ByteArray, FloatArray, Intrinsics

HEIGHT_M = 1.65
# (normal, offset) of the planes n . x = offset: road, left wall, right wall, far end, sky
PLANES = (
    ((0, 1, 0), HEIGHT_M),
    ((-1, 0, 0), 5.0),
    ((1, 0, 0), 6.0),
    ((0, 0, 1), 60.0),
    ((0, -1, 0), 9.0),
)


def _texture(seed: int) -> ByteArray:
    rng = np.random.default_rng(seed)
    layers = [
        cv2.resize(rng.random((n, n), dtype=np.float32), (1024, 1024), interpolation=3)
        for n in (64, 256, 512)
    ]
    return cv2.normalize(sum(layers), None, 10, 245, cv2.NORM_MINMAX).astype(np.uint8)


TEXTURES = [_texture(seed) for seed in range(len(PLANES))]


def _image(camera: Intrinsics, world_from_cam: FloatArray) -> ByteArray:
    """The grey image [H, W] of the corridor."""
    rays = pinhole.rays(camera).reshape(-1, 3) @ world_from_cam[:3, :3].T
    centre = world_from_cam[:3, 3]
    nearest = np.full(len(rays), np.inf)
    value = np.zeros(len(rays), dtype=np.uint8)
    for (normal, offset), texture in zip(PLANES, TEXTURES, strict=True):
        towards = rays @ np.array(normal, dtype=float)
        distance = np.where(
            towards > 1e-9,
            (offset - centre @ normal) / np.where(towards > 1e-9, towards, 1),
            np.inf,
        )
        hit = distance < nearest
        points = centre + rays[hit] * distance[hit, None]
        across = points[:, [i for i in range(3) if normal[i] == 0]] * 25.0 % 1023
        at = across.astype(np.float32)
        value[hit] = np.ravel(cv2.remap(texture, at[:, :1], at[:, 1:], cv2.INTER_LINEAR))
        nearest[hit] = distance[hit]
    return cv2.GaussianBlur(value.reshape(camera.height_px, camera.width_px), (0, 0), 0.6)


CAMERA = Intrinsics(220.0, 220.0, 127.5, 85.5, 256, 192)
Film = tuple[ByteArray, FloatArray]  # images [T, H, W, 3] and poses [T, 4, 4]


def drive(twists: FloatArray) -> Film:
    """Return the film of a camera that repeats the given twists [T - 1, 6] one by one."""
    poses = [np.eye(4)]
    for twist in twists:
        poses.append(poses[-1] @ se3.exp(twist))
    greys = np.stack([_image(CAMERA, pose) for pose in poses])
    return np.repeat(greys[..., None], 3, axis=-1), np.stack(poses)


# Ten images, 0.5 m apart and turning by 0.3 degrees each.
STRAIGHT = drive(np.tile([0, 0, 0.5, 0, np.radians(0.3), 0], (9, 1)))
