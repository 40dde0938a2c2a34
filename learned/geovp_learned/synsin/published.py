"""SynSin's three networks as Wiles et al. 2020 published them.

Channels, noise, resampling, the order of the layers and their names are facts of the authors'
repository (facebookresearch/synsin at 82ff948: its networks "resnet_256W8UpDown64" and "Unet"); the
code is ours. Only the depth network's input differs: frames may have any size.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

from geovp_classic.errors import BadData
from geovp_learned.blocks import Resample, gather, spread
from geovp_learned.synsin import splatting
from geovp_learned.synsin.network import Architecture, Generator, Images
from geovp_learned.synsin.splatting import Splatter

NOISE = 20  # numbers drawn for each normalisation
# Channels after each block but the last, in widths
ENCODER = (0.5, 0.5, 0.5, 1, 1, 1, 1)
REFINEMENT = (1, 2, 4, 4, 2, 2, 2)
RESAMPLED: tuple[Resample, ...] = ("keep", "down", "down", "keep", "up", "up", "keep", "keep")
SAME_SIZE: Sequence[Resample] = ["keep"] * len(RESAMPLED)
DEPTH = (0.5, 1, 2, 4, 4, 4, 4, 4)  # of the U-Net, after each halving
# The names of its normalisations, on the way down and up
DOWN_NORMS = ("", "2_0", "4_0", "8_0", "8_1", "8_2", "8_3", "")
UP_NORMS = ("8_4", "8_5", "8_6", "8_7", "4_1", "2_1", "0")
NOISE_SIZE = 2 * NOISE * len(RESAMPLED)  # of all normalisations of a network of blocks
DISC_RADIUS_RATIO = 4 / 256  # --radius: radius of a point in heights of the image
POINTS_PER_PIXEL = 128  # --pp_pixel
MIN_SQUARED_DISTANCE = 1e-3  # z_buffer_layers.py: opacities are .968 at most
MIN_OPACITY = 1e-6  # of a pixel whose inverse depth is averaged
NEAR = 0.01  # EPS of z_buffer_manipulator.py, in units
# In units; z_buffermodel.py with --use_inverse_depth
MIN_INVERSE_DEPTH, MAX_INVERSE_DEPTH = 0.01, 10.01


class PublishedGenerator(Generator):
    """SynSin without its discriminator, in the published variant.

    Lengths outside are metres; the networks know units of `unit_m`.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.feature_noise = self.refinement_noise = NOISE_SIZE
        width, features = architecture.width, architecture.features
        names = ("variant", "features", "width", "unit_m", "depth_range", "focal_px")
        if architecture != Architecture(**{name: getattr(architecture, name) for name in names}):
            raise BadData(
                f"variant 'published' has only the settings {', '.join(names[1:])}: leave others "
                "out, or choose 'residual'"
            )
        self.near_m = NEAR * architecture.unit_m
        self.feature_network = Blocks([*_channels(3, ENCODER, width), features], SAME_SIZE)
        self.depth_network = DepthNetwork(architecture)
        self.refinement_network = Blocks([*_channels(features, REFINEMENT, width), 3], RESAMPLED)

    def rays(self, intrinsics: Tensor, size_px: Sequence[int]) -> Tensor:
        """Return the directions of pixels on the authors' grid, which puts the centres of the
        outermost ones on the edges of the image.

        Under no motion, points are splatted up to half a pixel beside their pixels.
        """
        height, width = size_px
        stretch = intrinsics.new_tensor([width / max(width - 1, 1), height / max(height - 1, 1)])
        focal_px, centre_px = intrinsics.chunk(2, dim=1)
        grid = torch.cat([focal_px / stretch, (centre_px + 0.5) / stretch], dim=1)
        return splatting.rays(grid, size_px)

    def features(self, frames: Tensor, noise: Tensor) -> Tensor:
        """Return learned features."""
        return self.feature_network(2 * frames - 1, noise).float()

    def splatter(self, height_px: int) -> Splatter:
        """Return the paper's splatting of 256x256 images, at the same scale in others."""
        radius_px = DISC_RADIUS_RATIO * height_px
        return Splatter(radius_px, POINTS_PER_PIXEL, MIN_SQUARED_DISTANCE**0.5)

    def refine(self, blended: Tensor, opacities: Tensor, noise: Tensor) -> Images:
        """Paint images; holes are features of 0."""
        painted = self.refinement_network(gather(blended[:, :-1], 1, 4), noise)
        frames = spread(torch.tanh(painted.float()), 1, blended.shape[2:])
        inverse_depths = blended[:, -1:] / opacities.clamp(min=MIN_OPACITY)
        return Images((frames + 1) / 2, opacities, inverse_depths)


class Norm(nn.Module):
    """Batch normalisation with gain and offset linear in noise, both with spectral normalisation
    and no bias.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.gain, self.bias = (
            spectral_norm(nn.Linear(NOISE, channels, bias=False)) for _ in range(2)
        )
        self.bn = nn.BatchNorm2d(channels, affine=False)

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Normalise maps [B, C, H, W], modulated by noise [B, NOISE]."""
        gain, bias = 1 + self.gain(noise), self.bias(noise)
        return self.bn(maps) * gain[:, :, None, None] + bias[:, :, None, None]


