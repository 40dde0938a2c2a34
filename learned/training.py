"""The training loop of all methods, on Lightning Fabric: one CPU, one GPU, or several with DDP.

A run is a folder: `state.safetensors` (where it stands), `weights.safetensors` (the best so far) and `log.csv`. It may
be killed at any moment; started again it goes on from the last state, and ends with the same bytes.
"""

from __future__ import annotations

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
from torch import Tensor, nn
from torch.optim import Optimizer
from tqdm import tqdm

from geovp_classic.errors import BadData
from geovp_classic.interfaces import Dataset
from geovp_classic.types import Clip
from learned import checkpoints, precision, recipes, training_state
from learned.averaging import RunningMean
from learned.methods import Batch, Losses
from learned.recipes import Recipe
from learned.schedules import Order, rate_share
from learned.training_log import TrainingLog
from learned.training_state import Progress, seed_everything

STATE, WEIGHTS, LOG = "state.safetensors", "weights.safetensors", "log.csv"
LOG_EVERY = 20  # steps
BUILDING, STEPPING = 1, 2  # seeds of torch's random numbers, apart from one another


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    step: int
    best_score: float
    best_step: int
    seconds: float
    finished: bool  # False: stopped before its time, goes on when started again
    is_first: bool = True  # of several processes, the one that keeps the log


def train(recipe: Recipe, folder: Path, limit_seconds: float | None = None) -> Outcome:
    """Train until the steps are done, the score stays away, or `limit_seconds` are over; the state is kept."""
    settings = recipe.training
    if settings.num_threads:
        torch.set_num_threads(settings.num_threads)
        cv2.setNumThreads(settings.num_threads)  # batches are drawn with it; its threads wait for one another at length
    plugins = precision.plugins(settings)
    fabric = Fabric(
        accelerator=settings.accelerator,
        devices=settings.devices,
        num_nodes=settings.num_nodes,
        strategy=settings.strategy,
        plugins=list(plugins) or None,
        precision=None if plugins else settings.precision,  # type: ignore[arg-type]
    )
    fabric.launch()
    run = _Run(recipe, folder, fabric)
    with _stop_on_signal() as stopped:
        return run.go(stopped, math.inf if limit_seconds is None else limit_seconds)


