"""Encoders and decoders: one setting for all sizes."""

import pytest
import torch
from torch import nn

from geovp_learned.video.autoencoder import (
    AutoencoderConfig,
    Decoder,
    Encoder,
    initialise,
)


@pytest.mark.parametrize("style", ["dcgan", "vgg"])
@pytest.mark.parametrize(
    ("size_px", "num_stages"), [(64, 4), (128, 5), (256, 6)]
)  # 64 -> 32 -> 16 -> 8 -> 4 is four
def test_every_doubling_of_the_image_adds_one_stage(
    style: str, size_px: int, num_stages: int
) -> None:
    coding = AutoencoderConfig(style, size_px, width=2, code_size=6)
    encoder = Encoder(coding, 3, "svg").eval()
    decoder = Decoder(coding, 2, "svg", nn.Identity()).eval()
    with torch.no_grad():
        codes, skips = encoder(torch.rand(1, 3, size_px, size_px))
        maps = decoder(codes, skips)
    assert len(list(encoder.children())) - 1 == len(skips) == num_stages
    assert codes.shape == (1, 6)
    assert maps.shape == (1, 2, size_px, size_px)
    outermost_px = (
        size_px if style == "vgg" else size_px // 2
    )  # VGG's skips leave before the pooling
    assert skips[0].shape == (1, 2, outermost_px, outermost_px)


def test_weights_start_around_zero_and_gains_around_one() -> None:
    """SVG's utils.init_weights: a standard deviation of .02."""
    torch.manual_seed(0)
    encoder = Encoder(AutoencoderConfig("vgg", 16, 32, 8), 3, "svg")
    initialise(encoder)
    convolution, norm, _ = encoder.c2[0].main
    assert float(convolution.weight.std()) == pytest.approx(0.02, rel=0.05)
    assert not convolution.bias.any()
    assert float((norm.weight - 1).std()) == pytest.approx(0.02, rel=0.3)
