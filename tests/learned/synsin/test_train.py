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


def test_at_first_only_depth_learns(
    trained: Callable[..., Any], method: SynSinTraining, clip: Clip
) -> None:
    examples = method.examples([method.prepare(clip)], training=True)[:2]
    networks, history = trained(replace(method, depth_first_steps=3), examples, num_steps=3)
    torch.manual_seed(0)
    fresh = method.build()["generator"].state_dict()
    changed = {
        name
        for name, value in networks["generator"].state_dict().items()
        if not torch.equal(value, fresh[name])
    }
    assert changed
    assert all(name.startswith("depth_network.") for name in changed)
    assert set(history[0]) == {
        f"generator.{name}" for name in ("depth", "reprojection", "roughness", "total")
    }


def test_an_adversary_takes_turns_with_the_generator(
    trained: Callable[..., Any], method: SynSinTraining, clip: Clip
) -> None:
    weights = replace(method.weights, adversarial=0.1)
    adversarial = replace(method, weights=weights, discriminator_width=8)
    examples = adversarial.examples([adversarial.prepare(clip)], training=True)[:2]
    networks, history = trained(adversarial, examples, num_steps=30)
    assert set(networks) == {"generator", "discriminator"}
    wanted = history[0]["generator.colour"] + 0.1 * (
        history[0]["generator.adversarial"] + 10 * history[0]["generator.feature_matching"]
    )
    wanted += history[0]["generator.depth"] + history[0]["generator.reprojection"]
    wanted += 0.01 * history[0]["generator.roughness"]
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


def test_the_thesis_config_has_the_papers_losses_alone() -> None:
    tables = training_config.tables(Path("synsin-residual-thesis"))
    method = registry.construct(SynSinTraining, tables["method"], "method")
    assert method.weights == Weights()
    assert method.depth_gradient_scale == 1
    networks = method.build()
    assert "discriminator" in networks
    count = sum(parameter.numel() for parameter in networks["generator"].parameters())
    assert count * 2 < 20e6  # bytes in half precision
