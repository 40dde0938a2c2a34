"""SynSin's three networks as Wiles et al. 2020 published them.

Channels, noise, resampling and the order of the layers are facts of the authors' repository
(facebookresearch/synsin at 82ff948: its networks "resnet_256W8UpDown64" and "Unet"); the code is
ours.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

from geovp_classic.errors import BadData
from geovp_learned.blocks import Resample, ResidualBlock, gather, spread
from geovp_learned.synsin import splatting
from geovp_learned.synsin.network import INITIAL_M, Architecture, Generator, Images
from geovp_learned.synsin.splatting import Splatter

NOISE = 20  # numbers drawn for each normalisation
# Channels after each block but the last, in widths
ENCODER = (0.5, 0.5, 0.5, 1, 1, 1, 1)
REFINEMENT = (1, 2, 4, 4, 2, 2, 2)
RESAMPLED: tuple[Resample, ...] = ("keep", "down", "down", "keep", "up", "up", "keep", "keep")
SAME_SIZE: Sequence[Resample] = ["keep"] * len(RESAMPLED)
DEPTH = (0.5, 1, 2, 4, 4, 4, 4, 4)  # of the U-Net, after each halving
NOISE_SIZE = 2 * NOISE * len(RESAMPLED)  # of all normalisations of a network of blocks
DISC_RADIUS_RATIO = 4 / 256  # radius of a point in heights of the image: 4 pixels of 256
POINTS_PER_PIXEL = 128
# 1/m; the repository's --use_inverse_depth, for KITTI
MIN_INVERSE_DEPTH, MAX_INVERSE_DEPTH = 0.01, 10.01


class PublishedGenerator(Generator):
    """SynSin without its discriminator, in the published variant.

    Known differences that are left: untrained depth is 20 m, where the repository starts with 0.2 m
    and also trains on views from behind (here all targets lie ahead, and nothing that near would
    ever be seen); opacities reach 0.999 at a point's very centre, not 0.968; frames of other sizes
    than 256x256 can be shown.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.feature_noise = self.refinement_noise = NOISE_SIZE
        width, features = architecture.width, architecture.features
        if architecture != Architecture("published", features, width):
            raise BadData(
                "variant 'published' has only the settings features and width: leave others out, "
                "or choose 'residual'"
            )
        self.feature_network = Blocks([*_channels(3, ENCODER, width), features], SAME_SIZE)
        self.depth_network = DepthNetwork(width)
        self.refinement_network = Blocks([*_channels(features, REFINEMENT, width), 3], RESAMPLED)

    def features(self, frames: Tensor, noise: Tensor) -> Tensor:
        """Return learned features."""
        return self.feature_network(2 * frames - 1, noise).float()

    def splatter(self, height_px: int) -> Splatter:
        """Return the paper's splatting of 256x256 images, at the same scale in others."""
        return Splatter(DISC_RADIUS_RATIO * height_px, POINTS_PER_PIXEL)

    def refine(self, blended: Tensor, opacities: Tensor, noise: Tensor) -> Images:
        """Paint images; holes are features of 0."""
        painted = self.refinement_network(gather(blended[:, :-1], 1, 4), noise)
        frames = spread(torch.tanh(painted.float()), 1, blended.shape[2:])
        inverse_depths = blended[:, -1:] / opacities.clamp(min=splatting.EPS)
        return Images((frames + 1) / 2, opacities, inverse_depths)


class Norm(nn.Module):
    """Batch normalisation with gain and offset linear in noise, both with spectral normalisation
    and no bias.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = nn.BatchNorm2d(channels, affine=False)
        self.gain, self.offset = (
            spectral_norm(nn.Linear(NOISE, channels, bias=False)) for _ in range(2)
        )

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Normalise maps [B, C, H, W], modulated by noise [B, NOISE]."""
        normal = self.norm(maps)
        return (
            normal * (1 + self.gain(noise))[:, :, None, None] + self.offset(noise)[:, :, None, None]
        )


