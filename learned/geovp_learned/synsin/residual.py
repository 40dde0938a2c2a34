"""Our variant of SynSin (`residual`). It differs from the networks of Wiles et al. 2020 in this:

- The first three features of a point are its colours, and the refinement network corrects the
  splatted colours instead of painting new ones: an untrained network already shows the frame.
- Holes are filled by pull-push before refinement, which also sees the opacity.
- The depth network also gets the rays of all pixels and always sees `depth_px` rows, so that focal
  length and frame size do not matter. It has six levels instead of eight.
- Points have a radius of 1 pixel and 8 of them count, instead of 4 of 256 and 128.
- The feature network has no noise. With `patch_px` = 2, blocks work on 2x2 pixels.

Trained alike for 2400 steps, these departures halve LPIPS together; the colours, the filling and
the small points matter most (docs/results/synsin-published.md).
"""

from __future__ import annotations

import functools

import torch
from torch import Tensor, nn
from torch.nn import functional

from geovp_learned.blocks import NoisyNorm, Resample, ResidualBlock, UNet, gather, spread
from geovp_learned.synsin.network import COLOURS, INITIAL_M, Architecture, Generator, Images
from geovp_learned.synsin.splatting import SOLID_FACTOR, Splatter, pull_push

NEAREST_M = 2.0  # the depth network's range is from here to infinity


class ResidualGenerator(Generator):
    """SynSin without its discriminator, in our variant."""

    def __init__(self, architecture: Architecture) -> None:
        """Build the model with new weights; untrained, it renders a cloud at INITIAL_M in its own
        colours.
        """
        super().__init__()
        self.feature_noise, self.refinement_noise = 0, architecture.noise_size
        self.architecture = architecture
        self.feature_network = FeatureNetwork(architecture)
        self.depth_network = DepthNetwork(architecture)
        self.refinement_network = RefinementNetwork(architecture)

    def features(self, frames: Tensor, noise: Tensor) -> Tensor:
        """Return the colours and learned features."""
        return torch.cat([frames, self.feature_network(frames, noise).float()], dim=1)

    def splatter(self, height_px: int) -> Splatter:
        """Return the splatter of the settings, whatever the height."""
        return self.architecture.splatter

    def refine(self, blended: Tensor, opacities: Tensor, noise: Tensor) -> Images:
        """Fill holes from their surroundings, then refine colours."""
        with torch.autocast(blended.device.type, enabled=False):
            filled = pull_push(blended, opacities)
        maps = torch.cat([filled[:, :-1], (SOLID_FACTOR * opacities).clamp(max=1)], dim=1)
        return Images(self.refinement_network(maps, noise).float(), opacities, filled[:, -1:])


class DepthNetwork(nn.Module):
    """A U-Net from colours and rays to inverse depths in (0, 1 / NEAREST_M]; computed in full
    precision.
    """

    def __init__(self, architecture: Architecture) -> None:
        """Build the network with new weights; untrained, it predicts about INITIAL_M everywhere."""
        super().__init__()
        self.rows = architecture.depth_px
        self.multiple = 2 ** len(architecture.depth_channels)
        self.unet = UNet(COLOURS + 2, architecture.depth_channels, 1)
        fraction = NEAREST_M / INITIAL_M
        nn.init.normal_(self.unet.head.weight, std=1e-3)
        self.unet.head.bias = nn.Parameter(torch.logit(torch.tensor([fraction])))

    def forward(self, frames: Tensor, rays: Tensor) -> Tensor:
        """Estimate inverse depths [B, H, W] of frames [B, 3, H, W] with rays [B, H * W, 3]."""
        height, width = frames.shape[2:]
        with torch.autocast(frames.device.type, enabled=False):
            directions = rays[..., :2].transpose(1, 2).unflatten(2, (height, width))
            columns = max(round(width / height * self.rows / self.multiple), 1) * self.multiple
            seen = functional.interpolate(
                torch.cat([frames - 0.5, directions], dim=1),
                (self.rows, columns),
                mode="bilinear",
                antialias=True,
            )
            raw = functional.interpolate(self.unet(seen), (height, width), mode="bilinear")
        return torch.sigmoid(raw[:, 0]) / NEAREST_M


class FeatureNetwork(nn.Module):
    """Residual blocks from colours to the other features of a point."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.patch_px, width = architecture.patch_px, architecture.width
        self.stem = nn.Conv2d(COLOURS * architecture.patch_px**2, width, 3, padding=1)
        blocks = (
            ResidualBlock(width, width, NoisyNorm) for _ in range(architecture.feature_blocks)
        )
        self.blocks = nn.ModuleList(blocks)
        self.norm = NoisyNorm(width)
        self.head = nn.Conv2d(width, architecture.features - COLOURS, 1)

    def forward(self, frames: Tensor, noise: Tensor) -> Tensor:
        """Return features [B, C, H, W], without the colours, of frames [B, 3, H, W]; the noise is
        empty.
        """
        maps = self.stem(gather(frames - 0.5, self.patch_px, 1))
        for block in self.blocks:
            maps = block(maps, noise)
        return spread(
            self.head(functional.relu(self.norm(maps, noise))), self.patch_px, frames.shape[2:]
        )


class RefinementNetwork(nn.Module):
    """Residual blocks with noise, down two levels and up again, that correct splatted colours and
    inpaint holes.
    """

    def __init__(self, architecture: Architecture) -> None:
        """Build the network with new weights; untrained, it leaves the colours unchanged."""
        super().__init__()
        self.patch_px = architecture.patch_px
        width, seen = architecture.width, architecture.features + 1
        levels: list[tuple[int, int, Resample]]
        levels = [(1, 1, "down"), (1, 2, "down"), (2, 1, "up"), (1, 1, "up")]
        levels[2:2] = [(2, 2, "keep")] * architecture.inner_blocks
        norm = functools.partial(NoisyNorm, noise_size=architecture.noise_size)
        self.stem = nn.Conv2d(seen * architecture.patch_px**2, width, 3, padding=1)
        self.blocks = nn.ModuleList(
            ResidualBlock(a * width, b * width, norm, resample) for a, b, resample in levels
        )
        self.norm = norm(width)
        self.detail = nn.Conv2d(width + seen, width // 2, 3, padding=1)
        self.head = nn.Conv2d(width // 2, COLOURS, 3, padding=1)
        for parameter in self.head.parameters():
            nn.init.zeros_(parameter)

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Decode splatted features and their opacity [B, C + 1, H, W] to frames [B, 3, H, W]."""
        finest = inner = self.stem(gather(maps, self.patch_px, 4))
        for block in self.blocks:
            inner = block(inner, noise)
        painted = spread(
            functional.relu(self.norm(inner + finest, noise)), self.patch_px, maps.shape[2:]
        )
        detail = self.detail(torch.cat([maps, painted], dim=1))
        # A ReLU without a norm before it can die
        return maps[:, :COLOURS] + self.head(functional.leaky_relu(detail, 0.2))
