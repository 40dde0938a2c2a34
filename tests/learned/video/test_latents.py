"""Recurrent networks that go on where they stopped, and Gaussians worked out by hand."""

import math

import torch
from torch import nn
from torch.distributions import Normal

from geovp_learned.video.latents import GaussianLstm, LstmPredictor, Memory, drawn, summed_nats


def test_outputs_are_means_and_log_variances() -> None:
    network = GaussianLstm(3, 1, 2, 1)
    for parameter in network.parameters():
        nn.init.zeros_(parameter)
    nn.init.constant_(network.mu_net.bias, 5.0)
    nn.init.constant_(network.logvar_net.bias, math.log(0.25))
    distribution = Memory()(network, torch.rand(1, 3))
    torch.testing.assert_close(distribution.mean, torch.tensor([[5.0]]))
    torch.testing.assert_close(distribution.stddev, torch.tensor([[0.5]]))
    torch.testing.assert_close(drawn(distribution, torch.tensor([[2.0]])), torch.tensor([[6.0]]))


def test_a_memory_holds_the_states_of_each_network() -> None:
    """Two networks that are stepped in turn do what torch's own LSTM does with all steps at once."""
    torch.manual_seed(0)
    network, other = (LstmPredictor(3, 4, 5, 2) for _ in range(2))
    whole = nn.LSTM(5, 5, 2, batch_first=True)
    for layer, cell in enumerate(network.lstm):
        for name, parameter in cell.named_parameters():
            getattr(whole, f"{name}_l{layer}").data = parameter.data
    numbers, memory, outputs = torch.randn(2, 6, 3), Memory(), []
    for step in range(6):
        outputs.append(memory(network, numbers[:, step]))
        memory(other, numbers[:, step])
    expected = network.output(whole(network.embed(numbers))[0])
    torch.testing.assert_close(torch.stack(outputs, dim=1), expected)


def test_an_lstm_on_a_grid_of_one_pixel_is_an_lstm() -> None:
    """The middles of its kernels are the matrices of an LSTM, whose gates have another order."""
    torch.manual_seed(0)
    grid, plain = LstmPredictor(3, 4, 5, 1, is_grid=True), nn.LSTMCell(5, 5)
    middle = grid.lstm[0].conv.weight[:, :, 1, 1]
    i, f, o, g = middle.chunk(4)
    matrix = torch.cat([i, f, g, o])
    bi, bf, bo, bg = grid.lstm[0].conv.bias.chunk(4)
    with torch.no_grad():
        plain.weight_ih.copy_(matrix[:, :5])
        plain.weight_hh.copy_(matrix[:, 5:])
        plain.bias_ih.copy_(torch.cat([bi, bf, bg, bo]))
        plain.bias_hh.zero_()
    memory, state = Memory(), None
    for numbers in torch.randn(4, 2, 3):
        made = memory(grid, numbers[:, :, None, None])
        state = plain(grid.embed(numbers[:, :, None, None])[:, :, 0, 0], state)
    expected = grid.output(state[0][:, :, None, None])
    torch.testing.assert_close(made, expected)


def test_the_divergence_is_of_the_posterior_from_the_prior() -> None:
    """KL(N(1, 1) || N(0, 2)) = log 2 + (1 + 1) / 8 - 1/2, for two numbers and three steps."""
    posterior, prior = Normal(torch.ones(4, 2), 1.0), Normal(torch.zeros(4, 2), 2.0)
    expected = 2 * 3 * (math.log(2) + 0.25 - 0.5)
    torch.testing.assert_close(
        summed_nats([(posterior, prior)] * 3), torch.tensor(expected), atol=1e-6, rtol=0
    )
