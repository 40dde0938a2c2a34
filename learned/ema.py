"""Exponential moving average (EMA) of a network's weights (Polyak and Juditsky 1992), by torch's AveragedModel."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel


def averaged_model(network: nn.Module, num_steps: int) -> AveragedModel:
    """EMA of weights and buffers with decay 1 - 1 / num_steps; of the first `num_steps` steps, the plain mean."""

    def average(means: Sequence[Tensor], values: Sequence[Tensor], count: Tensor | int) -> None:
        for mean, value in zip(means, values, strict=True):
            if mean.is_floating_point():
                mean.lerp_(value, 1 / min(int(count) + 1, num_steps))
            else:
                mean.copy_(value)

    return AveragedModel(network, multi_avg_fn=average, use_buffers=True)
