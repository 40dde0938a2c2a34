"""DCGAN and VGG encoders and decoders of SVG, SRVP and SLAMP, for any power-of-two size.

Layers and module names are those of the authors' repositories (models/vgg_64.py, vgg_128.py and
dcgan_64.py of edenton/svg and kaanakan/slamp, module/conv.py of edouardelasalles/srvp). Every stage
halves the image until 4x4 pixels are left, so larger images only add stages: 64x64 has four,
256x256 six.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from geovp_classic.errors import BadData

INNERMOST_PX = 4
MAX_CHANNEL_FACTOR = 8  # channels of the innermost stages, in widths
INITIAL_STD = 0.02  # utils.init_weights of SVG and SLAMP, module/utils.py of SRVP

# Whose layers: SVG's convolutions have biases; SRVP's have none, nor has its last one, and DCGAN's
# first layer there has no normalisation
Form = Literal["svg", "srvp", "slamp"]
Skips = Sequence[Tensor]  # feature maps of the stages, full resolution first


@dataclass(frozen=True)
class AutoencoderConfig:
    """Sizes of an encoder and its decoder; stored with the weights."""

    style: Literal["dcgan", "vgg"] = "vgg"
    size_px: int = 64
    width: int = 64  # channels of the full-resolution stage
    code_size: int = 128
    colours: Literal[1, 3] = 3  # 1: grey images

    def __post_init__(self) -> None:
        if self.size_px < 2 * INNERMOST_PX or self.size_px & (self.size_px - 1):
            raise BadData(
                f"coding.size_px is {self.size_px}, expected a power of two of 8 or more, such "
                "as 64 or 256"
            )

    @property
    def channels(self) -> list[int]:
        """Return the channels of all stages, full resolution first."""
        num_stages = (self.size_px // INNERMOST_PX).bit_length() - 1
        return [self.width * min(2**stage, MAX_CHANNEL_FACTOR) for stage in range(num_stages)]


class Layer(nn.Module):
    """A convolution, its normalisation and a leaky ReLU."""

    def __init__(
        self, convolution: nn.Conv2d | nn.ConvTranspose2d, *, is_normalised: bool = True
    ) -> None:
        super().__init__()
        norm = nn.BatchNorm2d(convolution.out_channels) if is_normalised else nn.Identity()
        self.main = nn.Sequential(convolution, norm, nn.LeakyReLU(0.2))

    def forward(self, maps: Tensor) -> Tensor:
        """Map features [N, C, H, W] to [N, C', H', W']."""
        return self.main(maps)


class Encoder(nn.Module):
    """Images to codes in (-1, 1), and the feature maps of all stages for the decoder's skip
    connections.
    """

    def __init__(self, coding: AutoencoderConfig, in_channels: int, form: Form) -> None:
        super().__init__()
        self.is_vgg, has_bias = coding.style == "vgg", form == "svg"
        sizes = [in_channels, *coding.channels]
        for stage, (a, b) in enumerate(pairwise(sizes)):
            if self.is_vgg:
                layers = vgg_layers([a, *[b] * _num_layers(stage)], has_bias)
                module: nn.Module = nn.Sequential(*layers)
            else:
                convolution = nn.Conv2d(a, b, 4, 2, 1, bias=has_bias)
                module = Layer(convolution, is_normalised=stage > 0 or form != "srvp")
            self.add_module(f"c{stage + 1}", module)
        head = nn.Conv2d(sizes[-1], coding.code_size, INNERMOST_PX, bias=has_bias)
        norm = nn.BatchNorm2d(coding.code_size)
        self.add_module(f"c{len(sizes)}", nn.Sequential(head, norm, nn.Tanh()))

    def forward(self, images: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return codes [N, code_size] and skips of images [N, C, H, W] in [0, 1]."""
        *stages, head = self.children()
        skips = []
        maps = images.contiguous(memory_format=torch.channels_last)  # twice as fast on a CPU
        for stage in stages:
            maps = stage(maps)
            skips.append(maps)
            if self.is_vgg:
                maps = functional.max_pool2d(maps, 2)
        return head(maps).flatten(1), skips


class Decoder(nn.Module):
    """Codes and skips to maps of the images' size; mirrors the encoder.

    A stage of VGG narrows in its last convolution.
    """

    def __init__(
        self,
        coding: AutoencoderConfig,
        out_channels: int,
        form: Form,
        activation: nn.Module,
        *,
        code_size: int = 0,  # 0 = the encoder's
        use_skips: bool = True,
    ) -> None:
        super().__init__()
        self.is_vgg, self.use_skips = coding.style == "vgg", use_skips
        has_bias, has_last_bias = form == "svg", form != "srvp"
        sizes, factor = coding.channels, 1 + use_skips
        first = nn.ConvTranspose2d(
            code_size or coding.code_size, sizes[-1], INNERMOST_PX, bias=has_bias
        )
        self.upc1 = nn.Sequential(first, nn.BatchNorm2d(sizes[-1]), nn.LeakyReLU(0.2))
        for stage in reversed(range(len(sizes))):
            a, b = factor * sizes[stage], sizes[stage - 1] if stage else out_channels
            if self.is_vgg and stage:
                inner = [sizes[stage]] * (_num_layers(stage) - 1)
                module: nn.Module = nn.Sequential(*vgg_layers([a, *inner, b], has_bias))
            elif self.is_vgg:
                last = nn.ConvTranspose2d(sizes[0], b, 3, 1, 1, bias=has_last_bias)
                module = nn.Sequential(*vgg_layers([a, sizes[0]], has_bias), last, activation)
            elif stage:
                module = Layer(nn.ConvTranspose2d(a, b, 4, 2, 1, bias=has_bias))
            else:
                last = nn.ConvTranspose2d(a, b, 4, 2, 1, bias=has_last_bias)
                module = nn.Sequential(last, activation)
            self.add_module(f"upc{len(sizes) - stage + 1}", module)

    def forward(self, codes: Tensor, skips: Skips) -> Tensor:
        """Decode codes [N, code_size] to maps [N, out_channels, H, W]."""
        first, *stages = self.children()
        maps = first(codes[:, :, None, None]).contiguous(memory_format=torch.channels_last)
        for stage, skip in zip(stages, reversed(skips), strict=True):
            if self.is_vgg:
                maps = functional.interpolate(maps, scale_factor=2, mode="nearest")
            maps = stage(torch.cat([maps, skip], dim=1) if self.use_skips else maps)
        return maps


def vgg_layers(sizes: Sequence[int], has_bias: bool) -> list[nn.Module]:
    """Build layers of 3x3 convolutions with these numbers of channels."""
    return [Layer(nn.Conv2d(a, b, 3, padding=1, bias=has_bias)) for a, b in pairwise(sizes)]


def initialise(network: nn.Module) -> None:
    """Draw weights as the authors do: convolutions and linear layers around 0, norms around 1."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d | nn.Linear):
            nn.init.normal_(module.weight, 0.0, INITIAL_STD)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
        elif isinstance(module, nn.BatchNorm2d):
            nn.init.normal_(module.weight, 1.0, INITIAL_STD)


def _num_layers(stage: int) -> int:
    return 2 if stage < 2 else 3
