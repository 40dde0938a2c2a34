"""The training loop of all methods, on Lightning Fabric: one CPU, one GPU, or several with DDP.

A run is a folder: `state.ckpt` (the last checkpoint), `weights.safetensors` (the best weights so
far), the logs, and until it is finished `clips`, from which frames are read. A run that was stopped
or killed is resumed from its last checkpoint and ends with the same result.
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import torch
from lightning.fabric import Fabric
from lightning.fabric.loggers.logger import Logger
from lightning.fabric.plugins import MixedPrecision
from torch import Tensor, nn
from torch.optim.lr_scheduler import LambdaLR
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from tqdm import tqdm

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_learned import (
    batches,
    checkpoints,
    devices,
    stored_clips,
    training_config,
    training_log,
)
from geovp_learned.methods import Batch, Losses
from geovp_learned.stored_clips import StoredClip
from geovp_learned.training_config import Training, TrainingConfig

STATE, WEIGHTS, CLIPS = "state.ckpt", "weights.safetensors", "clips"


@dataclass
class Progress:
    """The loop's counters."""

    step: int = 0  # steps done
    seconds: float = 0.0  # of training, over all starts
    best_score: float = math.inf
    best_step: int = 0


def train(
    config: TrainingConfig, folder: Path, *, resume: bool = False, limit_s: float = math.inf
) -> Trainer:
    """Train until all steps are done, patience is exhausted, or the time is over.

    With `resume` a run goes on from the checkpoint in its folder, if there is one. Raise BadData
    for a checkpoint that is damaged, of another run, or not to be resumed.
    """
    settings = config.training
    if settings.num_threads:
        torch.set_num_threads(settings.num_threads)
        cv2.setNumThreads(settings.num_threads)  # its default threads slow each other down
    fabric = build_fabric(settings)
    fabric.launch()
    trainer = Trainer(config, folder, fabric, resume=resume)
    trainer.fit(limit_s)
    return trainer


def build_fabric(settings: Training) -> Fabric:
    """Build Lightning Fabric from the settings; raise BadData if it refuses them, or if a processor
    lacks bfloat16: convolutions take about fifteen times as long, LSTMs fail.
    """
    names = ("accelerator", "devices", "strategy", "precision")
    with files.checked("[training] does not fit this machine", "change it"):
        fabric = Fabric(**{name: getattr(settings, name) for name in names})
    capability = torch.backends.cpu.get_cpu_capability()
    is_slow = fabric.device.type == "cpu" and capability in ("AVX2", "DEFAULT")
    if is_slow and "bf16" in settings.precision:
        reason = f"needs a processor with AVX-512 or AMX, or a GPU (this processor: {capability})"
        raise BadData(f"precision {settings.precision} {reason}: give --precision 32-true")
    keep_inputs(fabric)
    return fabric


def keep_inputs(fabric: Fabric) -> None:
    """Let mixed precision compute in halves, but not round the inputs: a focal length of 489.5
    would become 490 px.
    """
    if isinstance(precision := fabric.strategy.precision, MixedPrecision):
        precision.convert_input = lambda data: data  # type: ignore[method-assign]


def learning_rate_factor(step: int, settings: Training) -> float:
    """Return the factor of a linear warm-up, then of annealing to `final_rate`: along a cosine
    (Loshchilov and Hutter 2017) or a line.
    """
    if step < settings.warmup_steps:
        return (step + 1) / settings.warmup_steps
    decay_steps = settings.decay_steps or max(settings.num_steps - settings.warmup_steps, 1)
    done = min(max(step - (settings.num_steps - decay_steps), 0) / decay_steps, 1.0)
    factor = 0.5 * (1 + math.cos(math.pi * done)) if settings.decay == "cosine" else 1 - done
    return settings.final_rate + (1 - settings.final_rate) * factor


