"""Images moved by optical flow, differentiable in both."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def warped(images: Tensor, flow_px: Tensor) -> Tensor:
    """Images [N, C, H, W] where each pixel shows what lies `flow_px` [N, 2, H, W] (right, down) from it.

    Bilinear between pixels; beyond the border the border goes on.
    """
    height, width = images.shape[-2:]
    rows, columns = torch.meshgrid(
        torch.arange(height, device=images.device), torch.arange(width, device=images.device), indexing="ij"
    )
    places_px = torch.stack([columns, rows]) + flow_px  # [N, 2, H, W]
    sizes = torch.tensor([width, height], device=images.device, dtype=images.dtype)[:, None, None]
    grid = ((places_px + 0.5) * 2 / sizes - 1).movedim(1, -1)  # -1 and 1 are the outer edges of the image
    return functional.grid_sample(images, grid, mode="bilinear", padding_mode="border", align_corners=False)
