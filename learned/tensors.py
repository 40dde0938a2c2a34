"""Frames as networks want them: seen by the network's own camera, channels first, in [0, 1]."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from torch import Tensor

from geovp_classic.types import ByteArray, FloatArray, Intrinsics


def images_from_frames(frames: ByteArray) -> Tensor:
    """Frames [..., H, W, 3] as float32 [..., 3, H, W] in [0, 1]."""
    return torch.from_numpy(frames.astype(np.float32)).movedim(-1, -3) / 255.0


def shrunk(frames: Sequence[ByteArray], camera: Intrinsics, wanted: Intrinsics) -> tuple[list[ByteArray], Intrinsics]:
    """Frames [H, W, 3] brought to the focal lengths of another camera where that makes them smaller, and their camera.

    Area averages: what comes after may then sample the images without aliasing.
    """
    width_px = round(camera.width_px * min(1.0, wanted.fx_px / camera.fx_px))
    height_px = round(camera.height_px * min(1.0, wanted.fy_px / camera.fy_px))
    size_px = (max(width_px, 1), max(height_px, 1))
    if size_px == (camera.width_px, camera.height_px):
        return list(frames), camera
    return [_area(frame, size_px) for frame in frames], camera.resized(*size_px)


def retaken(
    frame: ByteArray,  # [H, W, 3]
    camera: Intrinsics,
    wanted: Intrinsics,
    cam_from_wanted: FloatArray | None = None,  # [3, 3]; the identity when not given
    *,
    mirrored: bool = False,
) -> ByteArray:
    """What another camera at the same place sees: its calibration, turned by a rotation, and left and right exchanged.

    What the frame does not show is filled with its border.
    """
    rotation = np.eye(3) if cam_from_wanted is None else cam_from_wanted
    homography = camera.matrix @ rotation @ np.linalg.inv(wanted.matrix)  # pixels of the frame from those wanted
    if mirrored:
        homography = camera.matrix @ rotation @ np.diag([-1.0, 1.0, 1.0]) @ np.linalg.inv(wanted.matrix)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size_px = (wanted.width_px, wanted.height_px)
    taken = cv2.warpPerspective(frame, homography, size_px, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(taken, dtype=np.uint8)


def _area(frame: ByteArray, size_px: tuple[int, int]) -> ByteArray:
    return np.asarray(cv2.resize(frame, size_px, interpolation=cv2.INTER_AREA), dtype=np.uint8)
