"""Seconds and peak memory of the stages of a method; peak memory on Linux only."""

import ctypes
import time
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")


class Usage:
    """Time and memory that work took; its stages follow one another."""

    def __init__(self, steps: dict[Hashable, Any]) -> None:
        self.steps = steps  # results and costs of steps that several methods have in common
        self.seconds: defaultdict[str, float] = defaultdict(float)  # by stage
        self.peak_mb = 0.0  # MiB of the whole process, 0 if unknown

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Measure the work inside; one thread at a time, since a process has one peak."""
        is_reset = reset_peak()
        start_s = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start_s
            if is_reset:
                self.peak_mb = max(self.peak_mb, peak_mb())

    def shared(self, stage: str, key: Hashable, step: Callable[[], Result]) -> Result:
        """Return the result of a step, computed once per stage and key; charge its full cost."""
        if (stage, key) not in self.steps:
            cost = Usage({})
            with cost.measure(stage):
                self.steps[stage, key] = step(), cost
        result, cost = self.steps[stage, key]
        self.seconds[stage] += cost.seconds[stage]
        self.peak_mb = max(self.peak_mb, cost.peak_mb)
        return result


def reset_peak() -> bool:
    """Reset the peak memory of the process to what is resident; return False if impossible."""
    release_free_memory()
    try:
        Path("/proc/self/clear_refs").write_text("5")  # proc_pid_clear_refs(5)
    except OSError:  # not Linux, or not permitted
        return False
    return True


def peak_mb() -> float:
    """Return the peak of resident memory since `reset_peak` in MiB, 0 if unknown."""
    status = Path("/proc/self/status")
    if not status.exists():
        return 0.0
    _, _, peak = status.read_text().partition("VmHWM:")
    return round(int(peak.split()[0]) / 2**10, 1)  # in KiB


def release_free_memory() -> None:
    """Return freed memory to the system, which glibc keeps (malloc_trim(3))."""
    with suppress(OSError, AttributeError):  # another system, or another library
        ctypes.CDLL("libc.so.6").malloc_trim(0)
