"""Weights files: what comes back, and one sentence for everything that can be wrong with them."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save, save_file
from torch import nn

from geovp_classic.errors import BadData
from geovp_learned import checkpoints


@dataclass(frozen=True)
class Shape:
    sizes: tuple[int, int] = (3, 2)


@dataclass(frozen=True)
class Settings:
    shape: Shape = field(default_factory=Shape)
    rate: float = 0.5


def network() -> nn.Module:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(3, 2), nn.BatchNorm1d(2))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "weights.safetensors"
    checkpoints.write(path, "toy", Settings(rate=0.25), {"net": network()}, {"step": 7})
    return path


def test_it_comes_back_in_half_precision(file: Path) -> None:
    settings, tensors = checkpoints.read(file, "toy", Settings)
    assert settings == Settings(rate=0.25)
    assert checkpoints.read_tensors(file)[0]["history"] == {"step": 7}
    assert tensors["net.0.weight"].dtype == torch.float16
    assert tensors["net.1.num_batches_tracked"].dtype == torch.int64
    other = nn.Sequential(nn.Linear(3, 2), nn.BatchNorm1d(2))
    checkpoints.restore(file, other, tensors, "net.")
    assert other[0].weight.dtype == torch.float32
    np.testing.assert_allclose(other[0].weight.detach(), network()[0].weight.detach(), rtol=1e-3)


def test_what_half_precision_cannot_hold_is_kept_whole(tmp_path: Path) -> None:
    net = network()
    with torch.no_grad():
        net[1].running_var.fill_(1e6)  # the largest half is 65504
    checkpoints.write(tmp_path / "w", "toy", Settings(), {"net": net}, {})
    _, tensors = checkpoints.read(tmp_path / "w", "toy", Settings)
    assert tensors["net.1.running_var"].tolist() == [1e6, 1e6]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "cannot be read .No such file"),
        (slice(-1), "is not a whole safetensors file"),
        (
            b"\x80\x04\x95" + bytes(range(200)),
            "is not a whole safetensors file",
        ),  # as a pickle begins
        (save({"a": torch.ones(1)}), "holds no format, no method"),
        (slice(None), "holds geovp-weights-1, toy, expected geovp-weights-1, deepvo"),
    ],
)
def test_files_that_are_not_the_methods_weights_are_refused(
    file: Path, content: bytes | slice | None, says: str
) -> None:
    file.unlink() if content is None else file.write_bytes(
        file.read_bytes()[content] if isinstance(content, slice) else content
    )
    with pytest.raises(BadData, match=says):
        checkpoints.read(file, "deepvo", Settings)


@pytest.mark.parametrize(
    ("settings", "says"),
    [({"rate": "fast"}, "settings.rate is 'fast', expected a number"), ([1], "do not suit toy")],
)
def test_settings_are_checked(tmp_path: Path, settings: object, says: str) -> None:
    metadata = {"format": checkpoints.FORMAT, "method": "toy", "settings": settings}
    texts = {key: json.dumps(value) for key, value in metadata.items()}
    save_file({"a": torch.ones(1)}, tmp_path / "w", texts)
    with pytest.raises(BadData, match=says):
        checkpoints.read(tmp_path / "w", "toy", Settings)


def test_tensors_must_be_the_networks_own(file: Path) -> None:
    _, tensors = checkpoints.read(file, "toy", Settings)
    with pytest.raises(
        BadData, match=r"0\.bias.*\[2\]\) from checkpoint, the shape in current model is .*\[4\]"
    ):
        checkpoints.restore(
            file, nn.Sequential(nn.Linear(3, 4), nn.BatchNorm1d(2)), tensors, "net."
        )
    with pytest.raises(
        BadData, match=r'Missing key.*"2\.bias".*: the settings in it do not describe'
    ):
        checkpoints.restore(file, nn.Sequential(*network(), nn.Linear(2, 2)), tensors, "net.")


def test_numbers_must_be_finite(tmp_path: Path) -> None:
    net = network()
    with torch.no_grad():
        net[0].bias[0] = float("nan")
    checkpoints.write(tmp_path / "w", "toy", Settings(), {"net": net}, {})
    with pytest.raises(BadData, match=r"net\.0\.bias has a number that is not finite"):
        checkpoints.restore(
            tmp_path / "w", net, checkpoints.read(tmp_path / "w", "toy", Settings)[1], "net."
        )
