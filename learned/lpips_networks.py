"""The feature layers that LPIPS compares: AlexNet and SqueezeNet 1.1, layers numbered as torchvision numbers them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import torch
from torch import Tensor
from torch.nn import functional

Weights = Mapping[str, Tensor]

ALEX_LAYERS = ((0, 4, 2, False), (3, 1, 2, True), (6, 1, 1, True), (8, 1, 1, False), (10, 1, 1, False))
SQUEEZE_FIRES = (((3, 4), True), ((6, 7), True), ((9,), True), ((10,), False), ((11,), False), ((12,), False))


def alex_features(weights: Weights, pixels: Tensor) -> Iterator[Tensor]:
    """The five rectified convolutions of AlexNet."""
    for layer, stride, padding, is_pooled in ALEX_LAYERS:
        if is_pooled:
            pixels = functional.max_pool2d(pixels, 3, 2)
        pixels = _convolved(weights, f"features.{layer}", pixels, stride, padding)
        yield pixels


def squeeze_features(weights: Weights, pixels: Tensor) -> Iterator[Tensor]:
    """The first convolution of SqueezeNet 1.1, then six of its stages."""
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


def _convolved(weights: Weights, name: str, pixels: Tensor, stride: int = 1, padding: int = 0) -> Tensor:
    return functional.conv2d(pixels, weights[f"{name}.weight"], weights[f"{name}.bias"], stride, padding).relu_()
