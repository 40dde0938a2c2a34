"""SRVP's states: how they move, and that images are shown from them alone."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.srvp import Architecture, SrvpNetwork, SrvpTraining

ARCHITECTURE = Architecture(
    AutoencoderConfig("dcgan", 8, 4, 8), 8, 2, state_size=3, latent_size=2, content_size=4
)


class Decay(nn.Module):
    """A residual of minus the state, whose exact flow is exponential decay."""

    def forward(self, state_and_latent: Tensor) -> Tensor:
        return -state_and_latent[:, :3]


def network(architecture: Architecture = ARCHITECTURE) -> SrvpNetwork:
    torch.manual_seed(0)
    return SrvpNetwork(architecture).eval()


def still(own: SrvpNetwork) -> SrvpNetwork:
    """The same with a residual of zero."""
    for parameter in own.residual.parameters():
        nn.init.zeros_(parameter)
    return own


def test_without_residuals_the_frame_repeats() -> None:
    own = still(network())
    observed = torch.rand(1, 4, 3, 8, 8).expand(2, -1, -1, -1, -1)
    noise = torch.randn(2, 5, own.noise_size)
    with torch.no_grad():
        made = own.predict(observed, noise)
    torch.testing.assert_close(made, made[:1, :1].expand_as(made), atol=1e-6, rtol=0)
    with torch.no_grad():
        moving = network().predict(observed, noise)
    assert (
        float((moving[0, 0] - moving[1, -1]).abs().max()) > 1e-3
    )  # with residuals, steps and samples differ


@pytest.mark.parametrize(("steps_per_frame", "left"), [(1, 0.0), (2, 0.25), (4, 0.31640625)])
def test_eulers_steps_share_a_frame(steps_per_frame: int, left: float) -> None:
    # dy/dt = -y over one frame by n steps leaves (1 - 1/n)^n: 0, 1/4, (3/4)^4, on the way to 1/e.
    own = network(replace(ARCHITECTURE, steps_per_frame=steps_per_frame))
    own.residual = Decay()
    moved, added = own.next_state(torch.ones(1, 3), torch.zeros(1, 2))
    torch.testing.assert_close(moved, torch.full((1, 3), left))
    assert added.shape == (1, steps_per_frame, 3)
    torch.testing.assert_close(1 + added.sum(1), moved)


def test_content_does_not_depend_on_the_order_of_frames() -> None:
    codes = torch.rand(1, 4, 8)
    content = network()._content(codes)
    torch.testing.assert_close(content, network()._content(codes[:, [3, 1, 0, 2]]))
    torch.testing.assert_close(
        content, network()._content(codes.repeat(1, 2, 1))
    )  # nor on their number


def test_no_predicted_frame_is_fed_back() -> None:
    """Another decoder shows other images, of the same states: the states know nothing of the
    images.
    """
    own = network()
    noise, observed = torch.randn(1, 3, own.noise_size), torch.rand(1, 3, 3, 8, 8)
    seen: list[Tensor] = []
    own.decoder.register_forward_hook(lambda module, given, out: seen.append(given[0][:, :3]))
    with torch.no_grad():
        first = own.predict(observed, noise)
        nn.init.normal_(own.decoder.last.weight)
        second = own.predict(observed, noise)
    assert float((first - second).abs().max()) > 1e-2
    for one, other in zip(seen[:3], seen[3:], strict=True):
        torch.testing.assert_close(one, other)


def test_the_bound_is_in_nats_per_value() -> None:
    images = torch.rand(2, 4, 3, 8, 8)
    method = SrvpTraining(
        num_past=2, architecture=ARCHITECTURE, observation_std=0.5, beta=2.0, residual_weight=0.1
    )
    parts = method.losses(network(), images)
    wanted = parts["error"] + parts["first_nats"] + 2 * parts["nats"] + 0.1 * parts["residual"]
    torch.testing.assert_close(parts["total"], wanted)
    torch.manual_seed(0)
    same = replace(method, observation_std=1.0).losses(network(), images)["error"]
    torch.testing.assert_close(parts["error"], 4 * same)  # half the deviation, four times the nats
    torch.manual_seed(0)
    learned = network()(images, 2)
    torch.testing.assert_close(same, 0.5 * ((learned.images - images) ** 2).mean())
