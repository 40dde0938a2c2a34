from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import nn

from geovp_classic.types import Clip
from geovp_learned import training_config
from geovp_learned.methods import Losses
from geovp_learned.synsin import pairs
from geovp_learned.synsin.pairs import Example
from geovp_learned.synsin.train import SynSinTraining, Weights


def trained(
    method: SynSinTraining, examples: Sequence[Example], num_steps: int
) -> tuple[dict[str, nn.Module], list[Losses]]:
    """The networks after some steps on all examples at once, as they are, and the losses of every
    step.
    """
    torch.manual_seed(0)
    networks = method.build()
    optimisers = method.optimisers(networks)
    batch = pairs.batch([pairs.frame_pairs(one, [2]) for one in examples])
    history = []
    for step in range(num_steps):
        losses: Losses = {}
        for turn, parts in method.training_step(networks, batch, step).items():
            optimisers[turn].zero_grad()
            parts["total"].backward()
            optimisers[turn].step()
            losses |= {f"{turn}.{name}": part.detach() for name, part in parts.items()}
        history.append(losses)
    return networks, history


def test_what_it_learnt_also_shows_horizons_that_it_was_not_shown(
    method: SynSinTraining, tiny_clip: Clip
) -> None:
    examples = method.examples([tiny_clip], training=True)
    networks, history = trained(method, examples, num_steps=190)
    first, last = history[0], history[-1]
    assert first["generator.colour"] > 0.05
    assert last["generator.colour"] < 0.025
    assert first["generator.depth"] > 0.5
    assert last["generator.depth"] < 0.12
    networks["generator"].eval()
    with torch.no_grad():
        assert (
            method.validate(networks, examples)["psnr"] > 27
        )  # of horizons 1 and 2, the first never seen in training


def test_at_first_only_depth_learns(method: SynSinTraining, clip: Clip) -> None:
    examples = method.examples([clip], training=True)[:2]
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
    adversarial: SynSinTraining, clip: Clip
) -> None:
    examples = adversarial.examples([clip], training=True)[:2]
    networks, history = trained(adversarial, examples, num_steps=30)
    assert set(networks) == {"generator", "discriminator"}
    assert adversarial.stored_networks == ("generator",)
    wanted = history[0]["generator.colour"] + 0.1 * (
        history[0]["generator.adversarial"] + 10 * history[0]["generator.feature_matching"]
    )
    wanted += history[0]["generator.depth"] + history[0]["generator.reprojection"]
    wanted += 0.01 * history[0]["generator.roughness"]
    torch.testing.assert_close(history[0]["generator.total"], wanted)
    scores = [float(each["discriminator.total"]) for each in history]
    assert sum(scores[-10:]) / 10 < 0.95 * scores[0]  # single steps go up and down


def test_validation_looks_at_some_examples_and_gives_the_same_again(
    method: SynSinTraining, clip: Clip
) -> None:
    sparse = replace(method, validation_stride=3)
    examples = sparse.examples([clip], training=False)
    assert [one.last for one in examples] == [0, 3, 6]
    networks = {name: network.eval() for name, network in sparse.build().items()}
    with torch.no_grad():
        first, second = (sparse.validate(networks, examples) for _ in range(2))
    assert first == second
    assert first["score"] == pytest.approx(first["colour"])  # content counts nothing here


@pytest.mark.parametrize(
    "name", ["synsin-tiny", "synsin-small", "synsin-thesis", "synsin-published-tiny"]
)
def test_configs_that_come_with_the_package_are_sound(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training_config, "_datasets", lambda *_: ())  # KITTI need not be here
    config = training_config.load("synsin", Path(name), tmp_path)
    sizes = {
        name: sum(p.numel() for p in net.parameters())
        for name, net in config.method.build().items()
    }
    assert sizes["generator"] * 2 < 20e6  # bytes in half precision
    if name == "synsin-thesis":
        assert config.method.weights == Weights()  # the paper's losses alone
        assert config.method.depth_gradient_scale == 1
        assert "discriminator" in sizes
