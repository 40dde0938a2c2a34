"""SVG's networks: what feeds what, and where skips come from."""

from dataclasses import replace

import pytest
import torch

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.svg import Architecture, Output, SvgNetwork, SvgTraining

ARCHITECTURE = Architecture(AutoencoderConfig("dcgan", 8, 4, 8), 8, latent_size=2)


def network() -> SvgNetwork:
    torch.manual_seed(0)
    return SvgNetwork(ARCHITECTURE).eval()


def learned(images: torch.Tensor, num_past: int = 2) -> Output:
    torch.manual_seed(1)
    with torch.no_grad():
        own: Output = network()(images, num_past)
    return own


def test_the_prior_lags_one_frame_behind_the_posterior() -> None:
    images = torch.rand(1, 4, 3, 8, 8)
    changed = images.clone()
    changed[:, 3] = 1 - changed[:, 3]
    before, after = learned(images), learned(changed)
    for step in range(3):
        (posterior, prior), (other_posterior, other_prior) = (
            output.latents[step] for output in (before, after)
        )
        # predicts the last frame without having seen it
        torch.testing.assert_close(prior.mean, other_prior.mean)
        assert bool((posterior.mean == other_posterior.mean).all()) == (step < 2)


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


def test_each_frame_is_predicted_from_the_one_predicted_before_it() -> None:
    own = network()
    fed: list[torch.Tensor] = []
    own.encoder.register_forward_hook(lambda module, given, out: fed.append(given[0]))
    with torch.no_grad():
        made = own.predict(torch.rand(1, 3, 3, 8, 8), torch.randn(1, 3 + 4, 2))
    torch.testing.assert_close(torch.stack(fed[-3:], dim=1), made[:, :-1])


def test_the_loss_is_error_and_weighted_nats() -> None:
    images = torch.rand(2, 4, 3, 8, 8)
    method = SvgTraining(num_past=2, architecture=ARCHITECTURE, beta=0.25)
    torch.manual_seed(1)
    parts = method.losses(network(), images)
    own = learned(images)
    torch.testing.assert_close(parts["error"], 3 * ((own.images - images[:, 1:]) ** 2).mean())
    torch.testing.assert_close(parts["total"], parts["error"] + 0.25 * parts["nats"])
    free = replace(method, beta=0.0).losses(network(), images)
    torch.testing.assert_close(free["total"], free["error"])
