"""Depth's own photometric loss, without labels: later frames read at where the points went look like the first one.

This is not in SynSin, whose depth learns from what the splatter passes back. There it reaches about a pixel far and
drowns in the content loss's noise: on the synthetic street that gradient is a hundred times as long as the one of the
true depth and points another way (cosine -0.1). Reading later frames backward (Garg et al. 2016; Godard et al. 2019)
gives depth a gradient of its own.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from learned.synsin import splatting

SSIM_SHARE = 0.85  # Godard et al. 2019, eq. 2
C1, C2 = 0.01**2, 0.03**2  # SSIM's constants for values in [0, 1]


def reprojection_loss(
    inverse_depths: Tensor,  # [B, H, W] 1/m
    frames: Tensor,  # [B, 3, H, W] in [0, 1]
    targets: Tensor,  # [B * V, 3, H, W]
    cam_from_last: Tensor,  # [B, V, 4, 4]
    intrinsics: Tensor,  # [B, 4]
) -> Tensor:
    """Mean over pixels of the least difference over views; pixels that no view shows don't count."""
    batch, views = cam_from_last.shape[:2]
    size_px = (frames.shape[2], frames.shape[3])
    rays = splatting.rays(intrinsics, size_px).repeat_interleave(views, dim=0)
    depths = inverse_depths.flatten(1).repeat_interleave(views, dim=0)
    cameras = intrinsics.repeat_interleave(views, dim=0)
    positions, _, in_front = splatting.project(rays, depths, cam_from_last.flatten(0, 1), cameras)
    read, inside = read_at(targets, positions.unflatten(1, size_px))
    wanted = frames.repeat_interleave(views, dim=0)
    difference = (1 - SSIM_SHARE) * (read - wanted).abs().mean(dim=1) + SSIM_SHARE * _dissimilarity(read, wanted)
    shown = inside & in_front.unflatten(1, size_px)
    best = torch.where(shown, difference, torch.inf).unflatten(0, (batch, views)).amin(dim=1)
    counted = torch.isfinite(best)
    return torch.where(counted, best, 0.0).sum() / counted.sum().clamp(min=1)


def read_at(frames: Tensor, positions_px: Tensor) -> tuple[Tensor, Tensor]:
    """Frames [B, 3, H, W] read at positions [B, H', W', 2], bilinearly, and which of these are inside [B, H', W']."""
    size = positions_px.new_tensor([frames.shape[3], frames.shape[2]])
    inside = ((positions_px >= 0) & (positions_px <= size - 1)).all(dim=3)
    scaled = (2 * positions_px + 1) / size - 1
    read = functional.grid_sample(frames, scaled, mode="bilinear", padding_mode="border", align_corners=False)
    return read, inside


def roughness(inverse_depths: Tensor, frames: Tensor) -> Tensor:
    """Mean slope of inverse depths [B, H, W], relative to their mean, where the image has no edge (Godard, eq. 3)."""
    relative = inverse_depths[:, None] / inverse_depths.mean(dim=(1, 2), keepdim=True)[:, None].clamp(min=1e-4)
    total = relative.new_zeros(())
    for axis in (2, 3):
        edges = frames.diff(dim=axis).abs().mean(dim=1, keepdim=True)
        total = total + (relative.diff(dim=axis).abs() * torch.exp(-10 * edges)).mean()
    return total


def _dissimilarity(one: Tensor, other: Tensor) -> Tensor:
    """(1 - SSIM) / 2 over windows of 3x3 pixels [B, H, W]."""

    def mean(maps: Tensor) -> Tensor:
        return functional.avg_pool2d(functional.pad(maps, (1, 1, 1, 1), mode="reflect"), 3, stride=1)

    a, b = mean(one), mean(other)
    variances = mean(one**2) - a**2 + mean(other**2) - b**2
    covariance = mean(one * other) - a * b
    ssim = (2 * a * b + C1) * (2 * covariance + C2) / ((a**2 + b**2 + C1) * (variances + C2))
    return ((1 - ssim) / 2).clamp(0, 1).mean(dim=1)