class Trainer:
    """One start of a run, and how it ended."""

    def __init__(
        self, config: TrainingConfig, folder: Path, fabric: Fabric, *, resume: bool
    ) -> None:
        self.method, self.settings, self.config = config.method, config.training, config
        self.folder, self.fabric = folder, fabric
        devices.seed_torch(self.settings.seed)
        with files.checked("the networks cannot be built", "change [method]"):
            networks: Any = nn.ModuleDict(self.method.build())
        optimisers = self.method.optimisers(networks)
        self.raw = networks
        average = get_ema_multi_avg_fn(1 - 1 / max(self.settings.average_steps, 1))
        self.average: Any = AveragedModel(
            networks, fabric.device, multi_avg_fn=average, use_buffers=True
        )
        self.networks: dict[str, Any] = {}
        self.optimisers: dict[str, Any] = {}
        self.schedulers: dict[str, LambdaLR] = {}
        for name, optimiser in optimisers.items():
            self.schedulers[name] = LambdaLR(
                optimiser, lambda step: learning_rate_factor(step, self.settings)
            )
            self.networks[name], self.optimisers[name] = fabric.setup(networks[name], optimiser)
        self.identity = {
            "method": config.method_name,
            "settings": asdict(self.method),
            "training": self.settings.decisive,
            "num_devices": fabric.world_size,  # that share the examples of a step
            "data": training_config.describe(config.train),
        }
        self.progress = Progress()
        if (folder / STATE).exists():
            if not resume:
                raise BadData(f"{folder / STATE} exists: give --resume to go on, or another --out")
            self.load()
        fabric.barrier()
        self.loggers: list[Logger] = []
        if fabric.is_global_zero:
            self.loggers = training_log.loggers(folder, self.progress.step)

    @property
    def is_finished(self) -> bool:
        """Return whether all steps are done, or patience is exhausted; False: interrupted."""
        progress, settings = self.progress, self.settings
        misses = (progress.step - progress.best_step) // settings.validate_every
        return progress.step >= settings.num_steps or 0 < settings.patience <= misses

    def fit(self, limit_s: float) -> None:
        """Train from the current step to the end, or to the time limit."""
        items = self.method.examples(self.stored("train"), training=True)
        held_out = self.method.examples(self.stored("validation"), training=False)
        if not len(items) or not len(held_out):
            raise BadData(
                "no clip is long enough for one example: give the data sets a larger num_frames"
            )
        progress, settings = self.progress, self.settings
        batches_left = batches.loader(self.method, items, settings, progress.step, self.fabric)
        validation = batches.validation_loader(self.method, held_out, self.fabric)
        start_s = time.monotonic() - progress.seconds
        end_s, saved_s = progress.seconds + limit_s, progress.seconds
        for batch in tqdm(
            batches_left, total=settings.num_steps, initial=progress.step, disable=not self.loggers
        ):
            if self.is_finished or progress.seconds >= end_s:
                break
            losses = self.train_step(batch)
            progress.seconds = time.monotonic() - start_s
            if progress.step % settings.log_every == 0:
                self.log("train", losses)
            if progress.step % settings.validate_every == 0 or self.is_finished:
                self.validate(validation)
            if progress.seconds > saved_s + settings.save_every_s:
                self.save()
                saved_s = progress.seconds
        self.save()
        if self.is_finished and self.fabric.is_global_zero:
            shutil.rmtree(self.folder / CLIPS, ignore_errors=True)

    def stored(self, split: str) -> list[StoredClip]:
        """Return the prepared clips of a split, which the first process stores for all."""
        key = json.dumps([self.identity["settings"], self.identity["data"], split], default=str)
        folder = self.folder / CLIPS / hashlib.sha256(key.encode()).hexdigest()[:12]
        with self.fabric.rank_zero_first(local=True):
            return stored_clips.store(getattr(self.config, split), self.method.prepare, folder)

    def train_step(self, batch: Batch) -> Losses:
        """Take a step; return the losses, "NETWORK.LOSS" where several networks learn."""
        devices.seed_torch(self.settings.seed, self.progress.step, self.fabric.global_rank)
        self.raw.train()
        losses = self.method.training_step(self.networks, batch, self.progress.step)
        # A gradient scaler skips steps with overflown gradients and lowers the scale
        is_strict = not self.fabric.strategy.precision.state_dict()
        for name, terms in losses.items():
            network, optimiser = self.networks[name], self.optimisers[name]
            optimiser.zero_grad()  # the losses of other networks leave gradients here, too
            self.fabric.backward(terms["total"])
            if max_norm := self.settings.clip_norm:
                self.fabric.clip_gradients(
                    network, optimiser, max_norm=max_norm, error_if_nonfinite=is_strict
                )
            optimiser.step()
        self.average.update_parameters(self.raw)
        for scheduler in self.schedulers.values():
            scheduler.step()
        self.progress.step += 1
        return {
            f"{name}.{term}" if len(self.networks) > 1 else term: loss.detach()
            for name, terms in losses.items()
            for term, loss in terms.items()
        }

    def validate(self, held_out: Iterable[Batch]) -> None:
        """Score the EMA of the networks, and write its weights if they are the best so far."""
        networks = self.average.module.eval()
        torch.manual_seed(0)
        num_examples, totals = 0, defaultdict[str, float](float)
        for batch in held_out:
            size = len(next(iter(batch.values())))
            num_examples += size
            with torch.no_grad():
                numbers = self.method.validation_step(networks, batch)
            for name, number in numbers.items():
                totals[name] += size * float(number)
        scores = {name: total / num_examples for name, total in totals.items()}
        self.log("validation", scores)
        if scores["score"] < self.progress.best_score:
            self.progress.best_score, self.progress.best_step = scores["score"], self.progress.step
            self.write_weights(scores)

    def write_weights(self, scores: Mapping[str, float]) -> None:
        """Write the weights file, from the first process."""
        history = {
            "command": self.config.command,
            "step": self.progress.step,
            "seconds": round(self.progress.seconds, 1),
            "scores": scores,
            "train": self.identity["data"],
            "validation": training_config.describe(self.config.validation),
            "training": self.settings.decisive,
        }
        if self.fabric.is_global_zero:
            file = self.folder / WEIGHTS
            name, network = next(iter(self.average.module.items()))
            checkpoints.write(file, self.config.method_name, self.method, {name: network}, history)

    def state(self) -> dict[str, Any]:
        """Return all that the next step depends on, but random numbers, seeded at every step."""
        state: dict[str, Any] = {
            "precision": self.fabric.strategy.precision,
            "progress": asdict(self.progress),
            "identity": self.identity,
            "average": self.average,
        }
        for name in self.networks:
            state[f"network.{name}"] = self.networks[name]
            state[f"optimiser.{name}"] = self.optimisers[name]
            state[f"scheduler.{name}"] = self.schedulers[name]
        return state

    def save(self) -> None:
        """Write the state, in a way that a kill at any moment leaves a whole file."""
        file = self.folder / STATE
        temporary = file.with_suffix(".tmp")
        with files.checked(f"{file} cannot be written", "make room, or choose another folder"):
            self.fabric.save(temporary, self.state())
            if self.fabric.is_global_zero:
                temporary.replace(file)
        self.fabric.barrier()

    def load(self) -> None:
        """Go on from a stored state; BadData when it is damaged or of another run."""
        file = self.folder / STATE
        with files.checked(f"{file} is not a whole training state", "remove it"):
            stored = self.fabric.load(file, weights_only=True)["identity"]
        if stored != self.identity:
            keys = [key for key, value in self.identity.items() if stored.get(key) != value]
            raise BadData(
                f"{file} belongs to a run with another {', '.join(keys)}: give another --out, "
                "or remove it"
            )
        state = self.state()
        self.fabric.load(file, state, weights_only=True)
        self.progress = Progress(**state["progress"])

    def log(self, split: str, numbers: Mapping[str, float | Tensor]) -> None:
        """Write numbers to the logs, from the first process."""
        row = {f"{split}/{name}": float(number) for name, number in numbers.items()}
        for logger in self.loggers:
            logger.log_metrics({"seconds": self.progress.seconds, **row}, self.progress.step)
            logger.save()
