"""SRVP's states: how they move, and that images are shown from them alone."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from geovp_learned.video.autoencoder import AutoencoderConfig
from geovp_learned.video.srvp import Architecture, SrvpNetwork, SrvpTraining

ARCHITECTURE = Architecture(
    AutoencoderConfig("dcgan", 8, 4, 8),
    inference_size=4,
    residual_size=8,
    state_size=3,
    latent_size=2,
    first_frames=2,
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
    for parameter in own.dynamics.parameters():
        nn.init.zeros_(parameter)
    return own


def test_without_residuals_the_frame_repeats() -> None:
    own = still(network())
    observed = torch.rand(1, 4, 3, 8, 8).expand(2, -1, -1, -1, -1)
    noise = torch.randn(2, 4 + 5, own.noise_size)
    noise[:, 0] = 0  # the same first state
    with torch.no_grad():
        made = own.predict(observed, noise)
    torch.testing.assert_close(made, made[:1, :1].expand_as(made), atol=1e-6, rtol=0)
    with torch.no_grad():
        moving = network().predict(observed, noise)
    assert (
        float((moving[0, 0] - moving[1, -1]).abs().max()) > 1e-4
    )  # with residuals, steps and samples differ


@pytest.mark.parametrize(("steps_per_frame", "left"), [(1, 0.0), (2, 0.25), (4, 0.31640625)])
def test_eulers_steps_share_a_frame(steps_per_frame: int, left: float) -> None:
    # dy/dt = -y over one frame by n steps leaves (1 - 1/n)^n: 0, 1/4, (3/4)^4, on the way to 1/e.
    own = network(replace(ARCHITECTURE, steps_per_frame=steps_per_frame))
    own.dynamics = Decay()
    moved, added = own.next_state(torch.ones(1, 3), torch.zeros(1, 2))
    torch.testing.assert_close(moved, torch.full((1, 3), left))
    assert added.shape == (1, steps_per_frame, 3)
    torch.testing.assert_close(1 + added.sum(1), moved)


def test_content_does_not_depend_on_the_order_of_frames() -> None:
    codes = torch.rand(1, 4, 8)
    content = network().content(codes)
    torch.testing.assert_close(content, network().content(codes[:, [3, 1, 0, 2]]))


def test_no_predicted_frame_is_fed_back() -> None:
    """Another decoder shows other images, of the same states: the states know nothing of the
    images.
    """
    own = network()
    noise, observed = torch.randn(1, 3 + 3, own.noise_size), torch.rand(1, 3, 3, 8, 8)
    seen: list[Tensor] = []
    own.decoder.register_forward_hook(lambda module, given, out: seen.append(given[0][:, -3:]))
    with torch.no_grad():
        first = own.predict(observed, noise)
        nn.init.normal_(own.decoder.upc2[0].weight)
        second = own.predict(observed, noise)
    assert float((first - second).abs().max()) > 1e-2
    for one, other in zip(seen[:3], seen[3:], strict=True):
        torch.testing.assert_close(one, other)


def test_the_bound_is_the_weighted_sum_of_its_parts() -> None:
    images = torch.rand(2, 4, 3, 8, 8)
    method = SrvpTraining(
        num_past=2, architecture=ARCHITECTURE, observation_std=0.5, beta=2.0, residual_weight=0.1
    )
    parts = method.losses(network(), images)
    wanted = parts["error"] + parts["first_nats"] + 2 * parts["nats"] + 0.1 * parts["residual"]
    torch.testing.assert_close(parts["total"], wanted)


def test_in_training_skips_come_from_one_frame_and_content_from_some(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torch, "randint", lambda _, size: torch.tensor([1, 3]))
    monkeypatch.setattr(torch, "randperm", lambda count: torch.tensor([2, 0, 3, 1]))
    own, images = network(), torch.rand(2, 4, 3, 8, 8)
    given: list[tuple[Tensor, ...]] = []
    own.decoder.register_forward_hook(lambda module, args, out: given.append((args[0], *args[1])))
    with torch.no_grad():
        own(images, 2)
        codes, skips = own._encode(images)
        content = own.content(codes[:, [2, 0]])
    expected = torch.stack([skips[0][0, 1], skips[0][1, 3]]).repeat_interleave(4, dim=0)
    torch.testing.assert_close(given[0][1], expected)
    torch.testing.assert_close(given[0][0][:, :4], content.repeat_interleave(4, dim=0))
