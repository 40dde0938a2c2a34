"""Encoders and decoders: one setting for all sizes."""

import pytest
import torch

from geovp_learned.video.autoencoder import (
    AutoencoderConfig,
    Encoder,
    initialise,
)


def test_weights_start_around_zero_and_gains_around_one() -> None:
    """SVG's utils.init_weights: a standard deviation of .02."""
    torch.manual_seed(0)
    encoder = Encoder(AutoencoderConfig("vgg", 16, 32, 8), 3, "svg")
    initialise(encoder)
    convolution, norm, _ = encoder.c2[0].main
    assert float(convolution.weight.std()) == pytest.approx(0.02, rel=0.05)
    assert not convolution.bias.any()
    assert float((norm.weight - 1).std()) == pytest.approx(0.02, rel=0.3)
