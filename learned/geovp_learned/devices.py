"""The device that a network computes on: "cpu", "cuda", "cuda:1", or "auto", a GPU where there is
one.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
import torch

from geovp_classic.errors import BadData

Task = TypeVar("Task")
Result = TypeVar("Result")


def resolved(device: str) -> str:
    """Resolve "auto" to a device; raise BadData for an unknown device or one that this machine
    lacks.
    """
    if device == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        given = f"device {device!r} cannot be used ({str(error).splitlines()[0]})"
        raise BadData(f"{given}: give 'cpu' or 'auto', or 'cuda' where there is a GPU") from error
    return device


def described(device: str) -> str:
    """Describe the device in words, such as "cuda:0 (NVIDIA A100)"."""
    return (
        f"{device} ({torch.cuda.get_device_name(device)})" if device.startswith("cuda") else device
    )


def seed_torch(*numbers: int) -> None:
    """Set the seed of torch's random numbers on every device."""
    torch.manual_seed(int(np.random.SeedSequence(numbers).generate_state(1)[0]))


@contextmanager
def one_thread() -> Iterator[None]:
    """Let torch compute on one thread of the CPU: sums of several threads differ in their last
    bits.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def on_one_thread_each(work: Callable[[Task], Result], tasks: Iterable[Task]) -> list[Result]:
    """Return the results of the tasks, each computed on one thread of the CPU, as many at once as
    torch may use threads.

    Threads that share a layer's work wait for one another after every layer, which on a busy
    machine takes longer than the work.
    """
    from geovp_classic.parallel import parallel_map  # not above: training needs no numba

    if torch.get_num_threads() == 1:
        return [work(task) for task in tasks]

    def on_one_thread(task: Task) -> Result:
        torch.set_num_threads(1)  # of the thread that calls it
        return work(task)

    with one_thread():
        return parallel_map(on_one_thread, tasks)
