"""Weights as safetensors; the metadata have the settings. Nothing in them is executed.

Weights are stored in half precision where their values allow it.
"""

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import torch
from safetensors import safe_open
from safetensors.torch import load as loaded
from safetensors.torch import save
from torch import Tensor, nn

from geovp_classic import atomic, files, registry
from geovp_classic.errors import BadData
from geovp_classic.types import PrivilegedInput
from geovp_learned import devices, methods

LIMIT_BYTES = 16384 * files.MIB
FORMAT = "geovp-weights-1"
UNKNOWN_ORIGIN = "the file does not say on what it was trained"


@dataclass(frozen=True)
class Pretrained:
    """A component with a trained network.

    `weights` is a file of `python -m geovp_learned train` or `convert`; only components that are
    named after shipped weights have a default. `fingerprint` identifies the weights in results;
    when given, other weights are refused. `device` is as in `devices`.
    """

    weights: Path | None = None
    fingerprint: str = ""
    device: str = "cpu"

    method: ClassVar[str] = ""
    shipped: ClassVar[str] = ""  # name of the weights that come with the package
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.NONE

    def __post_init__(self) -> None:
        identify(self, self.file)
        self.load()

    @property
    def file(self) -> Path:
        """Return the weights file; raise BadData if there is none."""
        if self.weights is None and not self.shipped:
            raise BadData(
                f"{self.method} stands for official or fully trained weights: give weights = PATH "
                "(docs/guide/official-weights.md), or use the small network that comes with the "
                "package (`geovp list`)"
            )
        return self.weights or shipped(self.shipped)

    def load(self) -> tuple[Any, Any]:
        """Load the network, ready to predict, and the settings that it was trained with."""
        return _loaded(self)

    @property
    def input_note(self) -> str:
        """Describe what the network is shown, and at which size; "" if a method does not say."""
        return ""

    @property
    def weights_note(self) -> str:
        """Describe the weights in a note below tables, from the metadata of their file alone."""
        history = read_tensors(self.file)[0].get("history", {})
        count = sum(parameter.numel() for parameter in self.load()[0].parameters())
        facts = [
            f"{self.method} weights {self.file.name} {self.fingerprint}",
            self.input_note,
            f"{count:,} parameters on {devices.described(self.device)}",
        ]
        if "step" in history:
            planned, minutes = history["training"]["num_steps"], history["seconds"] / 60
            facts.append(f"{history['step']} of {planned} training steps, {minutes:.1f} minutes")
        pairs = [(table["name"], table.get("split", "")) for table in history.get("train", [])]
        datasets = " and ".join(" ".join(pair).strip() for pair in pairs)
        origin = f"trained on {datasets}" if datasets else UNKNOWN_ORIGIN
        if "origin" in history:
            origin = "official weights, converted from {file} ({units})".format(**history["origin"])
        return "; ".join(filter(None, [*facts, origin]))


def shipped(name: str) -> Path:
    """Return the path of a weights file that comes with the package, such as "svg-tiny"."""
    return Path(__file__).with_name("weights") / f"{name}.safetensors"


@functools.lru_cache(maxsize=8)
def _loaded(component: Pretrained) -> tuple[Any, Any]:
    """Load the first network in a weights file, and its settings, once per process; raise BadData
    if it cannot be used.
    """
    method, file = component.method, component.file
    settings, tensors = read(file, method, methods.load(method))
    name, network = next(iter(settings.build().items()))
    restore(file, network, tensors, f"{name}.")
    return network.eval().to(component.device), settings


def identify(component: Any, path: Path | None) -> None:
    """Set the fingerprint of a component to that of its weights, if any, and its device to one that
    this machine has.
    """
    if path is not None:
        object.__setattr__(component, "fingerprint", fingerprint(path, component.fingerprint))
    object.__setattr__(component, "device", devices.resolved(component.device))


def write(
    file: Path,
    method: str,
    settings: Any,
    networks: Mapping[str, nn.Module],
    history: Mapping[str, Any],
    *,
    use_halves: bool = True,
) -> None:
    """Write the weights of networks atomically, if asked in half precision."""
    tensors = {
        f"{name}.{key}": (_halved(tensor) if use_halves else tensor).detach().cpu().contiguous()
        for name, network in networks.items()
        for key, tensor in network.state_dict().items()
    }
    metadata = {
        "format": FORMAT,
        "method": method,
        "settings": dataclasses.asdict(settings),
        "history": history,
    }
    texts = {key: json.dumps(value) for key, value in metadata.items()}
    with files.checked(f"{file} cannot be written", "make room there or choose another folder"):
        atomic.write_bytes(file, save(tensors, texts))


def read(file: Path, method: str, kind: type) -> tuple[Any, dict[str, Tensor]]:
    """Read settings, checked against the dataclass `kind`, and tensors "<network>.<parameter>" of a
    file for `method`.

    BadData in one sentence when the file is missing, damaged, or of another method.
    """
    metadata, tensors = read_tensors(file)
    held = metadata.get("format", "no format"), metadata.get("method", "no method")
    if held != (FORMAT, method):
        raise BadData(
            f"{file} holds {', '.join(held)}, expected {FORMAT}, {method}: give weights trained "
            f"with `train {method}`"
        )
    what = f"{file} has settings that do not suit {method}"
    with files.checked(what, "train it or get it again"):
        return registry.construct(kind, metadata["settings"], "settings"), tensors


def fingerprint(path: Path, wanted: str = "") -> str:
    """Return the first 12 digits of the SHA-256 of a file, or of a folder's safetensors and JSON
    files; raise BadData if they differ from those expected.
    """
    if path.is_dir():
        members = sorted([*path.glob("*.safetensors"), *path.glob("*.json")])
        content = "".join(member.name + fingerprint(member) for member in members).encode()
    else:
        content = files.read_bytes(path, LIMIT_BYTES)
    digits = hashlib.sha256(content).hexdigest()[:12]
    if wanted not in ("", digits):
        raise BadData(
            f"{path} has the fingerprint {digits}, expected {wanted}: give the weights that are "
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


def read_tensors(file: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Read metadata and tensors; raise BadData if the file is missing or damaged."""
    content = files.read_bytes(file, LIMIT_BYTES)
    with files.checked(f"{file} is not a whole safetensors file", "train it or get it again"):
        with safe_open(file, framework="pt") as stored:
            texts = stored.metadata() or {}
        return {key: json.loads(text) for key, text in texts.items()}, loaded(content)


def _halved(tensor: Tensor) -> Tensor:
    """Convert a tensor to half precision, unless it is not of floating-point numbers or would
    overflow.
    """
    half = tensor.half()
    return half if tensor.is_floating_point() and half.isfinite().all() else tensor
