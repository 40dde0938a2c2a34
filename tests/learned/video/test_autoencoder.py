"""Encoders and decoders: one setting for all sizes, and what an untrained residual decoder says."""

import pytest
import torch

from geovp_learned.video.autoencoder import (
    AutoencoderConfig,
    Decoder,
    Encoder,
    select_skips,
)
from geovp_learned.video.training import VideoNetwork


@pytest.mark.parametrize("style", ["dcgan", "vgg"])
@pytest.mark.parametrize(
    ("size_px", "num_stages"), [(64, 4), (128, 5), (256, 6)]
)  # 64 -> 32 -> 16 -> 8 -> 4 is four
def test_every_doubling_of_the_image_adds_one_stage(
    style: str, size_px: int, num_stages: int
) -> None:
    coding = AutoencoderConfig(style, size_px, width=2, code_size=6)
    encoder, decoder = Encoder(coding).eval(), Decoder(coding, out_channels=2).eval()
    with torch.no_grad():
        codes, skips = encoder(torch.rand(1, 3, size_px, size_px))
        maps = decoder(codes, skips)
    assert len(encoder.stages) == len(decoder.stages) == len(skips) == num_stages
    assert codes.shape == (1, 6)
    assert maps.shape == (1, 2, size_px, size_px)
    outermost_px = (
        size_px if style == "vgg" else size_px // 2
    )  # VGG's skips leave before the pooling
    assert skips[0].shape == (1, 2, outermost_px, outermost_px)


def test_an_untrained_residual_decoder_repeats_the_image() -> None:
    coding = AutoencoderConfig("vgg", 16, 4, 8, residual=True)
    base = torch.rand(2, 3, 16, 16)
    base[0, :, 0, 0], base[0, :, 0, 1] = 0.0, 1.0
    _, skips = Encoder(coding)(base)
    shown = VideoNetwork(coding, 1).images(Decoder(coding)(torch.randn(2, 8), skips), base)
    assert (
        float((shown - base).abs().max().detach()) <= 1 / 512 + 1e-6
    )  # half a grey level, at black and white


def test_skips_of_a_step_are_those_of_its_frames() -> None:
    maps = torch.arange(6.0)[:, None, None, None]  # two clips of three steps
    (chosen,) = select_skips([maps], 2, torch.tensor([2, 0]))
    assert chosen.flatten().tolist() == [2.0, 0.0, 5.0, 3.0]
