"""Batches of training examples, which depend on seed and step alone."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from lightning.fabric import Fabric
from torch.utils.data import DataLoader, Dataset, default_collate

from geovp_learned.methods import Batch, Method
from geovp_learned.training_config import Training

VALIDATION_BATCH = 8


class Examples(Dataset[Batch]):
    """All examples of a training, in the order of its steps, augmented when they are read.

    Each epoch has another permutation, and batches may span two epochs.
    """

    def __init__(self, method: Method, items: Sequence[Any], seed: int, per_step: int) -> None:
        self.method, self.items, self.seed, self.per_step = method, items, seed, per_step

    def __getitem__(self, number: int) -> Batch:
        """Return tensors of an example."""
        epoch, position = divmod(number, len(self.items))
        order = np.random.default_rng([self.seed, epoch]).permutation(len(self.items))
        rng = np.random.default_rng([self.seed, *divmod(number, self.per_step)])
        return self.method.example(self.items[order[position]], rng)


def loader(
    method: Method, items: Sequence[Any], settings: Training, first_step: int, fabric: Fabric
) -> Any:
    """Return this device's batches of the remaining steps, prepared ahead by workers if any.

    Devices take turns in the examples of a step.
    """
    num_devices = fabric.world_size
    per_step = settings.batch_size * num_devices
    first, end = first_step * per_step + fabric.global_rank, settings.num_steps * per_step
    loader = DataLoader(
        Examples(method, items, settings.seed, per_step),
        settings.batch_size,
        sampler=range(first, end, num_devices),
        num_workers=settings.num_workers,
        # a forked worker would hang in the pools of threads of OpenCV and Numba
        multiprocessing_context="forkserver" if settings.num_workers else None,
        worker_init_fn=_use_one_thread,
        pin_memory=fabric.device.type == "cuda",
    )
    return fabric.setup_dataloaders(loader, use_distributed_sampler=False)


def validation_loader(method: Method, items: Sequence[Any], fabric: Fabric) -> Any:
    """Return the batches of validation."""

    def collate(some: list[Any]) -> Batch:
        return default_collate([method.validation_example(item) for item in some])

    loader: DataLoader[Any] = DataLoader(items, VALIDATION_BATCH, collate_fn=collate)  # type: ignore[arg-type]
    return fabric.setup_dataloaders(loader, use_distributed_sampler=False)


def _use_one_thread(_: int) -> None:
    """Leave the cores to the other workers."""
    cv2.setNumThreads(1)
