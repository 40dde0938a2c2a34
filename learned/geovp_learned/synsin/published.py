"""SynSin's three networks as Wiles et al. 2020 published them.

Channels, noise, resampling and the order of the layers are facts of the authors' repository
(facebookresearch/synsin at 82ff948: its networks "resnet_256W8UpDown64" and "Unet"); the code is
ours.
"""

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

from geovp_learned.blocks import Resample
from geovp_learned.synsin import splatting
from geovp_learned.synsin.network import INITIAL_M, Architecture, FeatureCloud, Generator, Images
from geovp_learned.synsin.splatting import Splatter

WIDTH = 64  # channels that all others are multiples of
NOISE = 20  # numbers drawn for each normalisation
ENCODER = (0.5, 0.5, 0.5, 1, 1, 1, 1)  # channels after each block but the last, in widths
REFINEMENT = (1, 2, 4, 4, 2, 2, 2)
RESAMPLED: tuple[Resample, ...] = ("keep", "down", "down", "keep", "up", "up", "keep", "keep")
DEPTH = (0.5, 1, 2, 4, 4, 4, 4, 4)  # of the U-Net, after each halving
NUM_BLOCKS = len(RESAMPLED)
SAME_SIZE: Sequence[Resample] = ["keep"] * NUM_BLOCKS
NOISE_SIZE = 2 * NOISE * NUM_BLOCKS  # of all normalisations of a network of blocks
DISC_RADIUS_RATIO = 4 / 256  # radius of a point in heights of the image: 4 pixels of 256
POINTS_PER_PIXEL = 128
MIN_INVERSE_DEPTH, MAX_INVERSE_DEPTH = (
    0.01,
    10.01,
)  # 1/m; the repository's --use_inverse_depth, for KITTI


def splatter(height_px: int) -> Splatter:
    """Return the paper's splatting of 256x256 images, at the same scale in others."""
    return Splatter(radius_px=DISC_RADIUS_RATIO * height_px, points_per_pixel=POINTS_PER_PIXEL)


class PublishedGenerator(Generator):
    """SynSin without its discriminator, in the published variant.

    Known differences that are left: untrained depth is 20 m, where the repository starts with 0.2 m
    and also trains on views from behind (here all targets lie ahead, and nothing that near would
    ever be seen); opacities reach 0.999 at a point's very centre, not 0.968; frames of other sizes
    than 256x256 can be shown.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__(architecture, NOISE_SIZE)  # of each of the two networks of blocks
        width, features = architecture.width, architecture.features
        self.feature_network = Blocks([*_channels(3, ENCODER, width), features])
        self.depth_network = DepthNetwork(width)
        self.refinement_network = Blocks([*_channels(features, REFINEMENT, width), 3], RESAMPLED)

    def depths(self, frames: Tensor, rays: Tensor) -> Tensor:
        """Estimate inverse depths [B, H, W] of frames [B, 3, H, W], from the colours alone."""
        return self.depth_network(2 * frames - 1)

    def features(self, frames: Tensor, noise: Tensor | None) -> Tensor:
        """Return learned features, with noise that is drawn if none is given."""
        if noise is None:
            noise = torch.randn(len(frames), NOISE_SIZE, device=frames.device)
        return self.feature_network(2 * frames - 1, noise).float()

    def render(
        self,
        cloud: FeatureCloud,
        cam_from_last: Tensor,
        intrinsics: Tensor,
        size_px: tuple[int, int],
        noise: Tensor,
    ) -> Images:
        """Render clouds from the poses [B, 4, 4] of cameras [B, 4], in images of (height, width);
        holes are features of 0.
        """
        blended, opacities = self.splat(
            cloud, cam_from_last, intrinsics, size_px, splatter(size_px[0])
        )
        height, width = size_px
        maps = functional.pad(blended[:, :-1], (0, -width % 4, 0, -height % 4), mode="replicate")
        frames = torch.tanh(self.refinement_network(maps, noise).float())[:, :, :height, :width]
        return Images(
            (frames + 1) / 2, opacities, blended[:, -1:] / opacities.clamp(min=splatting.EPS)
        )


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
        normal: Tensor = self.norm(maps)
        return (
            normal * (1 + self.gain(noise))[:, :, None, None] + self.offset(noise)[:, :, None, None]
        )


class Block(nn.Module):
    """A residual block that changes the size after its convolutions; every convolution with
    spectral normalisation.
    """

    def __init__(self, in_channels: int, out_channels: int, resample: Resample = "keep") -> None:
        super().__init__()
        self.resample = resample
        self.norm1, self.norm2 = Norm(in_channels), Norm(out_channels)
        self.conv1, self.conv2 = (
            _convolution(in_channels, out_channels),
            _convolution(out_channels, out_channels),
        )
        is_plain = resample == "keep" and in_channels == out_channels
        self.shortcut = (
            nn.Identity() if is_plain else spectral_norm(nn.Conv2d(in_channels, out_channels, 1))
        )

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Map features [B, C, H, W] to [B, C', H', W'], with noise [B, 2 * NOISE]."""
        first, second = noise.split(NOISE, dim=1)
        inner = self.conv1(functional.relu(self.norm1(maps, first)))
        inner = self.conv2(functional.relu(self.norm2(inner, second)))
        return _resampled(inner, self.resample) + _resampled(self.shortcut(maps), self.resample)


