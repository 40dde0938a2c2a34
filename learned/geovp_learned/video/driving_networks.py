"""SLAMP's networks for KITTI and Cityscapes: features on a grid of 4x4 or 4x8 instead of codes.

Sizes and module names are those of models/kitti_models.py, models/cityscapes_models.py and
models/mask_predictor.py of kaanakan/slamp (where a layer's `main` is called `layers`).
"""

from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from geovp_learned.video.autoencoder import Layer, Skips, vgg_layers

Road = Literal["kitti", "cityscapes"]

SIZES_PX = {  # height and width of the images, and of the maps after each stage
    "kitti": ((92, 310), (46, 156), (24, 80), (12, 40), (6, 20), (4, 4)),
    "cityscapes": ((128, 256), (64, 128), (32, 64), (16, 32), (8, 16), (4, 8)),
}
CHANNELS = (64, 96, 128, 192, 256)
ENCODER_LAYERS, DECODER_LAYERS = (2, 2, 3, 3, 3), (2, 2, 2, 3, 3)


class ImageEncoder(nn.Module):
    """Images to feature maps that both branches share; stages are pooled to fixed sizes."""

    def __init__(self, road: Road, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.sizes_px = SIZES_PX[road][1:]
        for stage, (a, b) in enumerate(pairwise((in_channels, *CHANNELS))):
            # KITTI's innermost stage is pooled from 6x20 alone
            stride = 1 if road == "kitti" and stage == len(CHANNELS) - 1 else 2
            first = Layer(nn.Conv2d(a, b, 3, stride, padding=1, bias=False))
            others = vgg_layers([b] * ENCODER_LAYERS[stage], has_bias=False)
            self.add_module(f"c{stage + 1}", nn.Sequential(first, *others))
        self.c6 = nn.Sequential(*vgg_layers([CHANNELS[-1], out_channels, out_channels], False))

    def forward(self, images: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return features on the grid, and skips, of images [N, C, H, W] in [0, 1]."""
        *stages, head = self.children()
        skips, maps = [], images
        for stage, size_px in zip(stages, self.sizes_px, strict=True):
            maps = functional.adaptive_max_pool2d(stage(maps), size_px)
            skips.append(maps)
        return head(maps), skips


class SpatialEncoder(nn.Module):
    """Shared features of one frame, or of two, to those of a branch."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.c1 = nn.Sequential(*vgg_layers([in_channels, 256, 256], False), SqueezeExcitation(256))
        self.c2 = nn.Sequential(*vgg_layers([256, 256, 128], False), SqueezeExcitation(128))
        self.c3 = nn.Sequential(*vgg_layers([128, 64, out_channels], False))

    def forward(self, maps: Tensor) -> Tensor:
        """Map features on the grid."""
        return self.c3(self.c2(self.c1(maps)))


class GridDecoder(nn.Module):
    """Features on the grid and skips to maps of the images' size."""

    def __init__(
        self, road: Road, in_channels: int, out_channels: int, activation: nn.Module
    ) -> None:
        super().__init__()
        self.sizes_px = SIZES_PX[road][-2::-1]
        self.upc1 = nn.Sequential(*vgg_layers([in_channels, 256, 256], False))
        after = (CHANNELS[0], *CHANNELS)
        for stage in reversed(range(len(CHANNELS))):
            inner = [CHANNELS[stage]] * (DECODER_LAYERS[stage] - 1)
            layers = vgg_layers([2 * CHANNELS[stage], *inner, after[stage]], False)
            self.add_module(f"upc{len(CHANNELS) - stage + 1}", nn.Sequential(*layers))
        last = nn.ConvTranspose2d(CHANNELS[0], out_channels, 3, 1, 1)
        self.upc7 = nn.Sequential(*vgg_layers([CHANNELS[0]] * 2, False), last, activation)

    def forward(self, maps: Tensor, skips: Skips) -> Tensor:
        """Decode maps [N, out_channels, H, W]."""
        first, *stages, last = self.children()
        maps = first(maps)
        for stage, skip, size_px in zip(stages, reversed(skips), self.sizes_px, strict=True):
            maps = stage(torch.cat([maps, skip], dim=1))
            maps = functional.interpolate(maps, size_px, mode="bilinear", align_corners=True)
        return last(maps)


class SqueezeExcitation(nn.Module):
    """Channels weighted by their means (Hu et al. 2018)."""

    def __init__(self, channels: int, reduction: int = 16) -> None:
        super().__init__()
        inner = max(channels // reduction, 1)
        self.fc = nn.Sequential(
            nn.Linear(channels, inner, bias=False),
            nn.ReLU(),
            nn.Linear(inner, channels, bias=False),
            nn.Sigmoid(),
        )

    def forward(self, maps: Tensor) -> Tensor:
        """Weigh the channels of maps [N, C, H, W]."""
        return maps * self.fc(maps.mean((2, 3)))[:, :, None, None]


class MaskNetwork(nn.Module):
    """Five convolutions from two images to the weight of the first."""

    def __init__(self, in_channels: int, width: int) -> None:
        super().__init__()
        self.c1 = nn.Sequential(
            *vgg_layers([in_channels, width, width], False), SqueezeExcitation(width)
        )
        self.c2 = nn.Sequential(*vgg_layers([width] * 3, False), SqueezeExcitation(width))
        self.c3 = nn.Sequential(nn.Conv2d(width, 1, 3, padding=1), nn.Sigmoid())

    def forward(self, images: Tensor) -> Tensor:
        """Return weights [N, 1, H, W] of images stacked in their channels."""
        return self.c3(self.c2(self.c1(images)))
