"""Expected time and memory of the trainings of learned methods, from one measured step on the CPU.

One step of the published settings is measured on a few random clips: its floating-point operations,
the tensors that the backward pass keeps, and its time. Both are proportional to the number of
examples, so that they are scaled to the config's batch. The time on a GPU follows from the
operations and an assumed sustained rate: it is an estimate, and nothing was measured on a GPU.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geovp.progress import tracked
from geovp_benchmarks.cli.options import number, option
from geovp_benchmarks.tables.formats import grid
from geovp_classic.types import Clip, Intrinsics, Trajectory

CONFIGS = (  # method and config, each with the settings of a paper
    ("svg", "svg-kitti"),
    ("srvp", "srvp-kitti"),
    ("slamp", "slamp-kitti"),
    ("synsin", "synsin-thesis"),
    ("deepvo", "deepvo-thesis"),
)
BYTES_PER_PARAMETER = 16  # in single precision: weight, gradient and Adam's two moments

ARGUMENTS = {
    "": {
        "configs CONFIGS...": option("Training configs. Default: those of the papers.", nargs="*"),
        "--examples N = 2": option("Examples in the measured step.", type=number(2)),
        "--tflops RATE = 30": option(
            "Assumed sustained rate of the GPU in 10^12 operations per second.", type=float
        ),
    }
}


@dataclass(frozen=True)
class Step:
    """One training step on the CPU."""

    parameters: int
    operations: int
    kept_bytes: int  # of tensors that the backward pass needs, weights left out
    seconds: float


def run(args: argparse.Namespace) -> Iterator[str]:
    """Yield a table with a row per config."""
    from geovp_learned import training_config

    lines = [
        [
            "config",
            "parameters (10^6)",
            "steps",
            "batch",
            "GFLOP per example",
            "core seconds per example",
            "memory (GB)",
            f"GPU at {args.tflops:g} TFLOP/s (h)",
            "one core (days)",
        ]
    ]
    configs = [pair for pair in CONFIGS if not args.configs or pair[1] in args.configs]
    for method_name, name in tracked(configs):
        tables = training_config.tables(Path(name))
        method = _method(method_name, tables["method"])
        # Of SynSin one example is enough, and more would take several gigabytes
        training, count = tables["training"], 1 if method_name == "synsin" else args.examples
        step = measure(method, count)
        total = training["num_steps"] * training.get("batch_size", 16)
        batch_scale = training.get("batch_size", 16) / count
        memory = step.parameters * BYTES_PER_PARAMETER + step.kept_bytes * batch_scale
        gpu_s = step.operations / count * total / (args.tflops * 1e12)
        lines.append(
            [
                name,
                f"{step.parameters / 1e6:.1f}",
                str(training["num_steps"]),
                str(training.get("batch_size", 16)),
                f"{step.operations / count / 1e9:.1f}",
                f"{step.seconds / count:.2f}",
                f"{memory / 1e9:.1f}",
                f"{gpu_s / 3600:.1f}",
                f"{step.seconds / count * total / 86400:.0f}",
            ]
        )
    yield from grid(lines)


def measure(method: Any, count: int) -> Step:
    """Measure the second step of a training on random examples."""
    import torch
    from torch.utils.data import default_collate
    from torch.utils.flop_counter import FlopCounterMode

    torch.manual_seed(0)
    networks = torch.nn.ModuleDict(method.build()).train()
    optimisers = method.optimisers(networks)
    examples = method.examples([method.prepare(random_clip(method))], training=True)
    rng = np.random.default_rng(0)
    batch = default_collate([method.example(examples[0], rng) for _ in range(count)])
    weights = {parameter.data_ptr() for parameter in networks.parameters()}
    storages: dict[int, int] = {}

    def note(tensor: torch.Tensor) -> torch.Tensor:
        storage = tensor.untyped_storage()
        if storage.data_ptr() not in weights:
            storages[storage.data_ptr()] = storage.nbytes()
        return tensor

    def step() -> None:
        for name, losses in method.training_step(networks, batch, 10**6).items():
            optimisers[name].zero_grad()
            losses["total"].backward()
            optimisers[name].step()

    # Kept tensors stay alive until the backward pass, so that no address is used twice before it
    counter = FlopCounterMode(display=False)
    with counter, torch.autograd.graph.saved_tensors_hooks(note, lambda tensor: tensor):
        step()
    start_s = time.process_time()  # not of the clock, since other programs may be running
    step()
    seconds = time.process_time() - start_s
    parameters = sum(parameter.numel() for parameter in networks.parameters())
    return Step(parameters, counter.get_total_flops(), sum(storages.values()), seconds)


def random_clip(method: Any) -> Clip:
    """Return a clip of noise that is long and large enough for one example of a method."""
    num_frames = getattr(method, "max_horizon", 0) + 1
    num_frames = max(num_frames, getattr(method, "num_past", 0) + getattr(method, "num_future", 0))
    size_px = 256
    frames = np.random.default_rng(0).integers(
        0, 256, (num_frames, size_px, size_px, 3), dtype=np.uint8
    )
    poses = np.tile(np.eye(4), (num_frames, 1, 1))
    poses[:, 2, 3] = np.arange(num_frames)
    times_s = np.arange(num_frames) / 10
    camera = Intrinsics(490.0, 490.0, 127.5, 127.5, size_px, size_px)
    return Clip("noise", frames, times_s, camera, Trajectory(poses, times_s, is_metric=True))


def _method(name: str, table: dict[str, Any]) -> Any:
    """Return a method with the settings of a config, with a content loss that needs no download."""
    from geovp_classic import registry
    from geovp_learned import methods

    if name == "synsin":
        table = {**table, "weights": {**table.get("weights", {}), "content": 0.0}}
    return registry.construct(methods.load(name), table, name)
