"""Pictures moved by optical flow, differentiable in both."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def warped(pictures: Tensor, flow_px: Tensor) -> Tensor:
    """Pictures [N, C, H, W] where each pixel shows what lies `flow_px` [N, 2, H, W] (right, down) from it.

    Bilinear between pixels; beyond the border the border goes on.
    """
    height, width = pictures.shape[-2:]
    rows, columns = torch.meshgrid(
        torch.arange(height, device=pictures.device), torch.arange(width, device=pictures.device), indexing="ij"
    )
    places_px = torch.stack([columns, rows]) + flow_px  # [N, 2, H, W]
    sizes = torch.tensor([width, height], device=pictures.device, dtype=pictures.dtype)[:, None, None]
    grid = ((places_px + 0.5) * 2 / sizes - 1).movedim(1, -1)  # -1 and 1 are the outer edges of the picture
    return functional.grid_sample(pictures, grid, mode="bilinear", padding_mode="border", align_corners=False)
