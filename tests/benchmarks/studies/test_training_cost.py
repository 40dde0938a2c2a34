"""The cost of a training step, of a network whose operations can be counted by hand."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra 'learned'")

from geovp_classic.types import Clip  # noqa: E402
from studies import training_cost  # noqa: E402


@dataclass(frozen=True)
class Linear:
    """A linear layer from 64 numbers to 32, whose mean square is minimised."""

    num_past: int = 2
    num_future: int = 3

    def build(self) -> dict[str, Any]:
        return {"line": torch.nn.Linear(64, 32, bias=False)}

    def optimisers(self, networks: Any) -> dict[str, Any]:
        return {"line": torch.optim.Adam(networks["line"].parameters())}

    def prepare(self, clip: Clip) -> dict[str, Any]:
        assert len(clip) == 5
        return {"frames": clip.frames}

    def examples(self, clips: Sequence[Any], *, training: bool) -> Sequence[Any]:
        return clips

    def example(self, item: Any, rng: np.random.Generator) -> dict[str, Any]:
        return {"numbers": torch.from_numpy(item["frames"].ravel()[:64].astype(np.float32))}

    def training_step(self, networks: Any, batch: Any, step: int) -> dict[str, Any]:
        return {"line": {"total": networks["line"](batch["numbers"]).relu().sum()}}


def test_operations_and_memory_of_a_linear_layer() -> None:
    """Forward and the gradient of the weights take 2 * 64 * 32 operations each for an example; its
    64 inputs and its 32 rectified outputs are kept, with four bytes each.
    """
    step = training_cost.measure(Linear(), 3)
    assert step.parameters == 64 * 32
    assert step.operations == 3 * 2 * (2 * 64 * 32)
    assert step.kept_bytes == 3 * 4 * (64 + 32)
    assert step.seconds > 0
