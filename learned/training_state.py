"""Where a training run stands, on disk: networks, optimisers and counters, so that a killed run goes on exactly.

Random numbers need no place here: the loop seeds them anew at every step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from geovp_classic.errors import BadData
from learned import checkpoints

FORMAT = "geovp-training-1"


@dataclass
class Progress:
    """What the loop counts."""

    step: int = 0  # steps done
    seconds: float = 0.0  # spent training, over all starts
    best_score: float = float("inf")
    best_step: int = 0
    misses: int = 0  # validations since the best one
    loss_scale: dict[str, Any] = field(default_factory=dict)  # of half precision, which finds it as it goes


def write(
    file: Path,
    networks: Mapping[str, nn.Module],
    optimisers: Mapping[str, Optimizer],
    progress: Progress,
    identity: Mapping[str, Any],
) -> None:
    """Everything that the next step depends on; `identity` says whose run it is."""
    tensors = {
        f"network.{name}.{key}": value for name, net in networks.items() for key, value in net.state_dict().items()
    }
    tables = {}
    for name, optimiser in optimisers.items():
        moments, tables[name] = flattened(optimiser)
        tensors |= {f"optimiser.{name}.{key}": value for key, value in moments.items()}
    counters = {key: value for key, value in asdict(progress).items() if key != "best_score"}
    counters["best_score"] = None if progress.best_score == float("inf") else progress.best_score
    checkpoints.write_tensors(
        file, tensors, {"format": FORMAT, "progress": counters, "optimisers": tables, "identity": dict(identity)}
    )


def read(
    file: Path, networks: Mapping[str, nn.Module], optimisers: Mapping[str, Optimizer], identity: Mapping[str, Any]
) -> Progress:
    """Put a stored state into networks and optimisers; BadData when it is damaged or another run's."""
    metadata, tensors = checkpoints.read_tensors(file)
    if metadata.get("format") != FORMAT:
        raise BadData(f"{file} is no training state ({metadata.get('format')}, expected {FORMAT}): remove it")
    stored = metadata["identity"]
    if stored != identity:
        keys = sorted(key for key in {*stored, *identity} if stored.get(key) != identity.get(key))
        raise BadData(f"{file} belongs to a run with another {', '.join(keys)}: give another --out, or remove it")
    try:
        for name, network in networks.items():
            network.load_state_dict(_under(tensors, f"network.{name}."))
        for name, optimiser in optimisers.items():
            restore(optimiser, _under(tensors, f"optimiser.{name}."), metadata["optimisers"][name])
    except (KeyError, RuntimeError, ValueError) as error:
        raise BadData(f"{file} does not fit this method ({' '.join(str(error).split())}): remove it") from error
    counters = metadata["progress"]
    return Progress(
        **{**counters, "best_score": float("inf") if counters["best_score"] is None else counters["best_score"]}
    )


def flattened(optimiser: Optimizer) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """An optimiser's tensors by name, and the rest of its state as JSON has it."""
    state = optimiser.state_dict()
    tensors, numbers = {}, {}
    for index, entries in state["state"].items():
        for key, value in entries.items():
            if isinstance(value, Tensor):
                tensors[f"{index}.{key}"] = value
            else:
                numbers[f"{index}.{key}"] = value
    return tensors, {"numbers": numbers, "groups": state["param_groups"]}


def restore(optimiser: Optimizer, tensors: Mapping[str, Tensor], table: Mapping[str, Any]) -> None:
    """The inverse of `flattened`."""
    state: dict[int, dict[str, Any]] = {}
    for name, value in {**tensors, **table["numbers"]}.items():
        index, _, key = name.partition(".")
        state.setdefault(int(index), {})[key] = value
    groups = [
        {key: tuple(v) if isinstance(v, list) and key == "betas" else v for key, v in group.items()}
        for group in table["groups"]
    ]
    optimiser.load_state_dict({"state": state, "param_groups": groups})


def _under(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def seed_everything(*numbers: int) -> None:
    """Seed torch's random numbers on every device from several numbers."""
    mixed = 0
    for number in numbers:
        mixed = (mixed * 1_000_003 + number + 1) % (2**63 - 1)
    torch.manual_seed(mixed)
