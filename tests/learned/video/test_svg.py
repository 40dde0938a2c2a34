"""SVG's networks: what feeds what, and where skips come from."""

import pytest
import torch

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.svg import Architecture, SvgNetwork

ARCHITECTURE = Architecture(AutoencoderConfig("dcgan", 8, 4, 8), 8, latent_size=2)


def network() -> SvgNetwork:
    torch.manual_seed(0)
    return SvgNetwork(ARCHITECTURE).eval()


@pytest.mark.parametrize(("last_frame_skip", "steps"), [(False, [0, 0, 0]), (True, [0, 1, 2])])
def test_skips_come_from_the_last_but_one_observed_frame(
    last_frame_skip: bool, steps: list[int]
) -> None:
    """Of two observed frames that is the first; with `last_frame_skip` it is the current frame."""
    images = torch.rand(1, 4, 3, 8, 8)
    own = network()
    own.last_frame_skip = last_frame_skip
    seen: list[torch.Tensor] = []
    own.decoder.register_forward_hook(lambda module, given, out: seen.append(given[1][0]))
    with torch.no_grad():
        own(images, 2)
        skips = own.encoder(images.flatten(0, 1))[1][0]
    torch.testing.assert_close(torch.cat(seen), skips[steps])
