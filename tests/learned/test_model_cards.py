"""Model cards: what they say of a weights file, and how a long log becomes a short table."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from torch import nn

from geovp_classic import registry
from geovp_learned import checkpoints, methods, model_cards, training_config
from geovp_learned.__main__ import main
from geovp_learned.training_config import Training

HISTORY = {
    "train": [
        {"name": "kitti", "split": "train", "split_hash": "abc123"},
        {"name": "synthetic", "seed": 7},
    ],
    "validation": [{"name": "kitti", "split": "val", "split_hash": "def456"}],
    "training": {
        "num_steps": 40,
        "batch_size": 4,
        "seed": 3,
        "warmup_steps": 5,
        "precision": "32-true",
    },
    "step": 30,
    "seconds": 12.5,
    "scores": {"score": 1.23456},
}


@dataclass(frozen=True)
class Settings:
    rate: float = 0.5


def written(folder: Path, history: object) -> Path:
    file = folder / "weights.safetensors"
    checkpoints.write(file, "toy", Settings(), {"net": nn.Linear(3, 2)}, history)
    return file


@pytest.mark.parametrize(
    "name", ["deepvo-small", "synsin-small", "svg-tiny", "srvp-tiny", "slamp-tiny"]
)
def test_shipped_weights_were_trained_with_the_shipped_config_and_have_their_card(
    name: str,
) -> None:
    folder = Path(model_cards.__file__).parent / "weights"
    weights, method = folder / f"{name}.safetensors", name.partition("-")[0]
    command = f"Trained by\n\n    python -m geovp_learned train {method} {name}\n\n"
    before, _, after = (folder / f"{name}.md").read_text().partition(command)
    card = model_cards.model_card(weights).partition("## Licence")[0].replace(command, "")
    assert after
    assert (before + after).startswith(card)
    settings, _ = checkpoints.read(weights, method, methods.load(method))
    tables = training_config.tables(Path(name))
    assert settings == registry.construct(type(settings), tables["method"], "method")
    training = Training(**tables["training"])
    stored = checkpoints.read_tensors(weights)[0]["history"]["training"]
    assert training.decisive == {"decay": "cosine", "decay_steps": 0, **stored}


def test_the_command_prints_the_card_or_says_in_a_sentence_why_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, HISTORY)
    assert main(["card", str(file)]) == 0
    assert capsys.readouterr().out == model_cards.model_card(file)
    assert main(["card", str(tmp_path / "none.safetensors")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