class Block(nn.Module):
    """A residual block that changes the size after its convolutions; its layers have the numbers
    that they have in the authors' sequence.
    """

    def __init__(self, in_channels: int, out_channels: int, resample: Resample = "keep") -> None:
        super().__init__()
        self.ch_a = nn.ModuleDict(
            {
                "0": Norm(in_channels),
                "2": spectral_norm(nn.Conv2d(in_channels, out_channels, 3, padding=1)),
                "3": Norm(out_channels),
                "5": spectral_norm(nn.Conv2d(out_channels, out_channels, 3, padding=1)),
            }
        )
        is_plain = resample == "keep" and in_channels == out_channels
        shortcut = spectral_norm(nn.Conv2d(in_channels, out_channels, 1))
        self.ch_b = nn.Sequential() if is_plain else nn.Sequential(shortcut)
        self.resampled = {
            "keep": nn.Identity(),
            "down": nn.AvgPool2d(3, stride=2, padding=1),
            "up": nn.Upsample(scale_factor=2, mode="bilinear"),
        }[resample]

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Map features [B, C, H, W] to [B, C', H', W'], with noise [B, 2 * NOISE]."""
        first, second = noise.split(NOISE, dim=1)
        layers = self.ch_a
        inner = layers["2"](functional.relu(layers["0"](maps, first)))
        inner = layers["5"](functional.relu(layers["3"](inner, second)))
        return self.resampled(inner) + self.resampled(self.ch_b(maps))


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
    """A U-Net of eight levels on the colours alone, to inverse depths.

    It works on multiples of 256 pixels: frames of a known focal length are padded, others resized.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        sizes = _channels(3, DEPTH, architecture.width)
        outputs = [*reversed(sizes[1:-1]), 1]
        inputs = [sizes[-1], *(2 * channels for channels in outputs[:-1])]  # with skip connections
        ups = list(zip(inputs, outputs, strict=True))
        for level, (a, b) in enumerate(itertools.pairwise(sizes), 1):
            self.add_module(f"conv{level}", spectral_norm(nn.Conv2d(a, b, 4, 2, 1)))
        for level, (a, b) in enumerate(ups, 1):
            self.add_module(f"dconv{level}", spectral_norm(nn.Conv2d(a, b, 3, padding=1)))
        norms = {
            **dict(zip(DOWN_NORMS, sizes[1:], strict=True)),
            **dict(zip(UP_NORMS, outputs[:-1], strict=True)),
        }
        for name, count in sorted(norms.items()):
            if name:
                self.add_module(_norm(name), nn.BatchNorm2d(count))

    def forward(self, frames: Tensor, rays: Tensor) -> Tensor:
        """Estimate inverse depths [B, H, W] 1/m of frames [B, 3, H, W] in [0, 1], from the colours
        alone; computed in full precision.
        """
        architecture, (height, width) = self.architecture, frames.shape[2:]
        multiple = 2 ** len(DEPTH)
        with torch.autocast(frames.device.type, enabled=False):
            maps = 2 * frames.float() - 1
            if architecture.focal_px:
                padding = (0, -width % multiple, 0, -height % multiple)
                raw = self.unet(functional.pad(maps, padding, mode="replicate"))
                raw = raw[:, 0, :height, :width]
            else:
                size_px = [max(round(side / multiple), 1) * multiple for side in (height, width)]
                raw = self.unet(functional.interpolate(maps, size_px, mode="bilinear"))
                raw = functional.interpolate(raw, (height, width), mode="bilinear")[:, 0]
        fraction, (min_depth, max_depth) = torch.sigmoid(raw), architecture.depth_range
        if max_depth:
            return 1 / ((fraction * (max_depth - min_depth) + min_depth) * architecture.unit_m)
        extent = MAX_INVERSE_DEPTH - MIN_INVERSE_DEPTH
        return (fraction * extent + MIN_INVERSE_DEPTH) / architecture.unit_m

    def unet(self, maps: Tensor) -> Tensor:
        """Map images [B, 3, H, W] to [B, 1, H, W]."""
        parts: Any = self._modules
        skips: list[Tensor] = []
        for level, norm in enumerate(DOWN_NORMS, 1):
            maps = parts[f"conv{level}"](functional.leaky_relu(maps, 0.2) if skips else maps)
            maps = parts[_norm(norm)](maps) if norm else maps
            skips.append(maps)
        skips.pop()
        for level, norm in enumerate(UP_NORMS, 1):
            maps = parts[_norm(norm)](parts[f"dconv{level}"](_doubled(maps)))
            maps = torch.cat([maps, skips.pop()], dim=1)
        return parts[f"dconv{len(DEPTH)}"](_doubled(maps))


def _norm(name: str) -> str:
    """Return the authors' name of a normalisation."""
    return "batch_norm" if name == "0" else f"batch_norm{name}"


def _doubled(maps: Tensor) -> Tensor:
    return functional.interpolate(functional.relu(maps), scale_factor=2, mode="bilinear")


def _channels(first: int, widths: Sequence[float], width: int) -> list[int]:
    return [first, *(max(1, round(ratio * width)) for ratio in widths)]
