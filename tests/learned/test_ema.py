"""The exponential moving average of weights, by hand."""

import pytest
import torch
from torch import nn

from geovp_learned.schedules import averaged_model


def test_first_the_plain_mean_then_one_that_forgets() -> None:
    network = nn.Linear(1, 1, bias=False)
    average = averaged_model(network, num_steps=2)
    means = []
    for weight in (1.0, 3.0, 6.0):
        nn.init.constant_(network.weight, weight)
        average.update_parameters(network)
        means.append(average.module.weight.item())
    assert means == [1.0, 2.0, 4.0]  # 1; (1 + 3) / 2; half of 2 and half of 6


def test_buffers_are_averaged_and_counters_copied() -> None:
    network = nn.BatchNorm1d(1)
    average = averaged_model(network, num_steps=4)
    average.update_parameters(network)
    network(torch.ones(2, 1))
    average.update_parameters(network)
    assert average.module.num_batches_tracked.item() == 1
    assert average.module.running_mean.item() == pytest.approx(
        0.1 / 2
    )  # momentum 0.1 from 0 to 1, half of it taken
