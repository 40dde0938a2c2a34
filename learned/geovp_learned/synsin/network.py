"""SynSin's three networks (Wiles et al. 2020).

Channels, noise, resampling, the order of the layers and their names are facts of the authors'
repository (facebookresearch/synsin at 82ff948: its networks "resnet_256W8UpDown64" and "Unet"); the
code is ours. Only the depth network's input differs: frames may have any size.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

Resample = Literal["keep", "down", "up"]

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
# In units; z_buffermodel.py with --use_inverse_depth
MIN_INVERSE_DEPTH, MAX_INVERSE_DEPTH = 0.01, 10.01


@dataclass(frozen=True)
class Architecture:
    """Sizes of the three networks, and the unit of their depths; stored with the weights."""

    features: int = 64  # of a point
    width: int = 64  # channels of a block at the finest level
    unit_m: float = 50.0  # length of the network's unit: data/kitti.py divides translations by 50
    # Depths in units; (0, 0) = inverse depths from .01 to 10.01, that is depths from 5 m to 5 km
    depth_range: tuple[float, float] = (0.0, 0.0)
    focal_px: float = 0.0  # focal length of the images it was trained on; 0 = any


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
    """A U-Net of eight levels from colours to inverse depths.

    It works on multiples of 256 pixels: frames of a known focal length are padded, others resized.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        sizes = channels_of(3, DEPTH, architecture.width)
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

    def forward(self, frames: Tensor) -> Tensor:
        """Estimate inverse depths [B, H, W] 1/m of frames [B, 3, H, W] in [0, 1]; computed in full
        precision.
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


def channels_of(first: int, widths: Sequence[float], width: int) -> list[int]:
    """Return the channels before and after each block, from ratios to `width`."""
    return [first, *(max(1, round(ratio * width)) for ratio in widths)]
