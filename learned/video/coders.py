"""Images to codes and back, like DCGAN or VGG, at any size that is a power of two.

Every stage halves the image until 4x4 pixels are left; a larger image has more stages, and nothing else changes.
That is how the thesis takes SVG and SLAMP from 64x64 to 256x256.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from geovp_classic.errors import BadData

INNERMOST_PX = 4
MOST_WIDENING = 8  # channels of the innermost stages, in widths
VGG_CONVOLUTIONS = (2, 2, 3)  # of the first stages; all later ones have as many as the last
DARKEST = 1 / 512  # half a grey level, so that black has a finite logit

Skips = Sequence[Tensor]  # feature maps of the stages, outermost first


@dataclass(frozen=True)
class Coding:
    """The shape of encoders and decoders; stored with the weights.

    With `residual` a decoder says how the image that its skip connections come from changes, instead of the whole
    image: one more skip connection, from image to image. Untrained, it repeats that image. The papers have
    none; it makes hours of training on a CPU into minutes.
    """

    style: Literal["dcgan", "vgg"] = "vgg"
    size_px: int = 64
    width: int = 64  # channels of the outermost stage
    code_size: int = 128
    residual: bool = False

    def __post_init__(self) -> None:
        """Raise BadData for a size that cannot be halved down to 4."""
        if self.size_px < 2 * INNERMOST_PX or self.size_px & (self.size_px - 1):
            raise BadData(f"coding.size_px is {self.size_px}, expected a power of two of 8 or more, such as 64 or 256")

    @property
    def channels(self) -> list[int]:
        """Of every stage, outermost first."""
        num_stages = (self.size_px // INNERMOST_PX).bit_length() - 1
        return [self.width * min(2**stage, MOST_WIDENING) for stage in range(num_stages)]


class Encoder(nn.Module):
    """Images to codes in (-1, 1), with the feature maps of all stages for a decoder's skip connections."""

    def __init__(self, coding: Coding, in_channels: int = 3) -> None:
        """For images with so many channels."""
        super().__init__()
        stage = _strided if coding.style == "dcgan" else _convolutions
        sizes = [in_channels, *coding.channels]
        self.stages = nn.ModuleList(stage(sizes[n], sizes[n + 1], n) for n in range(len(sizes) - 1))
        self.is_pooling = coding.style == "vgg"
        self.head = nn.Sequential(
            nn.Conv2d(sizes[-1], coding.code_size, INNERMOST_PX, bias=False),
            nn.BatchNorm2d(coding.code_size),
            nn.Tanh(),
        )

    def forward(self, images: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Codes [N, code_size] and skips of images [N, C, H, W] in [0, 1]."""
        skips = []
        maps = images.contiguous(memory_format=torch.channels_last)  # twice as fast on a CPU
        for stage in self.stages:
            maps = stage(maps)
            skips.append(maps)
            if self.is_pooling:
                maps = functional.max_pool2d(maps, 2)
        return self.head(maps).flatten(1), skips


class Decoder(nn.Module):
    """Codes and skips to maps of the images' size; the mirror image of an encoder."""

    def __init__(self, coding: Coding, out_channels: int = 3, code_size: int | None = None) -> None:
        """Starts at zero when it is residual; `code_size` where it is not the coding's."""
        super().__init__()
        self.coding = coding
        sizes = [coding.width, *coding.channels]
        self.head = nn.Sequential(
            nn.ConvTranspose2d(code_size or coding.code_size, sizes[-1], INNERMOST_PX, bias=False),
            nn.BatchNorm2d(sizes[-1]),
            nn.LeakyReLU(0.2),
        )
        stage = _doubling if coding.style == "dcgan" else _convolutions
        self.stages = nn.ModuleList(stage(2 * sizes[n + 1], sizes[n], n) for n in reversed(range(len(sizes) - 1)))
        self.last = nn.Conv2d(sizes[0], out_channels, 3, padding=1)
        if coding.residual:
            nn.init.zeros_(self.last.weight)
            assert self.last.bias is not None
            nn.init.zeros_(self.last.bias)

    def forward(self, codes: Tensor, skips: Skips) -> Tensor:
        """Maps [N, out_channels, H, W], unbounded, from codes [N, code_size]."""
        maps = self.head(codes[:, :, None, None]).contiguous(memory_format=torch.channels_last)
        for stage, skip in zip(self.stages, reversed(skips), strict=True):
            if self.coding.style == "vgg":
                maps = functional.interpolate(maps, scale_factor=2, mode="nearest")
            maps = stage(torch.cat([maps, skip], dim=1))
        changes: Tensor = self.last(maps)
        return changes


def images_from_maps(maps: Tensor, base: Tensor | None) -> Tensor:
    """Decoded maps [N, 3, H, W] as images in (0, 1); changes of `base` [N, 3, H, W] where there is one."""
    return torch.sigmoid(maps if base is None else maps + torch.logit(base, DARKEST))


def repeated(skips: Skips, rows: int) -> list[Tensor]:
    """The one row of each map so many times, without taking memory for it."""
    return [maps.expand(rows, *maps.shape[1:]) for maps in skips]


def picked(skips: Skips, batch: int, steps: Tensor) -> list[Tensor]:
    """Of maps [B * T, ...] those of certain steps of every clip, as [B * len(steps), ...]."""
    return [maps.unflatten(0, (batch, -1))[:, steps].flatten(0, 1) for maps in skips]


def _strided(in_channels: int, out_channels: int, stage: int) -> nn.Module:
    return nn.Sequential(nn.Conv2d(in_channels, out_channels, 4, 2, 1, bias=False), *_activated(out_channels))


def _doubling(in_channels: int, out_channels: int, stage: int) -> nn.Module:
    convolution = nn.ConvTranspose2d(in_channels, out_channels, 4, 2, 1, bias=False)
    return nn.Sequential(convolution, *_activated(out_channels))


def _convolutions(in_channels: int, out_channels: int, stage: int) -> nn.Module:
    layers: list[nn.Module] = []
    for _ in range(VGG_CONVOLUTIONS[min(stage, len(VGG_CONVOLUTIONS) - 1)]):
        layers += [nn.Conv2d(in_channels, out_channels, 3, padding=1, bias=False), *_activated(out_channels)]
        in_channels = out_channels
    return nn.Sequential(*layers)


def _activated(channels: int) -> tuple[nn.Module, nn.Module]:
    return nn.BatchNorm2d(channels), nn.LeakyReLU(0.2)
