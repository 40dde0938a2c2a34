"""The training loop of all methods, on Lightning Fabric: one CPU, one GPU, or several with DDP.

A run is a folder: `state.safetensors` (the last checkpoint), `weights.safetensors` (the best
weights so far) and `log.csv`. A run that was killed goes on from its last checkpoint when started
again, and ends with the same bytes.
"""

from __future__ import annotations

import dataclasses
import math
import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from lightning.fabric import Fabric
from torch import Tensor
from torch.utils.data import DataLoader
from tqdm import tqdm

from geovp_classic.errors import BadData
from geovp_classic.interfaces import Dataset
from geovp_classic.types import Clip
from geovp_learned import checkpoints, hardware, schedules, training_config, training_log
from geovp_learned.methods import Batch, Losses, Method
from geovp_learned.training_config import TrainingConfig

STATE, WEIGHTS, LOG = "state.safetensors", "weights.safetensors", "log.csv"
LOG_EVERY = 20  # steps


@dataclass
class Progress:
    """The loop's counters."""

    step: int = 0  # steps done
    seconds: float = 0.0  # of training, over all starts
    best_score: float = math.inf
    best_step: int = 0
    misses: int = 0  # validations since the best one


def train(config: TrainingConfig, folder: Path, limit_seconds: float | None = None) -> Trainer:
    """Train until all steps are done, patience is exhausted, or `limit_seconds` are over; the state
    is kept.
    """
    settings = config.training
    if settings.num_threads:
        torch.set_num_threads(settings.num_threads)
        cv2.setNumThreads(
            settings.num_threads
        )  # used by batches; its default threads slow each other down
    fabric = hardware.fabric(settings)
    hardware.keep_inputs(fabric)
    fabric.launch()
    trainer = Trainer(config, folder, fabric)
    with _stop_on_signal() as signals:
        trainer.fit(signals, math.inf if limit_seconds is None else limit_seconds)
    return trainer


@dataclass(frozen=True)
class Batches(torch.utils.data.Dataset[Batch]):
    """The batches of one device, by step; augmented with random numbers of the step."""

    method: Method
    examples: Sequence[Any]
    settings: training_config.Training
    rank: int
    world: int

    def __getitem__(self, step: int) -> Batch:
        """Return the batch of a step."""
        seed, size = self.settings.seed, self.settings.batch_size
        indices = schedules.batch_indices(step, len(self.examples), size, self.world, seed)
        rng = np.random.default_rng([seed, step, self.rank])
        return self.method.batch(self.examples, indices[self.rank], rng)