class Blocks(nn.Module):
    """Residual blocks one after the other: the feature network keeps the size, the refinement
    network works at 1/4.
    """

    def __init__(self, channels: Sequence[int], resampled: Sequence[Resample] = SAME_SIZE) -> None:
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

    def __init__(self, width: int = WIDTH) -> None:
        """Build the network with new weights; untrained, it predicts about INITIAL_M everywhere."""
        super().__init__()
        down = _channels(3, DEPTH, width)
        self.down = nn.ModuleList(_convolution(a, b, stride=2) for a, b in itertools.pairwise(down))
        self.down_norms = nn.ModuleList(
            nn.BatchNorm2d(size) for size in down[2:-1]
        )  # not of the first and last
        up = [*reversed(down[1:-1]), 1]
        # with skip connections to each level
        into = [down[-1], *(2 * size for size in up[:-1])]
        self.up = nn.ModuleList(_convolution(a, b) for a, b in zip(into, up, strict=True))
        self.up_norms = nn.ModuleList(nn.BatchNorm2d(size) for size in up[:-1])
        fraction = (1 / INITIAL_M - MIN_INVERSE_DEPTH) / (MAX_INVERSE_DEPTH - MIN_INVERSE_DEPTH)
        last = self.up[-1].bias
        assert isinstance(last, nn.Parameter)
        nn.init.constant_(last, float(torch.logit(torch.tensor(fraction))))

    def forward(self, frames: Tensor) -> Tensor:
        """Estimate inverse depths [B, H, W] 1/m of frames [B, 3, H, W] in [-1, 1], computed in full
        precision.
        """
        size_px, multiple = (frames.shape[2], frames.shape[3]), 2 ** len(self.down)
        height, width = (max(round(side / multiple), 1) * multiple for side in size_px)
        with torch.autocast(frames.device.type, enabled=False):
            maps = self.down[0](
                functional.interpolate(frames.float(), (height, width), mode="bilinear")
            )
            skips = [maps]
            for level, down in enumerate(self.down[1:]):
                maps = down(functional.leaky_relu(maps, 0.2))
                maps = self.down_norms[level](maps) if level < len(self.down_norms) else maps
                skips.append(maps)
            maps = skips.pop()
            for up, norm in zip(self.up[:-1], self.up_norms, strict=True):
                maps = torch.cat(
                    [norm(up(_resampled(functional.relu(maps), "up"))), skips.pop()], dim=1
                )
            raw = self.up[-1](_resampled(functional.relu(maps), "up"))
            raw = functional.interpolate(raw, size_px, mode="bilinear")[:, 0]
        return torch.sigmoid(raw) * (MAX_INVERSE_DEPTH - MIN_INVERSE_DEPTH) + MIN_INVERSE_DEPTH


def _channels(first: int, widths: Sequence[float], width: int) -> list[int]:
    return [first, *(max(1, round(ratio * width)) for ratio in widths)]


def _convolution(in_channels: int, out_channels: int, stride: int = 1) -> nn.Module:
    return spectral_norm(
        nn.Conv2d(in_channels, out_channels, 3 if stride == 1 else 4, stride, padding=1)
    )


def _resampled(maps: Tensor, resample: Resample) -> Tensor:
    if resample == "down":
        return functional.avg_pool2d(maps, 3, stride=2, padding=1)
    return (
        maps
        if resample == "keep"
        else functional.interpolate(maps, scale_factor=2, mode="bilinear")
    )
