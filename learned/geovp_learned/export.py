"""Networks without splatting as ONNX files, for use without this package: DeepVO and LPIPS."""

import contextlib
import copy
import importlib.util
import io
import logging
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from geovp_classic.errors import BadData, MissingExtra
from geovp_classic.registry import install_command, nearest
from geovp_learned import checkpoints, lpips

NAMES = ("deepvo", "lpips")
NEEDS = ("onnx", "onnxscript")


@dataclass(frozen=True)
class Exportable:
    """A network with constants in place of inputs that are not tensors, and example inputs."""

    network: nn.Module
    inputs: dict[str, Tensor]
    outputs: tuple[str, ...]
    free: tuple[int, ...] = ()  # axes of all inputs that may have any size later


class DeepVoSteps(nn.Module):
    """Images [1, P, 3, H, W] in [0, 1] of the network's own camera to steps [1, P - 1, D] and [1,
    F, D] after them.
    """

    def __init__(self, network: nn.Module, num_future: int) -> None:
        super().__init__()
        self.network, self.num_future = network, num_future

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Return metres and radians, as in `deepvo.network`."""
        past, future = self.network(images, self.num_future)
        return past, future


def exportable(
    name: str,
    weights: Path | None = None,
    num_past: int = 10,
    num_future: int = 20,
    size_px: int = 256,
) -> Exportable:
    """Return the network of a name; raise BadData for one that has no ONNX form."""
    if name not in NAMES:
        raise BadData(f"{name!r} cannot be exported to ONNX{nearest(name, NAMES)}")
    if name == "lpips":
        frames = torch.rand(2, 2, 3, size_px, size_px)
        inputs = dict(zip(("predicted", "target"), frames, strict=True))
        distance = lpips.load_network("alex", lpips.find_weights("alex", weights), "cpu")
        return Exportable(distance, inputs, ("distance",), free=(0,))
    file = weights or checkpoints.shipped(name)
    network, settings = checkpoints.load(name, file, checkpoints.fingerprint(file), "cpu")
    width_px, height_px = settings.architecture.size_px
    images = torch.rand(1, max(num_past, 2), 3, height_px, width_px)
    return Exportable(
        DeepVoSteps(copy.deepcopy(network), num_future), {"images": images}, ("past", "future")
    )


def write_onnx(file: Path, exported: Exportable) -> None:
    """Write an ONNX file with its weights inside; MissingExtra without the packages
    that write it.
    """
    if lacking := [module for module in NEEDS if importlib.util.find_spec(module) is None]:
        raise MissingExtra(
            f"export needs {lacking[0]}, which is not installed: {install_command('onnx')}"
        )
    if not file.parent.is_dir():
        raise BadData(f"{file.parent} is not a folder: make it, or give another --onnx")
    axes: Any = [dict.fromkeys(exported.free, torch.export.Dim.DYNAMIC) for _ in exported.inputs]
    with _quiet():
        torch.onnx.export(
            exported.network.eval(),
            tuple(exported.inputs.values()),
            file,
            input_names=list(exported.inputs),
            output_names=exported.outputs,
            dynamic_shapes=axes if exported.free else None,
            dynamo=True,
            external_data=False,
            # it drops the 1e-10 that keeps an empty cell of LPIPS from becoming 0 / 0
            optimize=False,
        )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence torch's exporter, which reports its steps and packages that are not needed here."""
    logger = logging.getLogger("torch.onnx")
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(before)
