from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch

from geovp_classic.types import Clip
from geovp_learned.synsin.train import SynSinTraining


def test_an_adversary_takes_turns_with_the_generator(
    trained: Callable[..., Any], method: SynSinTraining, clip: Clip
) -> None:
    weights = replace(method.weights, adversarial=0.1)
    adversarial = replace(method, weights=weights, betas=(0.0, 0.9))
    examples = adversarial.examples([adversarial.prepare(clip)], training=True)[:2]
    networks, history = trained(adversarial, examples, num_steps=30)
    assert set(networks) == {"generator", "discriminator"}
    wanted = history[0]["generator.colour"] + 0.1 * history[0]["generator.adversarial"]
    wanted += 10 * history[0]["generator.feature_matching"]
    torch.testing.assert_close(history[0]["generator.total"], wanted)
    scores = [float(each["discriminator.total"]) for each in history]
    assert sum(scores[-10:]) / 10 < 0.95 * scores[0]  # single steps go up and down
