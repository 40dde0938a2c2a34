"""SVG's networks: what feeds what, and where skips come from."""

from dataclasses import replace

import torch
from torch.distributions import kl_divergence

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
    torch.testing.assert_close(
        before.prior.mean, after.prior.mean
    )  # predicts the last frame without having seen it
    same = before.posterior.mean == after.posterior.mean
    assert bool(same[:, :2].all())
    assert not bool(same[:, 2].any())


def test_skips_come_from_an_observed_frame() -> None:
    """The network predicts frame 3 from frame 2, yet its skips are frame 1's when only two frames
    count as observed.
    """
    images = torch.rand(1, 4, 3, 8, 8)
    own = network()
    seen: list[torch.Tensor] = []
    own.decoder.register_forward_hook(lambda module, given, out: seen.append(given[1][0]))
    with torch.no_grad():
        own(images, 2)
        skips = own.encoder(images.flatten(0, 1))[1][0]
    torch.testing.assert_close(seen[0], skips[[0, 1, 1]])


def test_each_frame_is_predicted_from_the_one_predicted_before_it() -> None:
    own = network()
    fed: list[torch.Tensor] = []
    own.encoder.register_forward_hook(lambda module, given, out: fed.append(given[0]))
    with torch.no_grad():
        made = own.predict(torch.rand(1, 3, 3, 8, 8), torch.randn(1, 4, 2))
    torch.testing.assert_close(torch.stack(fed[1:], dim=1), made[:, :-1])


def test_the_loss_is_error_and_weighted_nats() -> None:
    images = torch.rand(2, 4, 3, 8, 8)
    method = SvgTraining(num_past=2, architecture=ARCHITECTURE, beta=0.25)
    torch.manual_seed(1)
    parts = method.losses(network(), images)
    own = learned(images)
    torch.testing.assert_close(parts["error"], ((own.images - images[:, 1:]) ** 2).mean())
    torch.testing.assert_close(
        parts["nats"], kl_divergence(own.posterior, own.prior).sum(-1).mean()
    )
    torch.testing.assert_close(parts["total"], parts["error"] + 0.25 * parts["nats"])
    free = replace(method, beta=0.0).losses(network(), images)
    torch.testing.assert_close(free["total"], free["error"])