class Block(ResidualBlock):
    """A residual block that changes the size after its convolutions."""

    def __init__(self, in_channels: int, out_channels: int, resample: Resample = "keep") -> None:
        super().__init__(in_channels, out_channels, Norm, resample)
        if resample != "keep" and in_channels == out_channels:
            self.shortcut = spectral_norm(nn.Conv2d(in_channels, out_channels, 1))
        self.resampled = {
            "keep": nn.Identity(),
            "down": nn.AvgPool2d(3, stride=2, padding=1),
            "up": nn.Upsample(scale_factor=2, mode="bilinear"),
        }[resample]

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Map features [B, C, H, W] to [B, C', H', W'], with noise [B, 2 * NOISE]."""
        first, second = noise.split(NOISE, dim=1)
        inner = self.conv1(functional.relu(self.norm1(maps, first)))
        inner = self.conv2(functional.relu(self.norm2(inner, second)))
        return self.resampled(inner) + self.resampled(self.shortcut(maps))


class Blocks(nn.Module):
    """Residual blocks one after the other: the feature network keeps the size, the refinement
    network works at 1/4.
    """

    def __init__(self, channels: Sequence[int], resampled: Sequence[Resample]) -> None:
        super().__init__()
        pairs = zip(itertools.pairwise(channels), resampled, strict=True)
        self.blocks = nn.ModuleList(Block(a, b, resample) for (a, b), resample in pairs)

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Map features [B, C, H, W] to [B, C', H, W], with noise [B, NOISE_SIZE]; H and W are
        multiples of 4 where they change.
        """
        for block, values in zip(self.blocks, noise.split(2 * NOISE, dim=1), strict=True):
            maps = block(maps, values)
        return maps


class DepthNetwork(nn.Module):
    """A U-Net of eight levels on the colours alone, to inverse depths; frames are resized to
    multiples of 256.
    """

    def __init__(self, width: int) -> None:
        """Build the network with new weights; untrained, it predicts about INITIAL_M everywhere."""
        super().__init__()
        sizes = _channels(3, DEPTH, width)
        self.down = nn.ModuleList()
        for level, (a, b) in enumerate(itertools.pairwise(sizes)):
            layers: list[nn.Module] = [] if level == 0 else [nn.LeakyReLU(0.2)]
            layers.append(spectral_norm(nn.Conv2d(a, b, 4, stride=2, padding=1)))
            if 0 < level < len(DEPTH) - 1:
                layers.append(nn.BatchNorm2d(b))
            self.down.append(nn.Sequential(*layers))
        self.up = nn.ModuleList()
        channels = sizes[-1]
        for size in reversed(sizes[1:-1]):
            self.up.append(nn.Sequential(*_doubling(channels, size), nn.BatchNorm2d(size)))
            channels = 2 * size  # with the skip connection
        self.head = nn.Sequential(*_doubling(channels, 1))
        fraction = (1 / INITIAL_M - MIN_INVERSE_DEPTH) / (MAX_INVERSE_DEPTH - MIN_INVERSE_DEPTH)
        last: Any = self.head[-1]
        nn.init.constant_(last.bias, float(torch.logit(torch.tensor(fraction))))

    def forward(self, frames: Tensor, rays: Tensor) -> Tensor:
        """Estimate inverse depths [B, H, W] 1/m of frames [B, 3, H, W] in [0, 1], from the colours
        alone; computed in full precision.
        """
        size_px, multiple = frames.shape[2:], 2 ** len(DEPTH)
        height, width = (max(round(side / multiple), 1) * multiple for side in size_px)
        with torch.autocast(frames.device.type, enabled=False):
            maps = functional.interpolate(2 * frames.float() - 1, (height, width), mode="bilinear")
            skips = []
            for down in self.down:
                maps = down(maps)
                skips.append(maps)
            skips.pop()
            for up in self.up:
                maps = torch.cat([up(maps), skips.pop()], dim=1)
            raw = functional.interpolate(self.head(maps), size_px, mode="bilinear")[:, 0]
        return torch.sigmoid(raw) * (MAX_INVERSE_DEPTH - MIN_INVERSE_DEPTH) + MIN_INVERSE_DEPTH


def _channels(first: int, widths: Sequence[float], width: int) -> list[int]:
    return [first, *(max(1, round(ratio * width)) for ratio in widths)]


def _doubling(in_channels: int, out_channels: int) -> list[nn.Module]:
    """Build a rectified convolution at twice the size."""
    convolution = spectral_norm(nn.Conv2d(in_channels, out_channels, 3, padding=1))
    return [nn.ReLU(), nn.Upsample(scale_factor=2, mode="bilinear"), convolution]
