"""Building blocks of the networks: BigGAN's residual block with noise in its normalisation, and a U-Net."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

Resample = Literal["keep", "down", "up"]


class NoisyNorm(nn.Module):
    """Batch normalisation whose gain and offset are linear in a noise vector (Brock et al. 2019, appendix B).

    With `noise_size = 0` they are learned constants: ordinary batch normalisation.
    """

    def __init__(self, channels: int, noise_size: int = 0) -> None:
        """Gains start near 1 and offsets near 0, whatever the noise."""
        super().__init__()
        self.norm = nn.BatchNorm2d(channels, affine=noise_size == 0)
        self.gain_and_offset = nn.Linear(noise_size, 2 * channels) if noise_size else None
        if self.gain_and_offset is not None:
            nn.init.normal_(self.gain_and_offset.weight, std=0.02)
            nn.init.zeros_(self.gain_and_offset.bias)

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Maps [B, C, H, W] normalised, under noise [B, noise_size]."""
        normal: Tensor = self.norm(maps)
        if self.gain_and_offset is None:
            return normal
        gain, offset = self.gain_and_offset(noise)[:, :, None, None].chunk(2, dim=1)
        return normal * (1 + gain) + offset


class ResidualBlock(nn.Module):
    """Norm, ReLU, convolution, twice, beside a shortcut (Brock et al. 2019, figure 15); convolutions spectral-normed.

    "up" doubles the size before the first convolution, "down" halves it after the second.
    """

    def __init__(self, in_channels: int, out_channels: int, noise_size: int = 0, resample: Resample = "keep") -> None:
        """A block from `in_channels` to `out_channels`."""
        super().__init__()
        self.resample = resample
        self.norm1, self.norm2 = NoisyNorm(in_channels, noise_size), NoisyNorm(out_channels, noise_size)
        self.conv1 = spectral_norm(nn.Conv2d(in_channels, out_channels, 3, padding=1))
        self.conv2 = spectral_norm(nn.Conv2d(out_channels, out_channels, 3, padding=1))
        is_plain = in_channels == out_channels
        self.shortcut = nn.Identity() if is_plain else spectral_norm(nn.Conv2d(in_channels, out_channels, 1))

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Maps [B, C, H, W] to [B, C', H', W']."""
        inner = functional.relu(self.norm1(maps, noise))
        inner = self.conv1(_doubled(inner) if self.resample == "up" else inner)
        inner = self.conv2(functional.relu(self.norm2(inner, noise)))
        outer = self.shortcut(maps)  # of 1x1 pixels, so that it may be taken at the smaller size
        if self.resample == "up":
            outer = _doubled(outer)
        if self.resample == "down":
            inner, outer = functional.avg_pool2d(inner, 2), functional.avg_pool2d(outer, 2)
        return inner + outer


class UNet(nn.Module):
    """Down by strided convolutions, up by bilinear doubling, with bridges (Ronneberger et al. 2015).

    Sides of its input must be multiples of `2 ** len(channels)`.
    """

    def __init__(self, in_channels: int, channels: Sequence[int], out_channels: int) -> None:
        """One level down per entry of `channels`; the result has the input's size."""
        super().__init__()
        sizes = [in_channels, *channels]
        self.down = nn.ModuleList(_down(a, b) for a, b in itertools.pairwise(sizes))
        self.up = nn.ModuleList()
        now = sizes[-1]
        for bridge in reversed(sizes[:-1]):
            out = max(bridge, sizes[1] // 2)
            self.up.append(_convolution(now + bridge, out, stride=1))
            now = out
        self.head = nn.Conv2d(now, out_channels, 3, padding=1)

    def forward(self, maps: Tensor) -> Tensor:
        """Maps [B, C, H, W] to [B, C', H, W]."""
        bridges = []
        for down in self.down:
            bridges.append(maps)
            maps = down(maps)
        for up in self.up:
            maps = up(torch.cat([_doubled(maps), bridges.pop()], dim=1))
        result: Tensor = self.head(maps)
        return result


def _down(in_channels: int, out_channels: int) -> nn.Module:
    return _convolution(in_channels, out_channels, stride=2)


def _convolution(in_channels: int, out_channels: int, stride: int) -> nn.Module:
    kernel_px = 3 if stride == 1 else 4
    convolution = nn.Conv2d(in_channels, out_channels, kernel_px, stride, padding=1, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(out_channels), nn.LeakyReLU(0.2))


def _doubled(maps: Tensor) -> Tensor:
    return functional.interpolate(maps, scale_factor=2, mode="bilinear", align_corners=False)