class Trainer:
    """One start of a run, and how it ended."""

    def __init__(self, config: TrainingConfig, folder: Path, fabric: Fabric) -> None:
        self.method, self.settings, self.config = config.method, config.training, config
        self.folder, self.fabric, self.scaler = folder, fabric, fabric.strategy.precision
        schedules.seed(self.settings.seed, schedules.BUILD_SEED)
        self.bare = (
            self.method.build()
        )  # stored in files: Fabric's wrappers would change the tensors' names
        self.bare_optimisers = self.method.optimisers(self.bare)
        self.rates = {
            name: [group["lr"] for group in own.param_groups]
            for name, own in self.bare_optimisers.items()
        }
        steps = self.settings.average_steps
        self.averages = (
            {name: schedules.averaged_model(net, steps) for name, net in self.bare.items()}
            if steps
            else {}
        )
        self.networks: dict[str, Any] = {}
        self.optimisers: dict[str, Any] = {}
        for name, network in self.bare.items():
            if name in self.bare_optimisers:
                self.networks[name], self.optimisers[name] = fabric.setup(
                    network, self.bare_optimisers[name]
                )
            else:
                self.networks[name] = fabric.to_device(network)
        self.evaluated = {
            name: fabric.setup_module(each.module) for name, each in self.averages.items()
        }
        self.identity = {
            "method": config.method_name,
            "settings": checkpoints.plain(self.method),
            "training": self.settings.decisive,
            "data": training_config.describe(config.train),
        }
        self.progress = Progress()
        if (folder / STATE).exists():
            self.load()
        if fabric.is_global_zero:
            training_log.truncate(folder / LOG, self.progress.step)

    def fit(self, signals: Sequence[int], limit_s: float) -> None:
        """Train from the current step to the end, a signal, or the time limit."""
        examples = self.method.examples(_clips(self.config.train), training=True)
        held_out = self.method.examples(_clips(self.config.validation), training=False)
        if not len(examples) or not len(held_out):
            raise BadData(
                "no clip is long enough for one example: give the data sets a larger num_frames"
            )
        progress, settings = self.progress, self.settings
        batches = self.batches(examples)
        start_s = saved_s = time.monotonic()
        before_s = progress.seconds
        with tqdm(
            total=settings.num_steps, initial=progress.step, disable=not self.fabric.is_global_zero
        ) as bar:
            while not self.finished and not signals and time.monotonic() - start_s < limit_s:
                self.train_step(next(batches), bar)
                progress.seconds = before_s + time.monotonic() - start_s
                if (
                    progress.step % settings.validate_every == 0
                    or progress.step == settings.num_steps
                ):
                    self.validate(held_out)
                if time.monotonic() - saved_s > settings.save_every_s:
                    self.save()
                    saved_s = time.monotonic()
        self.save()

    @property
    def finished(self) -> bool:
        """Return whether all steps are done, or patience is exhausted; False: interrupted, resumed
        when started again.
        """
        progress, settings = self.progress, self.settings
        return progress.step >= settings.num_steps or 0 < settings.patience <= progress.misses

    def batches(self, examples: Sequence[Any]) -> Iterator[Batch]:
        """Return the batches of the remaining steps, prepared ahead by worker processes if any."""
        fabric = self.fabric
        steps = Batches(self.method, examples, self.settings, fabric.global_rank, fabric.world_size)
        loader = DataLoader(
            steps,
            batch_size=None,  # a step is a whole batch
            sampler=range(self.progress.step, self.settings.num_steps),
            num_workers=self.settings.num_workers,
            # a forked worker would hang in the pools of threads of OpenCV and Numba
            multiprocessing_context="forkserver" if self.settings.num_workers else None,
            worker_init_fn=_one_thread,
        )
        return iter(loader)

    def train_step(self, batch: Batch, bar: Any) -> None:
        """Take a step on a batch; its losses are logged every LOG_EVERY steps."""
        step = self.progress.step
        losses = self.optimise(batch, step)
        self.progress.step = step + 1
        for name, average in self.averages.items():
            average.update_parameters(self.bare[name])
        bar.update()
        if self.progress.step % LOG_EVERY == 0:
            numbers = {name: float(loss) for name, loss in losses.items()}
            self.write_log("train", numbers)
            bar.set_postfix({name: f"{number:.3g}" for name, number in numbers.items()})

    def optimise(self, batch: Batch, step: int) -> Losses:
        """Take optimiser steps on a batch; return the losses by name, "<network>.<loss>" where
        several networks learn.
        """
        schedules.seed(self.settings.seed, schedules.STEP_SEED, step, self.fabric.global_rank)
        factor = schedules.learning_rate_factor(step, self.settings)
        for name, optimiser in self.bare_optimisers.items():
            for group, rate in zip(optimiser.param_groups, self.rates[name], strict=True):
                group["lr"] = rate * factor
        for network in self.networks.values():
            network.train()
        logged: Losses = {}
        for name, losses in self.method.training_step(
            self.networks, self.fabric.to_device(batch), step
        ):
            self.optimiser_step(name, losses["total"])
            prefix = f"{name}." if len(self.optimisers) > 1 else ""
            logged |= {f"{prefix}{key}": loss.detach() for key, loss in losses.items()}
        return logged

    def optimiser_step(self, name: str, total: Tensor) -> None:
        """Run the backward pass, gradient clipping and optimiser step of one network."""
        self.bare_optimisers[
            name
        ].zero_grad()  # the losses of other networks leave gradients here, too
        self.fabric.backward(total)
        if self.settings.clip_norm:
            # With a gradient scaler, gradients may overflow: it skips the step and lowers the
            # scale.
            network, optimiser, norm = (
                self.networks[name],
                self.optimisers[name],
                self.settings.clip_norm,
            )
            is_strict = not self.scaler.state_dict()
            self.fabric.clip_gradients(
                network, optimiser, max_norm=norm, error_if_nonfinite=is_strict
            )
        self.optimisers[name].step()

    def validate(self, held_out: Sequence[Any]) -> None:
        """Score the networks, or their EMA, and write their weights if they are the best so far."""
        networks = self.evaluated or self.networks
        for network in networks.values():
            network.eval()
        with torch.no_grad():
            scores = self.method.validate(networks, held_out)
        self.write_log("validation", scores)
        self.progress.misses += 1
        if scores["score"] < self.progress.best_score:
            self.progress.best_score, self.progress.best_step = scores["score"], self.progress.step
            self.progress.misses = 0
            self.write_weights(scores)

    def write_weights(self, scores: Mapping[str, float]) -> None:
        """Write the weights file."""
        history = {
            **{
                "step": self.progress.step,
                "seconds": round(self.progress.seconds, 1),
                "scores": dict(scores),
            },
            **{
                "train": self.identity["data"],
                "validation": training_config.describe(self.config.validation),
            },
            "training": self.settings.decisive,
        }
        kept = {
            name: self.averages[name].module if self.averages else self.bare[name]
            for name in self.method.kept
        }
        if self.fabric.is_global_zero:
            checkpoints.write(
                self.folder / WEIGHTS, self.config.method_name, self.method, kept, history
            )

    def save(self) -> None:
        """Write the state: all that the next step depends on, but random numbers, which every step
        seeds anew.
        """
        if self.fabric.is_global_zero:
            state: dict[str, Any] = {
                group: {name: part.state_dict() for name, part in parts.items()}
                for group, parts in self.parts()
            }
            state |= {"progress": dataclasses.asdict(self.progress), "identity": self.identity}
            checkpoints.write_state(self.folder / STATE, state)
        self.fabric.barrier()

    def load(self) -> None:
        """Go on from a stored state; BadData when it is damaged or of another run."""
        file = self.folder / STATE
        state = checkpoints.read_state(file)
        if (stored := state["identity"]) != self.identity:
            keys = sorted(
                key
                for key in {*stored, *self.identity}
                if stored.get(key) != self.identity.get(key)
            )
            raise BadData(
                f"{file} belongs to a run with another {', '.join(keys)}: give another --out, "
                "or remove it"
            )
        try:
            for group, parts in self.parts():
                for name, part in parts.items():
                    part.load_state_dict(state[group][name])
        except (KeyError, RuntimeError, ValueError) as error:
            raise BadData(
                f"{file} does not fit this method ({' '.join(str(error).split())}): remove it"
            ) from error
        self.progress = Progress(**state["progress"])

    def parts(self) -> tuple[tuple[str, Mapping[str, Any]], ...]:
        """Return the objects of the state that have a `state_dict`, in groups."""
        networks = (("networks", self.bare), ("averages", self.averages))
        return (
            *networks,
            ("optimisers", self.bare_optimisers),
            ("precision", {"scaler": self.scaler}),
        )

    def write_log(self, split: str, numbers: Mapping[str, float]) -> None:
        """Write a row of the log per number, from the first process."""
        if self.fabric.is_global_zero:
            training_log.append(
                self.folder / LOG, self.progress.step, self.progress.seconds, split, numbers
            )


def _one_thread(_: int) -> None:
    """Leave the cores to the other workers."""
    cv2.setNumThreads(1)


def _clips(datasets: Sequence[Dataset]) -> Iterator[Clip]:
    """Return the clips of all data sets, one after the other."""
    for dataset in datasets:
        for index in tqdm(
            range(len(dataset)), desc=f"reading {dataset.name}", leave=False, delay=2.0
        ):
            yield dataset[index]


@contextmanager
def _stop_on_signal() -> Iterator[list[int]]:
    """Collect signals that ask to stop (Ctrl-C, SIGTERM); the current step is finished first."""
    received: list[int] = []
    numbers = (
        (signal.SIGINT, signal.SIGTERM)
        if threading.current_thread() is threading.main_thread()
        else ()
    )
    before = {
        number: signal.signal(number, lambda caught, _: received.append(caught))
        for number in numbers
    }
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
