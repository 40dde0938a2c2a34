"""Model cards: what they say of a weights file, and how a long log becomes a short table."""

from pathlib import Path

import pytest

from geovp_classic import registry
from geovp_learned import checkpoints, methods, model_cards, training_config
from geovp_learned.training_config import Training


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
