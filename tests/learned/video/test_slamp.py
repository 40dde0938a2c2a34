"""SLAMP's two branches: what the motion branch sees, and where skips come from."""

import pytest
import torch
from torch import Tensor

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.slamp import Architecture, SlampNetwork, SlampTraining

ARCHITECTURE = Architecture(AutoencoderConfig("dcgan", 8, 4, 8), 8, latent_size=2, mask_width=4)


def network() -> SlampNetwork:
    torch.manual_seed(0)
    return SlampNetwork(ARCHITECTURE).eval()


@pytest.mark.parametrize(("epoch", "probability"), [(0, 25 / 26), (50, 25 / (25 + 7.389056))])
def test_scheduled_sampling_fades_the_real_frame_out(
    epoch: int, probability: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With k = 25, k / (k + exp(e / k)) is 25 / 26, and after 50 epochs 25 / (25 + exp(2))."""
    method = SlampTraining(num_past=2, architecture=ARCHITECTURE, sampling_constant=25.0)
    asked: list[float] = []
    forward = SlampNetwork.forward

    def noted(own: SlampNetwork, images: Tensor, num_past: int, real: float) -> object:
        asked.append(real)
        return forward(own, images, num_past, real)

    monkeypatch.setattr(SlampNetwork, "forward", noted)
    method.losses(network(), torch.rand(1, 3, 3, 8, 8), epoch * 1000)
    assert asked == [pytest.approx(probability)]
