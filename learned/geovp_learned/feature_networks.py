"""The convolutional layers of AlexNet, SqueezeNet 1.1 and VGG-19, numbered as in torchvision."""

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn


class FeatureNetwork(nn.Module):
    """A chain of layers that returns the outputs of some of them."""

    def __init__(self, layers: Sequence[nn.Module], channels: Mapping[int, int]) -> None:
        """Build a chain that returns the outputs of the layers with these numbers and channels."""
        super().__init__()
        self.features = nn.Sequential(*layers)
        self.channels = channels

    def forward(self, images: Tensor) -> list[Tensor]:
        """Return feature maps [N, C, h, w] of images [N, 3, H, W]."""
        maps = []
        for number, layer in enumerate(self.features):
            images = layer(images)
            if number in self.channels:
                maps.append(images)
        return maps


class Fire(nn.Module):
    """SqueezeNet's module (Iandola et al. 2016): 1x1, then 1x1 and 3x3 in parallel."""

    def __init__(self, in_channels: int, squeezed: int, expanded: int) -> None:
        super().__init__()
        self.squeeze = nn.Conv2d(in_channels, squeezed, 1)
        self.expand1x1 = nn.Conv2d(squeezed, expanded, 1)
        self.expand3x3 = nn.Conv2d(squeezed, expanded, 3, padding=1)

    def forward(self, maps: Tensor) -> Tensor:
        """Map features [N, C, H, W] to [N, 2 * expanded, H, W]."""
        squeezed = self.squeeze(maps).relu()
        expanded = torch.cat([self.expand1x1(squeezed), self.expand3x3(squeezed)], dim=1)
        return expanded.relu()


def alexnet() -> FeatureNetwork:
    """Build AlexNet (Krizhevsky 2014); it returns its five rectified convolutions."""
    layers = [
        nn.Conv2d(3, 64, 11, 4, 2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
        nn.Conv2d(64, 192, 5, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
        nn.Conv2d(192, 384, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(384, 256, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(256, 256, 3, padding=1),
        nn.ReLU(),
    ]
    return FeatureNetwork(layers, {1: 64, 4: 192, 7: 384, 9: 256, 11: 256})


def squeezenet() -> FeatureNetwork:
    """Build SqueezeNet 1.1; it returns its first convolution and six of its modules."""

    def pooling() -> nn.Module:
        return nn.MaxPool2d(3, 2, ceil_mode=True)

    layers = [
        nn.Conv2d(3, 64, 3, 2),
        nn.ReLU(),
        pooling(),
        Fire(64, 16, 64),
        Fire(128, 16, 64),
        pooling(),
        Fire(128, 32, 128),
        Fire(256, 32, 128),
        pooling(),
        Fire(256, 48, 192),
        Fire(384, 48, 192),
        Fire(384, 64, 256),
        Fire(512, 64, 256),
    ]
    return FeatureNetwork(layers, {1: 64, 4: 128, 7: 256, 9: 384, 10: 384, 11: 512, 12: 512})


def vgg19() -> FeatureNetwork:
    """Build VGG-19 (Simonyan and Zisserman 2015); it returns the first layer of each stage."""
    layers: list[nn.Module] = []
    in_channels = 3
    for channels, num_layers in ((64, 2), (128, 2), (256, 4), (512, 4), (512, 1)):
        if layers:
            layers.append(nn.MaxPool2d(2))
        for _ in range(num_layers):
            layers += [nn.Conv2d(in_channels, channels, 3, padding=1), nn.ReLU()]
            in_channels = channels
    return FeatureNetwork(layers, {1: 64, 6: 128, 11: 256, 20: 512, 29: 512})
