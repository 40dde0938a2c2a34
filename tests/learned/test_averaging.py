"""The running mean of weights, by hand."""

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: averaging needs the extra 'learned'")
from torch import nn  # noqa: E402

from learned.averaging import RunningMean  # noqa: E402


def line(weight: float) -> nn.Linear:
    network = nn.Linear(1, 1, bias=False)
    nn.init.constant_(network.weight, weight)
    return network


def test_first_the_plain_mean_then_one_that_forgets() -> None:
    network = line(100.0)
    mean = RunningMean({"line": network}, num_steps=2)
    seen = []
    for step, weight in enumerate([1.0, 3.0, 6.0], 1):
        nn.init.constant_(network.weight, weight)
        mean.update(step)
        seen.append(mean.stored["line-mean"].weight.item())
    assert seen == [1.0, 2.0, 4.0]  # 1; (1 + 3) / 2; half of 2 and half of 6


def test_networks_are_their_means_for_a_while() -> None:
    network = line(1.0)
    mean = RunningMean({"line": network}, num_steps=4)
    nn.init.constant_(network.weight, 5.0)
    with mean.in_place():
        assert network.weight.item() == 1.0
    assert network.weight.item() == 5.0
    assert mean.stored["line-mean"].weight.item() == 1.0


def test_whole_numbers_are_taken_over() -> None:
    network = nn.BatchNorm1d(1)
    mean = RunningMean({"norm": network}, num_steps=4)
    network(torch.ones(2, 1))
    mean.update(3)
    stored = mean.stored["norm-mean"].state_dict()
    assert stored["num_batches_tracked"].item() == 1
    assert stored["running_mean"].item() == pytest.approx(0.1 / 3)  # momentum 0.1 from 0 to 1, a third of it taken


def test_without_steps_nothing_is_kept() -> None:
    network = line(1.0)
    mean = RunningMean({"line": network}, num_steps=0)
    mean.update(1)
    with mean.in_place():
        assert network.weight.item() == 1.0
    assert mean.stored == {}
