"""Weights as safetensors; the metadata have the settings. Nothing in them is executed.

Weights are stored in half precision where their values allow it.
"""

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load as loaded
from safetensors.torch import save
from torch import Tensor, nn

from geovp_classic import files, registry
from geovp_classic.data import atomic
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.types import PrivilegedInput
from geovp_learned import devices, methods

LIMIT_BYTES = 16384 * files.MIB
FORMAT = "geovp-weights-1"


@dataclass(frozen=True)
class Pretrained:
    """A component with a trained network.

    `checkpoint` is a weights file of `python -m geovp_learned train`; without one, the weights that
    come with the package. `fingerprint` identifies the weights in results; when given, other
    weights are refused. `device` is as in `devices`.
    """

    checkpoint: Path | None = None
    fingerprint: str = ""
    device: str = "cpu"

    method: ClassVar[str] = ""
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.NONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "fingerprint", fingerprint(self.file, self.fingerprint))
        object.__setattr__(self, "device", devices.resolved(self.device))
        self.load()

    @property
    def file(self) -> Path:
        """Return the weights file."""
        return self.checkpoint or shipped(self.method)

    def load(self) -> tuple[nn.Module, Any]:
        """Load the network, ready to predict, and the settings that it was trained with."""
        return load(self.method, self.file, self.fingerprint, self.device)

    @property
    def input_note(self) -> str:
        """Describe what the network is shown, and at which size; "" if a method does not say."""
        return ""

    @property
    def weights_note(self) -> str:
        """Describe the weights in a note below tables, from the metadata of their file alone."""
        history = read_metadata(self.file).get("history", {})
        count = sum(parameter.numel() for parameter in self.load()[0].parameters())
        name = f"{self.method} weights {self.file.name} {self.fingerprint}"
        facts = [
            *filter(None, (name, self.input_note)),
            f"{count:,} parameters on {devices.described(self.device)}",
        ]
        if "step" in history:
            planned, minutes = history["training"]["num_steps"], history["seconds"] / 60
            facts.append(f"{history['step']} of {planned} training steps, {minutes:.1f} minutes")
        datasets = " and ".join(map(_dataset_note, history.get("train", [])))
        return "; ".join(
            [
                *facts,
                f"trained on {datasets}"
                if datasets
                else "the file does not say on what it was trained",
            ]
        )


def shipped(method: str) -> Path:
    """Return the path of the weights file that comes with the package."""
    return Path(str(resources.files("geovp_learned").joinpath("weights", f"{method}.safetensors")))


@functools.lru_cache(maxsize=8)
def load(method: str, file: Path, fingerprint: str, device: str) -> tuple[nn.Module, Any]:
    """Load the first network in a weights file, and its settings, once per process; raise BadData
    if it cannot be used.

    The fingerprint only distinguishes files that had the same name at different times.
    """
    settings, tensors = read(file, method, methods.load(method))
    name = settings.stored_networks[0]
    network: nn.Module = settings.build()[name]
    restore(file, network, tensors, f"{name}.")
    return network.eval().to(device), settings


def write(
    file: Path,
    method: str,
    settings: Any,
    networks: Mapping[str, nn.Module],
    history: Mapping[str, Any],
) -> None:
    """Write the weights of networks in half precision, atomically."""
    tensors = {
        f"{name}.{key}": _halved(tensor)
        for name, network in networks.items()
        for key, tensor in network.state_dict().items()
    }
    metadata = {
        "format": FORMAT,
        "method": method,
        "settings": plain(settings),
        "history": dict(history),
    }
    write_tensors(file, tensors, metadata)


