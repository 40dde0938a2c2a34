"""Scheduled sampling of SLAMP."""

from unittest.mock import Mock

import pytest
import torch

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.slamp import Architecture, SlampNetwork, SlampTraining

ARCHITECTURE = Architecture(AutoencoderConfig("dcgan", 8, 4, 8), 8, latent_size=2, mask_width=4)


@pytest.mark.parametrize(("epoch", "probability"), [(0, 25 / 26), (50, 25 / (25 + 7.389056))])
def test_scheduled_sampling_fades_the_real_frame_out(epoch: int, probability: float) -> None:
    """With k = 25, k / (k + exp(e / k)) is 25 / 26, and after 50 epochs 25 / (25 + exp(2))."""
    method = SlampTraining(num_past=2, architecture=ARCHITECTURE, sampling_constant=25.0)
    network = SlampNetwork(ARCHITECTURE)
    network.forward = Mock(side_effect=network.forward)
    method.losses(network, torch.rand(2, 3, 3, 8, 8), epoch * 1000)
    assert network.forward.call_args.args[-1] == pytest.approx(probability)
