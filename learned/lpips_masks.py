"""Means of LPIPS's maps of differences under masks, which have more pixels than the maps have cells."""

from __future__ import annotations

import functools

import torch
from torch import Tensor


def masked_mean(values: Tensor, share: Tensor | None) -> Tensor:
    """Mean [N] of maps [N, h, w], weighted by how much of the mask [N, H, W] lies under each cell."""
    if share is None:
        return values.mean(dim=(1, 2))
    rows, columns = (_pooling(*sizes).to(share.device) for sizes in zip(share.shape[1:], values.shape[1:], strict=True))
    counted = (rows @ share @ columns.T).double()
    return (values * counted).sum(dim=(1, 2)) / counted.sum(dim=(1, 2))


@functools.lru_cache(maxsize=64)
def _pooling(size: int, cells: int) -> Tensor:
    """The matrix [cells, size] that averages a row of pixels over each cell, as torch's adaptive pooling does."""
    cell, pixel = torch.arange(cells)[:, None], torch.arange(size)
    inside = ((pixel >= cell * size // cells) & (pixel < -(-(cell + 1) * size // cells))).float()
    return inside / inside.sum(dim=1, keepdim=True)
