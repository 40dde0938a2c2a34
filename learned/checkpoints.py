"""Weights on disk: safetensors files that say in their metadata which method and which settings they belong to.

Nothing in such a file is ever run. Tensors are kept in half precision where their values allow it.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from geovp_classic import registry
from geovp_classic.errors import BadData, GeovpError

FORMAT = "geovp-weights-1"


@dataclass(frozen=True)
class Checkpoint:
    """What a weights file holds."""

    method: str
    settings: Any  # the method's dataclass
    history: Mapping[str, Any]  # how it was trained, as the loop wrote it
    tensors: Mapping[str, Tensor]  # "<network>.<parameter>"


def write(
    file: Path, method: str, settings: Any, networks: Mapping[str, nn.Module], history: Mapping[str, Any]
) -> None:
    """Write weights in half precision, beside and then renamed into place."""
    tensors = {
        f"{name}.{key}": _halved(tensor)
        for name, network in networks.items()
        for key, tensor in network.state_dict().items()
    }
    write_tensors(
        file, tensors, {"format": FORMAT, "method": method, "settings": plain(settings), "history": dict(history)}
    )


def read(file: Path, method: str, kind: type) -> Checkpoint:
    """The weights of a file written for `method`, its settings checked against the dataclass `kind`.

    BadData in one sentence when the file is missing, damaged, or not what it should be.
    """
    metadata, tensors = read_tensors(file)
    if metadata.get("format") != FORMAT or metadata.get("method") != method:
        held = f"{metadata.get('format', 'no format')}, {metadata.get('method', 'no method')}"
        raise BadData(f"{file} holds {held}, expected {FORMAT}, {method}: give weights trained with `train {method}`")
    try:
        settings = registry.construct(kind, metadata["settings"], "settings")
    except (GeovpError, KeyError, TypeError, AttributeError) as error:
        raise BadData(f"{file} has settings that do not suit {method} ({error}): train or get it anew") from error
    return Checkpoint(method, settings, metadata.get("history", {}), tensors)


def fingerprint(file: Path, wanted: str = "") -> str:
    """The first digits of a file's SHA-256, by which results know their weights; BadData when others are wanted."""
    try:
        digits = hashlib.sha256(file.read_bytes()).hexdigest()[:12]
    except OSError as error:
        raise BadData(f"weights {file} do not exist or cannot be read ({error}): give a safetensors file") from error
    if wanted not in ("", digits):
        raise BadData(f"{file} has the fingerprint {digits}, expected {wanted}: give the weights that are asked for")
    return digits


def restore(file: Path, network: nn.Module, checkpoint: Checkpoint, name: str) -> None:
    """Put the tensors of one network into it; BadData unless names, shapes and values are right."""
    own = {
        key.removeprefix(f"{name}."): tensor for key, tensor in checkpoint.tensors.items() if key.startswith(f"{name}.")
    }
    expected = network.state_dict()
    for key in sorted(expected.keys() | own.keys()):
        if key not in own or key not in expected or own[key].shape != expected[key].shape:
            given = tuple(own[key].shape) if key in own else "missing"
            wanted = tuple(expected[key].shape) if key in expected else "none"
            raise BadData(
                f"{file}: tensor {name}.{key} is {given}, expected {wanted}: the settings in it are not its own"
            )
        if not torch.isfinite(own[key]).all():
            raise BadData(f"{file}: tensor {name}.{key} has a number that is not finite: train or get it anew")
    network.load_state_dict(own)


def write_tensors(file: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, Any]) -> None:
    """A safetensors file with metadata as JSON, in place at once or not at all."""
    beside = file.with_name(f"{file.name}.part")
    contiguous = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        save_file(contiguous, beside, {key: json.dumps(value) for key, value in metadata.items()})
        os.replace(beside, file)
    except (OSError, SafetensorError) as error:
        raise BadData(f"{file} cannot be written ({error}): make room there or choose another folder") from error


def read_tensors(file: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Metadata and tensors; BadData when the file is missing or damaged."""
    if not file.is_file():
        raise BadData(f"weights {file} do not exist: give a safetensors file")
    try:
        with safe_open(file, framework="pt") as stored:
            metadata = {key: json.loads(value) for key, value in (stored.metadata() or {}).items()}
            return metadata, {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise BadData(f"{file} is not a whole safetensors file ({error}): train or get it anew") from error


def plain(settings: Any) -> dict[str, Any]:
    """A dataclass of settings as JSON has it."""
    table: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(settings)))
    return table


def _halved(tensor: Tensor) -> Tensor:
    """In half precision, unless that would overflow or the tensor is no floating point one."""
    if not tensor.is_floating_point() or not torch.isfinite(tensor.half()).all():
        return tensor
    return tensor.half()
