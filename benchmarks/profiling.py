"""Seconds and peak memory of a piece of work; where the system has no peak of its own for it, the process's."""

from __future__ import annotations

import ctypes
import resource
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

CLEAR_REFS = Path("/proc/self/clear_refs")
STATUS = Path("/proc/self/status")
RESET_PEAK = "5"  # sets VmHWM to what is resident now (Linux 4.0 and newer, proc_pid_clear_refs(5))


@dataclass(frozen=True)
class Peak:
    """A maximum of resident memory; everything that the process holds at that moment counts."""

    memory_mb: float  # MiB
    is_own: bool  # of the piece of work alone; otherwise of the process since it began

    @classmethod
    def highest(cls, peaks: Iterable[Peak]) -> Peak:
        """The peak of several pieces of work."""
        known = tuple(peaks)
        return cls(max((peak.memory_mb for peak in known), default=0.0), all(peak.is_own for peak in known))


@dataclass(frozen=True)
class StageProfiler:
    """Seconds and peak memory per stage of one cell; stages follow one another, none lies within another."""

    seconds: dict[str, float] = field(default_factory=dict)
    peaks: dict[str, Peak] = field(default_factory=dict)

    def add(self, stage: str, seconds: float, peak: Peak) -> None:
        """Charge a stage."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self.peaks[stage] = Peak.highest([self.peaks.get(stage, peak), peak])

    def peak_without(self, stage: str) -> Peak:
        """The highest of all other stages."""
        return Peak.highest(peak for other, peak in self.peaks.items() if other != stage)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Charge a stage with what happens inside."""
        was_reset, start_s = reset_peak(), time.perf_counter()
        try:
            yield
        finally:
            self.add(stage, time.perf_counter() - start_s, peak_since(was_reset))


def reset_peak() -> bool:
    """Forget the peak so far, where the system can; whether it did.

    A process has one peak: pieces of work must not lie within one another, nor go on in several threads at once.
    """
    release_free_memory()
    try:
        CLEAR_REFS.write_text(RESET_PEAK)
    except OSError:  # not Linux, or not permitted
        return False
    return True


def peak_since(was_reset: bool) -> Peak:
    """The peak since `reset_peak`, given its answer."""
    high_water_kib = _high_water_kib() if was_reset else None
    if high_water_kib is None:
        return Peak(process_peak_mb(), is_own=False)
    return Peak(round(high_water_kib / 2**10, 1), is_own=True)


def process_peak_mb() -> float:
    """The highest resident memory of this process so far in MiB (getrusage's ru_maxrss)."""
    unit = 2**20 if sys.platform == "darwin" else 2**10  # bytes there, KiB elsewhere
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit, 1)


def release_free_memory() -> None:
    """Return freed memory to the system; glibc keeps it for later (malloc_trim(3))."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def _high_water_kib() -> int | None:
    """VmHWM; None where the system does not say."""
    try:
        lines = STATUS.read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), None)
