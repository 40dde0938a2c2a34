"""Building blocks of SynSin: BigGAN's residual block with noise in its normalisation, a U-Net,
squares as channels.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

Resample = Literal["keep", "down", "up"]


class NoisyNorm(nn.Module):
    """Conditional batch normalisation: gain and offset are linear in a noise vector (Brock et al.
    2019, appendix B).

    With `noise_size = 0` it is ordinary batch normalisation.
    """

    def __init__(self, channels: int, noise_size: int = 0) -> None:
        super().__init__()
        self.norm = nn.BatchNorm2d(channels, affine=noise_size == 0)
        self.gain_and_offset = nn.Linear(noise_size, 2 * channels) if noise_size else None
        if self.gain_and_offset is not None:
            nn.init.normal_(self.gain_and_offset.weight, std=0.02)
            nn.init.zeros_(self.gain_and_offset.bias)

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Normalise maps [B, C, H, W], modulated by noise [B, noise_size]."""
        normal = self.norm(maps)
        if self.gain_and_offset is None:
            return normal
        gain, offset = self.gain_and_offset(noise)[:, :, None, None].chunk(2, dim=1)
        return normal * (1 + gain) + offset


class ResidualBlock(nn.Module):
    """BigGAN's residual block (Brock et al. 2019, figure 15); convolutions with spectral
    normalisation.

    "up" doubles the size before the first convolution, "down" halves it after the second.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        norm: Callable[[int], nn.Module],
        resample: Resample = "keep",
    ) -> None:
        super().__init__()
        self.resample = resample
        self.norm1, self.norm2 = norm(in_channels), norm(out_channels)
        self.conv1 = spectral_norm(nn.Conv2d(in_channels, out_channels, 3, padding=1))
        self.conv2 = spectral_norm(nn.Conv2d(out_channels, out_channels, 3, padding=1))
        is_plain = in_channels == out_channels
        self.shortcut = (
            nn.Identity() if is_plain else spectral_norm(nn.Conv2d(in_channels, out_channels, 1))
        )

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Map features [B, C, H, W] to [B, C', H', W']."""
        inner = functional.relu(self.norm1(maps, noise))
        inner = self.conv1(_upsampled(inner) if self.resample == "up" else inner)
        inner = self.conv2(functional.relu(self.norm2(inner, noise)))
        outer = self.shortcut(maps)  # 1x1, so that it can run at the smaller size
        if self.resample == "up":
            outer = _upsampled(outer)
        if self.resample == "down":
            inner, outer = functional.avg_pool2d(inner, 2), functional.avg_pool2d(outer, 2)
        return inner + outer


class UNet(nn.Module):
    """U-Net (Ronneberger et al. 2015): down by strided convolutions, up by bilinear upsampling,
    skip connections.

    The sides of its input must be multiples of `2 ** len(channels)`.
    """

    def __init__(self, in_channels: int, channels: Sequence[int], out_channels: int) -> None:
        """Build a level per entry of `channels`; the result has the input's size."""
        super().__init__()
        sizes = [in_channels, *channels]
        self.down = nn.ModuleList(
            _convolution(a, b, stride=2) for a, b in itertools.pairwise(sizes)
        )
        self.up = nn.ModuleList()
        channels_now = sizes[-1]
        for skip in reversed(sizes[:-1]):
            out = max(skip, sizes[1] // 2)
            self.up.append(_convolution(channels_now + skip, out, stride=1))
            channels_now = out
        self.head = nn.Conv2d(channels_now, out_channels, 3, padding=1)

    def forward(self, maps: Tensor) -> Tensor:
        """Map features [B, C, H, W] to [B, C', H, W]."""
        skips = []
        for down in self.down:
            skips.append(maps)
            maps = down(maps)
        for up in self.up:
            maps = up(torch.cat([_upsampled(maps), skips.pop()], dim=1))
        return self.head(maps)


def gather(maps: Tensor, edge_px: int, levels: int) -> Tensor:
    """Rearrange squares of pixels into channels (pixel unshuffle): [B, C, H, W] to [B, C * edge^2,
    H' / edge, W' / edge].

    Sides are padded with the border at the right and below to multiples of `edge_px * levels`.
    """
    multiple = edge_px * levels
    padding = (0, -maps.shape[3] % multiple, 0, -maps.shape[2] % multiple)
    return functional.pixel_unshuffle(functional.pad(maps, padding, mode="replicate"), edge_px)


def spread(maps: Tensor, edge_px: int, size_px: torch.Size) -> Tensor:
    """Enlarge maps [B, C, H' / edge, W' / edge] bilinearly, so that no grid shows, and cut them to
    (height, width).
    """
    if edge_px > 1:
        maps = functional.interpolate(maps, scale_factor=edge_px, mode="bilinear")
    return maps[:, :, : size_px[0], : size_px[1]]


def _convolution(in_channels: int, out_channels: int, stride: int) -> nn.Module:
    kernel_px = 3 if stride == 1 else 4
    convolution = nn.Conv2d(in_channels, out_channels, kernel_px, stride, padding=1, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(out_channels), nn.LeakyReLU(0.2))


def _upsampled(maps: Tensor) -> Tensor:
    return functional.interpolate(maps, scale_factor=2, mode="bilinear")
