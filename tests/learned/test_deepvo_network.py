"""DeepVO's networks: shapes, what depends on what, and that they can learn at all."""

from dataclasses import replace

import numpy as np
import pytest
import street
import torch
from torch.utils.data import default_collate

from geovp_learned.deepvo.network import Architecture, PoseNetwork
from geovp_learned.deepvo.train import DeepVoTraining
from geovp_learned.deepvo.windows import NO_AUGMENTATION

TINY = Architecture(size_px=(64, 64), encoder_width=1 / 16, lstm_size=12, dropout=0.0)


def network(architecture: Architecture = TINY) -> PoseNetwork:
    torch.manual_seed(0)
    return PoseNetwork(architecture).eval()


def images(num_past: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(1, num_past, 3, 64, 64, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("num_past", [2, 3, 11])
@pytest.mark.parametrize("head", ["2d", "3d"])
def test_any_past_from_two_frames_and_any_future(num_past: int, head: str) -> None:
    numbers = {"2d": 3, "3d": 6}[head]
    past, future = network(replace(TINY, head=head))(images(num_past), 7)
    assert past.shape == (1, num_past - 1, numbers)
    assert future.shape == (1, 7, numbers)


def test_a_longer_future_begins_with_the_shorter_one() -> None:
    """The decoder is fed nothing, so how far it is asked to go changes nothing on the way."""
    net, seen = network(), images(5)
    torch.testing.assert_close(net(seen, 20)[1][:, :6], net(seen, 6)[1])


def test_what_came_before_changes_what_a_pair_says() -> None:
    net = network()
    last_pair, longer = images(6)[:, -2:], images(6)
    assert not torch.allclose(net(last_pair, 1)[0][:, -1], net(longer, 1)[0][:, -1])


def test_the_lstm_can_be_that_of_the_original() -> None:
    """4 gates x 1000 x (inputs + 1000 + 2 biases) in the first layer, 4 x 1000 x (1000 + 1000 + 2)
    in the second.
    """
    net = network(replace(TINY, lstm_size=1000, lstm_layers=2))
    features = net.encode(images(2)).shape[-1]
    assert (
        sum(weight.numel() for weight in net.past.parameters())
        == 4000 * (features + 1002) + 4000 * 2002
    )
    assert net(images(3), 2)[1].shape == (1, 2, 3)


def test_a_decoder_started_from_poses_sees_nothing_else() -> None:
    net = network(replace(TINY, decoder_start="poses"))
    past = torch.tensor([[[0.0, 1.0, 0.01], [0.0, 1.0, 0.02]]])
    state = (torch.rand(1, 1, 12), torch.rand(1, 1, 12))
    torch.testing.assert_close(
        net.future(state, past, 3), net.future((2 * state[0], state[1]), past, 3)
    )
    assert not torch.allclose(net.future(state, past, 3), net.future(state, 2 * past, 3))


def test_it_overfits_eight_windows() -> None:
    """From 8 windows of a street it learns to say where the camera was and will be, to centimetres
    a step.
    """
    architecture = replace(TINY, encoder_width=1 / 8)
    method = DeepVoTraining(
        architecture, NO_AUGMENTATION, num_past=4, num_future=4, shortest_past=4, rate=3e-3
    )
    examples = method.examples([street.clip()], training=True)[:8]
    rng = np.random.default_rng(0)
    batch = default_collate([method.example(each, rng) for each in examples])
    torch.manual_seed(0)
    networks = method.build()
    optimiser = method.optimisers(networks)["poses"]
    totals = []
    for step in range(150):
        losses = method.training_step(networks, batch, step)["poses"]
        optimiser.zero_grad()
        losses["total"].backward()
        optimiser.step()
        totals.append(losses["total"].item())
    assert totals[0] > 1.0
    assert totals[-1] < 0.01
