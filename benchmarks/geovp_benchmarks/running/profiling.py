"""Seconds and peak memory of the stages of a method; peak memory on Linux only."""

import ctypes
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

CLEAR_REFS = Path("/proc/self/clear_refs")
STATUS = Path("/proc/self/status")
RESET_PEAK = "5"  # sets VmHWM to what is resident now (Linux 4.0 and newer, proc_pid_clear_refs(5))


@dataclass(frozen=True)
class StageProfiler:
    """Seconds and peak memory per stage of one method; stages follow one another and are never
    nested.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    peaks_mb: dict[str, float] = field(
        default_factory=dict
    )  # MiB of the whole process; 0 where unknown

    def add(self, stage: str, seconds: float, peak_mb: float) -> None:
        """Charge a stage."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self.peaks_mb[stage] = max(self.peaks_mb.get(stage, 0.0), peak_mb)

    def peak_without(self, stage: str) -> float:
        """The highest peak of all other stages in MiB."""
        return max(
            (peak_mb for other, peak_mb in self.peaks_mb.items() if other != stage), default=0.0
        )

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Charge a stage for the work inside; only one thread at a time may do so, a process has
        one peak.
        """
        was_reset, start_s = reset_peak(), time.perf_counter()
        try:
            yield
        finally:
            self.add(stage, time.perf_counter() - start_s, peak_mb() if was_reset else 0.0)


def reset_peak() -> bool:
    """Reset the process's peak memory to what is resident now; whether the system could."""
    release_free_memory()
    try:
        CLEAR_REFS.write_text(RESET_PEAK)
    except OSError:  # not Linux, or not permitted
        return False
    return True


def peak_mb() -> float:
    """The peak of resident memory since `reset_peak` in MiB (VmHWM); 0 where the system does not
    say.
    """
    lines = STATUS.read_text().splitlines() if STATUS.exists() else []
    kib = next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), 0)
    return round(kib / 2**10, 1)


def release_free_memory() -> None:
    """Return freed memory to the system; glibc keeps it for later (malloc_trim(3))."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