class _Run:
    """One start of a run, with everything that it needs at hand."""

    def __init__(self, recipe: Recipe, folder: Path, fabric: Fabric) -> None:
        self.method, self.settings, self.recipe = recipe.method, recipe.training, recipe
        self.folder, self.fabric = folder, fabric
        seed_everything(self.settings.seed, BUILDING)
        self.bare = self.method.build()  # what is stored: a device's wrapping would show in the names
        self.bare_optimisers = self.method.optimisers(self.bare)
        self.rates = {name: [group["lr"] for group in own.param_groups] for name, own in self.bare_optimisers.items()}
        self.may_overflow = bool(precision.loss_scale(fabric))
        self.networks, self.optimisers = _set_up(fabric, self.bare, self.bare_optimisers)
        self.mean = RunningMean(self.bare, self.settings.average_steps)
        self.stored = {**self.bare, **self.mean.stored}
        self.identity = {
            "method": recipe.method_name,
            "settings": checkpoints.plain(self.method),
            "training": self.settings.decisive,
            "data": recipes.describe(recipe.train),
        }
        self.progress = Progress()
        if (folder / STATE).exists():
            self.progress = training_state.read(folder / STATE, self.stored, self.bare_optimisers, self.identity)
            precision.load_loss_scale(fabric, self.progress.loss_scale)
        self.log = TrainingLog(folder / LOG, self.progress.step) if fabric.is_global_zero else None

    def go(self, stopped: Sequence[int], limit_s: float) -> Outcome:
        """Step after step, from where the run stands to its end, a signal, or the time limit."""
        examples = self.method.examples(_clips(self.recipe.train), training=True)
        held_out = self.method.examples(_clips(self.recipe.validation), training=False)
        if not len(examples) or not len(held_out):
            raise BadData("no clip is long enough for one example: give the data sets a larger num_frames")
        order = Order(len(examples), self.settings.batch_size, self.fabric.world_size, self.settings.seed)
        start_s = saved_s = time.monotonic()
        before_s = self.progress.seconds
        with tqdm(total=self.settings.num_steps, initial=self.progress.step, disable=self.log is None) as bar:
            while not self.over and not stopped and time.monotonic() - start_s < limit_s:
                self.advance(examples, order, bar)
                self.progress.seconds = before_s + time.monotonic() - start_s
                if self.progress.step % self.settings.validate_every == 0 or self.progress.step == bar.total:
                    with self.mean.in_place():
                        self.validate(held_out)
                if time.monotonic() - saved_s > self.settings.save_every_s:
                    self.save()
                    saved_s = time.monotonic()
        self.save()
        progress = self.progress
        is_first = self.fabric.is_global_zero
        return Outcome(progress.step, progress.best_score, progress.best_step, progress.seconds, self.over, is_first)

    @property
    def over(self) -> bool:
        """All steps done, or the best score too long ago."""
        impatient = 0 < self.settings.patience <= self.progress.misses
        return impatient or self.progress.step >= self.settings.num_steps

    def advance(self, examples: Sequence[Any], order: Order, bar: Any) -> None:
        """The batch of this step and what is learnt from it."""
        step, rank = self.progress.step, self.fabric.global_rank
        rng = np.random.default_rng([self.settings.seed, step, rank])
        losses = self.step(self.method.batch(examples, order.at(step)[rank], rng), step)
        self.progress.step = step + 1
        self.mean.update(self.progress.step)
        bar.update()
        if self.progress.step % LOG_EVERY == 0:
            numbers = {name: float(loss) for name, loss in losses.items()}
            self.note("train", numbers)
            bar.set_postfix({name: f"{number:.3g}" for name, number in numbers.items()})

    def step(self, batch: Batch, step: int) -> Losses:
        """One step of every network whose turn it is; the losses by name, "<network>.<loss>" where several learn."""
        seed_everything(self.settings.seed, STEPPING, step, self.fabric.global_rank)
        share = rate_share(step, self.settings)
        for name, optimiser in self.bare_optimisers.items():
            for group, rate in zip(optimiser.param_groups, self.rates[name], strict=True):
                group["lr"] = rate * share
        for network in self.networks.values():
            network.train()
        logged: Losses = {}
        for turn, losses in self.method.training_step(self.networks, self.fabric.to_device(batch), step):
            self.learn(turn, losses["total"])
            prefix = f"{turn}." if len(self.optimisers) > 1 else ""
            logged |= {f"{prefix}{name}": loss.detach() for name, loss in losses.items()}
        return logged

    def learn(self, turn: str, total: Tensor) -> None:
        """One network's step down its loss."""
        self.bare_optimisers[turn].zero_grad()  # other networks' turns leave gradients here, too
        self.fabric.backward(total)
        if self.settings.clip_norm:
            norm = self.settings.clip_norm
            # In halves gradients may overflow: the step is left out then and the loss scale halved, as it should be.
            self.fabric.clip_gradients(
                self.networks[turn], self.optimisers[turn], max_norm=norm, error_if_nonfinite=not self.may_overflow
            )
        self.optimisers[turn].step()

    def validate(self, held_out: Sequence[Any]) -> None:
        """Score the networks as they stand, and keep their weights if they are the best so far."""
        for network in self.networks.values():
            network.eval()
        with torch.no_grad():
            scores = self.method.validate(self.networks, held_out)
        self.note("validation", scores)
        if scores["score"] < self.progress.best_score:
            self.progress.best_score, self.progress.best_step = scores["score"], self.progress.step
            self.progress.misses = 0
            self.keep(scores)
        else:
            self.progress.misses += 1

    def keep(self, scores: Mapping[str, float]) -> None:
        """Write the weights file."""
        history = {
            "train": recipes.describe(self.recipe.train),
            "validation": recipes.describe(self.recipe.validation),
            "training": self.settings.decisive,
            "step": self.progress.step,
            "seconds": round(self.progress.seconds, 1),
            "scores": dict(scores),
        }
        kept = {name: self.bare[name] for name in self.method.kept}
        if self.fabric.is_global_zero:
            checkpoints.write(self.folder / WEIGHTS, self.recipe.method_name, self.method, kept, history)

    def save(self) -> None:
        """Write the state."""
        self.progress.loss_scale = precision.loss_scale(self.fabric)
        if self.fabric.is_global_zero:
            training_state.write(self.folder / STATE, self.stored, self.bare_optimisers, self.progress, self.identity)
        self.fabric.barrier()

    def note(self, split: str, numbers: Mapping[str, float]) -> None:
        """A row of the log for every number, from the first device."""
        if self.log is not None:
            self.log.write(self.progress.step, self.progress.seconds, split, numbers)


def _set_up(
    fabric: Fabric, networks: Mapping[str, nn.Module], optimisers: Mapping[str, Optimizer]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Networks and optimisers as Fabric wraps them for its devices; networks that don't learn are only moved there."""
    wrapped, wrapped_optimisers = {}, {}
    for name, network in networks.items():
        if name in optimisers:
            wrapped[name], wrapped_optimisers[name] = fabric.setup(network, optimisers[name])
        else:
            wrapped[name] = fabric.to_device(network)
    return wrapped, wrapped_optimisers


def _clips(datasets: Sequence[Dataset]) -> Iterator[Clip]:
    """The clips of all data sets, one after the other."""
    for dataset in datasets:
        for index in tqdm(range(len(dataset)), desc=f"reading {dataset.name}", leave=False, delay=2.0):
            yield dataset[index]


@contextmanager
def _stop_on_signal() -> Iterator[list[int]]:
    """A list that is empty until someone asks to stop (Ctrl-C, SIGTERM): the step at hand is ended first."""
    received: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield received
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in before:
        signal.signal(number, lambda caught, _: received.append(caught))
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
