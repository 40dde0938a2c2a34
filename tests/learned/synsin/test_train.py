from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch.utils.data import default_collate

from geovp_classic import registry
from geovp_classic.types import Clip
from geovp_learned import training_config
from geovp_learned.synsin.train import SynSinTraining, Weights


def test_an_adversary_takes_turns_with_the_generator(
    trained: Callable[..., Any], method: SynSinTraining, clip: Clip
) -> None:
    weights = replace(method.weights, adversarial=0.1)
    adversarial = replace(method, weights=weights)
    examples = adversarial.examples([adversarial.prepare(clip)], training=True)[:2]
    networks, history = trained(adversarial, examples, num_steps=30)
    assert set(networks) == {"generator", "discriminator"}
    wanted = history[0]["generator.colour"] + 0.1 * history[0]["generator.adversarial"]
    wanted += 10 * history[0]["generator.feature_matching"]
    torch.testing.assert_close(history[0]["generator.total"], wanted)
    scores = [float(each["discriminator.total"]) for each in history]
    assert sum(scores[-10:]) / 10 < 0.95 * scores[0]  # single steps go up and down


def test_validation_looks_at_some_examples(method: SynSinTraining, clip: Clip) -> None:
    sparse = replace(method, validation_stride=3)
    examples = sparse.examples([sparse.prepare(clip)], training=False)
    assert [one.first for one in examples] == [0, 3, 6]
    networks = {name: network.eval() for name, network in sparse.build().items()}
    batch = default_collate([sparse.validation_example(example) for example in examples])
    with torch.no_grad():
        numbers = sparse.validation_step(networks, batch)
    assert numbers["score"] == pytest.approx(numbers["colour"])  # content counts nothing here


def test_the_thesis_config_has_the_papers_losses_and_layers() -> None:
    """train.sh weights images in [-1, 1] and sums features over four layers."""
    tables = training_config.tables(Path("synsin-thesis"))
    method = registry.construct(SynSinTraining, tables["method"], "method")
    assert method.weights == Weights(2.0, 10.0, 1.0, 40.0)
    networks = method.build()
    assert "discriminator" in networks
    count = sum(parameter.numel() for parameter in networks["generator"].parameters())
    assert count == 431_064 + 9_795_137 + 3_578_066
