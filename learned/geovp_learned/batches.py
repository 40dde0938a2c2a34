"""Batches of training examples: a data set, and a sampler that depends on seed and step alone."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import cv2
import numpy as np
from lightning.fabric import Fabric
from torch.utils.data import DataLoader, Dataset, Sampler

from geovp_learned.methods import Batch, Method
from geovp_learned.training_config import Training

Draw = tuple[int, tuple[int, ...]]  # the number of an example, and the seed of its augmentation


class Examples(Dataset[Batch]):
    """Training examples in memory, augmented when they are read."""

    def __init__(self, method: Method, items: Sequence[Any]) -> None:
        self.method, self.items = method, items

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, draw: Draw) -> Batch:
        """Return tensors of the drawn example."""
        index, seed = draw
        return self.method.example(self.items[index], np.random.default_rng(seed))


class StepSampler(Sampler[list[Draw]]):
    """One device's batches from a step on, so that a resumed run gets the same ones.

    Each epoch has another permutation, and batches may span two epochs.
    """

    def __init__(
        self, num_examples: int, settings: Training, first_step: int, rank: int, num_devices: int
    ) -> None:
        self.num_examples, self.settings, self.first_step = num_examples, settings, first_step
        self.rank, self.num_devices = rank, num_devices

    def __len__(self) -> int:
        return self.settings.num_steps - self.first_step

    def __iter__(self) -> Iterator[list[Draw]]:
        """Draw the batch of each step."""
        for step in range(self.first_step, self.settings.num_steps):
            yield self.batch(step)

    def batch(self, step: int) -> list[Draw]:
        """Draw the batch of a step; devices take turns in the permutation."""
        seed, size = self.settings.seed, self.settings.batch_size
        draws: list[Draw] = []
        for slot in range(self.rank, size * self.num_devices, self.num_devices):
            epoch, position = divmod(step * size * self.num_devices + slot, self.num_examples)
            order = np.random.default_rng([seed, epoch]).permutation(self.num_examples)
            draws.append((int(order[position]), (seed, step, slot)))
        return draws


def loader(
    method: Method, items: Sequence[Any], settings: Training, first_step: int, fabric: Fabric
) -> Iterable[Batch]:
    """Return this device's batches of the remaining steps, prepared ahead by workers if any."""
    rank, num_devices = fabric.global_rank, fabric.world_size
    loader: DataLoader[Batch] = DataLoader(
        Examples(method, items),
        batch_sampler=StepSampler(len(items), settings, first_step, rank, num_devices),
        num_workers=settings.num_workers,
        # a forked worker would hang in the pools of threads of OpenCV and Numba
        multiprocessing_context="forkserver" if settings.num_workers else None,
        worker_init_fn=_use_one_thread,
        pin_memory=fabric.device.type == "cuda",
    )
    on_device: Any = fabric.setup_dataloaders(loader, use_distributed_sampler=False)
    return on_device


def _use_one_thread(_: int) -> None:
    """Leave the cores to the other workers."""
    cv2.setNumThreads(1)