def read(file: Path, method: str, kind: type) -> tuple[Any, dict[str, Tensor]]:
    """Read settings, checked against the dataclass `kind`, and tensors "<network>.<parameter>" of a
    file for `method`.

    BadData in one sentence when the file is missing, damaged, or of another method.
    """
    metadata, tensors = read_tensors(file)
    if metadata.get("format") != FORMAT or metadata.get("method") != method:
        held = f"{metadata.get('format', 'no format')}, {metadata.get('method', 'no method')}"
        raise BadData(
            f"{file} holds {held}, expected {FORMAT}, {method}: give weights trained with "
            f"`train {method}`"
        )
    try:
        return registry.construct(kind, metadata["settings"], "settings"), tensors
    except (GeovpError, KeyError, TypeError, AttributeError) as error:
        raise BadData(
            f"{file} has settings that do not suit {method} ({error}): train it or get it again"
        ) from error


def fingerprint(file: Path, wanted: str = "") -> str:
    """Return the first 12 digits of a file's SHA-256; raise BadData if they differ from those
    expected.
    """
    try:
        digits = hashlib.sha256(files.read_bytes(file, LIMIT_BYTES)).hexdigest()[:12]
    except BadData as error:
        raise BadData(
            f"weights {file} do not exist or cannot be read ({error}): give a safetensors file"
        ) from error
    if wanted not in ("", digits):
        raise BadData(
            f"{file} has the fingerprint {digits}, expected {wanted}: give the weights that are "
            "asked for"
        )
    return digits


def restore(file: Path, network: nn.Module, tensors: Mapping[str, Tensor], prefix: str) -> None:
    """Load the tensors of a prefix into their network; BadData unless names, shapes and values are
    right.
    """
    subset = {
        key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)
    }
    try:
        network.load_state_dict(subset)
    except RuntimeError as error:
        raise BadData(
            f"{file}: {' '.join(str(error).split())}: the settings in it do not describe its "
            "network"
        ) from error
    for key, value in subset.items():
        if not torch.isfinite(value).all():
            raise BadData(
                f"{file}: tensor {prefix}{key} has a number that is not finite: train or get it "
                "again"
            )


def write_tensors(file: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, Any]) -> None:
    """Write a safetensors file with metadata as JSON, atomically."""
    contiguous = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    try:
        texts = {key: json.dumps(value) for key, value in metadata.items()}
        atomic.write_bytes(file, save(contiguous, texts))
    except (OSError, SafetensorError) as error:
        raise BadData(
            f"{file} cannot be written ({error}): make room there or choose another folder"
        ) from error


def read_metadata(file: Path) -> dict[str, Any]:
    """Read only the metadata of a file that could be loaded before."""
    with safe_open(file, framework="pt") as stored:
        return _metadata(stored)


def read_tensors(file: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Read metadata and tensors; raise BadData if the file is missing or damaged."""
    if not file.exists():
        raise BadData(f"weights {file} do not exist: give a safetensors file")
    content = files.read_bytes(file, LIMIT_BYTES)
    try:
        with safe_open(file, framework="pt") as stored:
            return _metadata(stored), loaded(content)
    except (SafetensorError, OSError, ValueError, KeyError, RecursionError, OverflowError) as error:
        raise BadData(
            f"{file} is not a whole safetensors file ({error}): train it or get it again"
        ) from error


def _metadata(stored: Any) -> dict[str, Any]:
    return {key: json.loads(value) for key, value in (stored.metadata() or {}).items()}


def plain(settings: Any) -> dict[str, Any]:
    """Return a dataclass of settings as plain JSON values."""
    return dict(json.loads(json.dumps(dataclasses.asdict(settings))))


def _dataset_note(table: Mapping[str, Any]) -> str:
    """Describe a data set that was trained on: its name, split or sequences, and size."""
    part = f"split {table['split']}" if "split" in table else " ".join(table.get("sequences") or ())
    size = "x".join(map(str, table.get("size_px", ())))
    return " ".join(filter(None, (str(table.get("name")), part, f"({size})" if size else "")))


def _halved(tensor: Tensor) -> Tensor:
    """Convert a tensor to half precision, unless it is not of floating-point numbers or would
    overflow.
    """
    return (
        tensor.half()
        if tensor.is_floating_point() and torch.isfinite(tensor.half()).all()
        else tensor
    )
