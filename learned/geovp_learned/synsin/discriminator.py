"""Multi-scale PatchGAN discriminator (Wang et al. 2018, section 3.2) and the losses made of its
scores.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

Features = list[Tensor]  # of one scale: feature maps from fine to coarse, then the scores


class MultiScaleDiscriminator(nn.Module):
    """Patch networks at full and at half size, as in SynSin's repository: spectral and instance
    normalisation in all layers but the first and the last.
    """

    def __init__(self, width: int) -> None:
        """Build the patch networks; `width` are the channels of their first layer."""
        super().__init__()
        self.scales = nn.ModuleList(_PatchNetwork(width) for _ in range(2))

    def forward(self, frames: Tensor) -> list[Features]:
        """Return features and scores of frames [B, 3, H, W] in [0, 1] at each scale."""
        outputs = []
        for scale in self.scales:
            outputs.append(scale(frames))
            frames = functional.avg_pool2d(frames, 3, stride=2, padding=1, count_include_pad=False)
        return outputs


class _PatchNetwork(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList([nn.Conv2d(3, width, 4, stride=2, padding=2)])
        for factor, stride in ((1, 2), (2, 2), (4, 1)):
            channels = 2 * factor * width
            convolution = nn.Conv2d(factor * width, channels, 4, stride, padding=2, bias=False)
            self.layers.append(
                nn.Sequential(spectral_norm(convolution), nn.InstanceNorm2d(channels))
            )
        self.head = nn.Conv2d(8 * width, 1, 4, padding=2)

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
    distances = []
    for ours, theirs in zip(given, wanted, strict=True):
        *layers, _ = zip(ours, theirs, strict=True)  # without the scores
        distances += [functional.l1_loss(a, b) for a, b in layers]
    return {
        "adversarial": -torch.stack([scale[-1].mean() for scale in given]).mean(),
        "feature_matching": torch.stack(distances).mean(),
    }
