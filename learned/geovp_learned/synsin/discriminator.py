"""Multi-scale PatchGAN discriminator (Wang et al. 2018, section 3.2) and the losses made of its
scores.
"""

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

Features = list[Tensor]  # of one scale: feature maps from fine to coarse, then the scores


class MultiScaleDiscriminator(nn.Module):
    """Patch networks at full size, at half of it, and so on; convolutions with spectral
    normalisation.

    With instance normalisation, as SynSin's repository has it, first and last convolution have no
    normalisation at all.
    """

    def __init__(
        self,
        width: int = 64,
        num_levels: int = 3,
        num_scales: int = 2,
        *,
        with_instance_norm: bool = False,
    ) -> None:
        """Build patch networks of `num_levels` strided convolutions, the first with `width`
        channels.
        """
        super().__init__()
        self.scales = nn.ModuleList(
            _PatchNetwork(width, num_levels, with_instance_norm) for _ in range(num_scales)
        )

    def forward(self, frames: Tensor) -> list[Features]:
        """Return features and scores of frames [B, 3, H, W] in [0, 1] at each scale."""
        outputs = []
        for scale in self.scales:
            outputs.append(scale(frames))
            frames = functional.avg_pool2d(frames, 3, stride=2, padding=1, count_include_pad=False)
        return outputs


class _PatchNetwork(nn.Module):
    def __init__(self, width: int, num_levels: int, with_instance_norm: bool) -> None:
        super().__init__()
        channels = [3, *(width * min(2**level, 8) for level in range(num_levels + 1))]
        self.layers = nn.ModuleList()
        for level, (a, b) in enumerate(itertools.pairwise(channels)):
            normalised = with_instance_norm and level > 0
            layer: nn.Module = nn.Conv2d(
                a, b, 4, 2 if level < num_levels else 1, padding=2, bias=not normalised
            )
            layer = layer if with_instance_norm and level == 0 else spectral_norm(layer)
            self.layers.append(nn.Sequential(layer, nn.InstanceNorm2d(b)) if normalised else layer)
        head = nn.Conv2d(channels[-1], 1, 4, padding=2)
        self.head: nn.Module = head if with_instance_norm else spectral_norm(head)

    def forward(self, frames: Tensor) -> Features:
        maps = []
        now = 2 * frames - 1
        for layer in self.layers:
            now = functional.leaky_relu(layer(now), 0.2)
            maps.append(now)
        return [*maps, self.head(now)]


def discriminator_hinge_loss(real: Sequence[Features], fake: Sequence[Features]) -> Tensor:
    """Return the mean of max(0, 1 - D(real)) + max(0, 1 + D(fake)) over scales (Lim, Ye 2017)."""
    pairs = zip(real, fake, strict=True)
    return torch.stack(
        [functional.relu(1 - a[-1]).mean() + functional.relu(1 + b[-1]).mean() for a, b in pairs]
    ).mean()


def generator_losses(critic: nn.Module, fake: Tensor, real: Tensor) -> dict[str, Tensor]:
    """Return the mean over scales of -D(fake), and the mean absolute difference of features (Wang
    et al. 2018, eq. 4); the critic's weights get no gradients.
    """
    with torch.no_grad():
        wanted = critic(real)
    critic.requires_grad_(False)
    given = critic(fake)
    critic.requires_grad_(True)
    distances: list[Tensor] = []
    for ours, theirs in zip(given, wanted, strict=True):
        layers = zip(ours[:-1], theirs[:-1], strict=True)
        distances += [functional.l1_loss(a, b) for a, b in layers]
    return {
        "adversarial": -torch.stack([scale[-1].mean() for scale in given]).mean(),
        "feature_matching": torch.stack(distances).mean(),
    }
