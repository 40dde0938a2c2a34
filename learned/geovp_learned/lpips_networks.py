"""The feature layers that LPIPS compares, of AlexNet and SqueezeNet 1.1, numbered as in
torchvision; masked means.
"""

import functools
from collections.abc import Iterator, Mapping

import torch
from torch import Tensor
from torch.nn import functional

Weights = Mapping[str, Tensor]

ALEX_LAYERS = (
    (0, 4, 2, False),
    (3, 1, 2, True),
    (6, 1, 1, True),
    (8, 1, 1, False),
    (10, 1, 1, False),
)
SQUEEZE_FIRES = (
    ((3, 4), True),
    ((6, 7), True),
    ((9,), True),
    ((10,), False),
    ((11,), False),
    ((12,), False),
)


def alex_features(weights: Weights, pixels: Tensor) -> Iterator[Tensor]:
    """Return the outputs of AlexNet's five rectified convolutions."""
    for layer, stride, padding, is_pooled in ALEX_LAYERS:
        if is_pooled:
            pixels = functional.max_pool2d(pixels, 3, 2)
        pixels = _convolved(weights, f"features.{layer}", pixels, stride, padding)
        yield pixels


def squeeze_features(weights: Weights, pixels: Tensor) -> Iterator[Tensor]:
    """Return the outputs of SqueezeNet 1.1's first convolution, then of six of its stages."""
    pixels = _convolved(weights, "features.0", pixels, stride=2)
    yield pixels
    for fires, is_pooled in SQUEEZE_FIRES:
        if is_pooled:
            pixels = functional.max_pool2d(pixels, 3, 2, ceil_mode=True)
        for fire in fires:
            squeezed = _convolved(weights, f"features.{fire}.squeeze", pixels)
            narrow = _convolved(weights, f"features.{fire}.expand1x1", squeezed)
            wide = _convolved(weights, f"features.{fire}.expand3x3", squeezed, padding=1)
            pixels = torch.cat([narrow, wide], dim=1)
        yield pixels


def _convolved(
    weights: Weights, name: str, pixels: Tensor, stride: int = 1, padding: int = 0
) -> Tensor:
    return functional.conv2d(
        pixels, weights[f"{name}.weight"], weights[f"{name}.bias"], stride, padding
    ).relu_()


def masked_mean(values: Tensor, share: Tensor | None) -> Tensor:
    """Return the mean [N] of maps [N, h, w], weighted by how much of the mask [N, H, W] lies under
    each cell.
    """
    if share is None:
        return values.mean(dim=(1, 2))
    rows, columns = (
        _pooling(*sizes).to(share.device)
        for sizes in zip(share.shape[1:], values.shape[1:], strict=True)
    )
    counted = (rows @ share @ columns.T).double()
    return (values * counted).sum(dim=(1, 2)) / counted.sum(dim=(1, 2))


@functools.lru_cache(maxsize=64)
def _pooling(size: int, cells: int) -> Tensor:
    """Return the matrix [cells, size] that averages a row of pixels over each cell, as torch's
    adaptive pooling does.
    """
    cell, pixel = torch.arange(cells)[:, None], torch.arange(size)
    inside = ((pixel >= cell * size // cells) & (pixel < -(-(cell + 1) * size // cells))).float()
    return inside / inside.sum(dim=1, keepdim=True)
