"""DCGAN and VGG encoders and decoders with skip connections (Denton and Fergus 2018), for any
power-of-two size.

Every stage halves the image until 4x4 pixels are left, so larger images only add stages: 64x64 has
four, 256x256 six.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from geovp_classic.errors import BadData

INNERMOST_PX = 4
MAX_CHANNEL_FACTOR = 8  # channels of the innermost stages, in widths
LOGIT_EPS = 1 / 512  # half a grey level, so that black has a finite logit

Skips = Sequence[Tensor]  # feature maps of the stages, full resolution first


@dataclass(frozen=True)
class AutoencoderConfig:
    """Sizes of an encoder and its decoder; stored with the weights.

    With `residual` the decoder's output is added to the logits of the image that the skip
    connections come from, so an untrained network repeats that image. The papers do not do this; it
    cuts training on a CPU from hours to minutes.
    """

    style: Literal["dcgan", "vgg"] = "vgg"
    size_px: int = 64
    width: int = 64  # channels of the full-resolution stage
    code_size: int = 128
    residual: bool = False

    def __post_init__(self) -> None:
        if self.size_px < 2 * INNERMOST_PX or self.size_px & (self.size_px - 1):
            raise BadData(
                f"coding.size_px is {self.size_px}, expected a power of two of 8 or more, such "
                "as 64 or 256"
            )

    @property
    def channels(self) -> list[int]:
        """Return the channels of all stages, full resolution first."""
        num_stages = (self.size_px // INNERMOST_PX).bit_length() - 1
        return [self.width * min(2**stage, MAX_CHANNEL_FACTOR) for stage in range(num_stages)]


class Encoder(nn.Module):
    """Images to codes in (-1, 1), and the feature maps of all stages for the decoder's skip
    connections.
    """

    def __init__(self, coding: AutoencoderConfig, in_channels: int = 3) -> None:
        super().__init__()
        sizes = [in_channels, *coding.channels]
        self.stages = nn.ModuleList(
            _stage(coding, nn.Conv2d, sizes[n], sizes[n + 1], n) for n in range(len(sizes) - 1)
        )
        self.is_pooling = coding.style == "vgg"
        self.head = nn.Sequential(
            nn.Conv2d(sizes[-1], coding.code_size, INNERMOST_PX, bias=False),
            nn.BatchNorm2d(coding.code_size),
            nn.Tanh(),
        )

    def forward(self, images: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return codes [N, code_size] and skips of images [N, C, H, W] in [0, 1]."""
        skips = []
        maps = images.contiguous(memory_format=torch.channels_last)  # twice as fast on a CPU
        for stage in self.stages:
            maps = stage(maps)
            skips.append(maps)
            if self.is_pooling:
                maps = functional.max_pool2d(maps, 2)
        return self.head(maps).flatten(1), skips


class Decoder(nn.Module):
    """Codes and skips to maps of the images' size; mirrors the encoder."""

    def __init__(self, coding: AutoencoderConfig, out_channels: int = 3) -> None:
        """Build the network; the last layer starts at zero if residual."""
        super().__init__()
        self.coding = coding
        sizes = [coding.width, *coding.channels]
        self.head = nn.Sequential(
            nn.ConvTranspose2d(coding.code_size, sizes[-1], INNERMOST_PX, bias=False),
            *_norm_relu(sizes[-1]),
        )
        self.stages = nn.ModuleList(
            _stage(coding, nn.ConvTranspose2d, 2 * sizes[n + 1], sizes[n], n)
            for n in reversed(range(len(sizes) - 1))
        )
        self.last = nn.Conv2d(sizes[0], out_channels, 3, padding=1)
        if coding.residual:
            for parameter in self.last.parameters():
                nn.init.zeros_(parameter)

    def forward(self, codes: Tensor, skips: Skips) -> Tensor:
        """Decode codes [N, code_size] to maps [N, out_channels, H, W], unbounded."""
        maps = self.head(codes[:, :, None, None]).contiguous(memory_format=torch.channels_last)
        for stage, skip in zip(self.stages, reversed(skips), strict=True):
            if self.coding.style == "vgg":
                maps = functional.interpolate(maps, scale_factor=2, mode="nearest")
            maps = stage(torch.cat([maps, skip], dim=1))
        return self.last(maps)


def select_skips(skips: Skips, batch: int, steps: Tensor) -> list[Tensor]:
    """Select the skips of some time steps: of maps [B * T, ...] those [B * len(steps), ...]."""
    return [maps.unflatten(0, (batch, -1))[:, steps].flatten(0, 1) for maps in skips]


def _stage(
    coding: AutoencoderConfig,
    resampling: type[nn.Conv2d | nn.ConvTranspose2d],  # of DCGAN
    in_channels: int,
    out_channels: int,
    stage: int,
) -> nn.Module:
    if coding.style == "dcgan":
        return nn.Sequential(
            resampling(in_channels, out_channels, 4, 2, 1, bias=False), *_norm_relu(out_channels)
        )
    layers: list[nn.Module] = []
    for _ in range(2 if stage < 2 else 3):
        layers += [
            nn.Conv2d(in_channels, out_channels, 3, padding=1, bias=False),
            *_norm_relu(out_channels),
        ]
        in_channels = out_channels
    return nn.Sequential(*layers)


def _norm_relu(channels: int) -> tuple[nn.Module, nn.Module]:
    return nn.BatchNorm2d(channels), nn.LeakyReLU(0.2)
