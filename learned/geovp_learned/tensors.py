"""Frames as the networks need them: seen by the network's own camera, channels first, in [0, 1]."""

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from torch import Tensor

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray, Clip, Intrinsics, Trajectory

MIRROR = np.diag(
    [-1.0, 1.0, 1.0, 1.0]
)  # MIRROR @ motion @ MIRROR is the motion with left and right exchanged


def bytes_from_frames(frames: ByteArray) -> Tensor:
    """Convert frames [..., H, W, 3] to bytes [..., 3, H, W]."""
    return torch.from_numpy(np.moveaxis(frames, -1, -3).copy(order="C"))


def images_from_frames(frames: ByteArray) -> Tensor:
    """Convert frames [..., H, W, 3] to float32 [..., 3, H, W] in [0, 1]."""
    return bytes_from_frames(frames).float() / 255.0


def frames_from_images(images: Tensor) -> ByteArray:
    """Convert images [..., 3, H, W], clamped to [0, 1], to frames [..., H, W, 3]."""
    return (images.clamp(0, 1) * 255).round().byte().movedim(-3, -1).cpu().numpy()


def grey(frames: ByteArray) -> ByteArray:
    """Convert frames [..., H, W, 3] to grey, in three equal channels."""
    width_px, channels = frames.shape[-2:]
    luma = pinhole.grey8(frames.reshape(-1, width_px, channels))
    return np.repeat(luma.reshape(*frames.shape[:-1], 1), 3, axis=-1)


def metric_trajectory(clip: Clip) -> Trajectory:
    """Return the poses to learn from; raise BadData if the clip has none in metres."""
    if clip.trajectory is None or not clip.trajectory.is_metric:
        raise BadData(f"{clip.name} has no metric poses to learn from: leave its sequence out")
    return clip.trajectory


def seen_by(frame: ByteArray, camera: Intrinsics, wanted: Intrinsics) -> ByteArray:
    """Return a frame [H, W, 3] as another camera in the same pose takes it.

    What the frame does not show is filled with its border.
    """
    # Area averages first where that makes it smaller, so that sampling does not alias
    width_px = max(round(camera.width_px * min(1.0, wanted.fx_px / camera.fx_px)), 1)
    height_px = max(round(camera.height_px * min(1.0, wanted.fy_px / camera.fy_px)), 1)
    resized = pinhole.resize(frame, (width_px, height_px))
    # Pixels of the resized frame from those wanted
    homography = camera.resized(width_px, height_px).matrix @ np.linalg.inv(wanted.matrix)
    flags, size_px = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (wanted.width_px, wanted.height_px)
    return cv2.warpPerspective(
        resized, homography, size_px, flags=flags, borderMode=cv2.BORDER_REPLICATE
    )


def pixel_grid(size_px: Sequence[int], like: Tensor) -> Tensor:
    """Return the positions (u, v) [H, W, 2] of all pixels of an image of (height, width)."""
    axes = (torch.arange(side, dtype=like.dtype, device=like.device) for side in size_px)
    v, u = torch.meshgrid(*axes, indexing="ij")
    return torch.stack([u, v], dim=-1)


def psnr_db(predicted: Tensor, target: Tensor) -> Tensor:
    """Return the PSNR of images [..., 3, H, W] in [0, 1]; 80 dB at most."""
    return -10 * torch.log10(((predicted - target) ** 2).mean((-3, -2, -1)).clamp(min=1e-8))
