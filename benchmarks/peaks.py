"""The highest resident memory of this process during a piece of work; where the system cannot tell, since it began."""

from __future__ import annotations

import ctypes
import resource
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

CLEAR_REFS = Path("/proc/self/clear_refs")
STATUS = Path("/proc/self/status")
FORGET_PEAK = "5"  # sets VmHWM to what is resident now (Linux 4.0 and newer, proc_pid_clear_refs(5))


@dataclass(frozen=True)
class Peak:
    """A maximum of resident memory; all that the process holds at that moment is in it, whoever asked for it."""

    memory_mb: float  # MiB
    is_own: bool  # of the piece of work alone; otherwise of the process since it began

    @classmethod
    def highest(cls, peaks: Iterable[Peak]) -> Peak:
        """The peak of several pieces of work."""
        known = tuple(peaks)
        return cls(max((peak.memory_mb for peak in known), default=0.0), all(peak.is_own for peak in known))


def begin() -> bool:
    """Forget the peak so far, where the system can; whether it did.

    A process has one peak: pieces of work must not lie within one another, nor go on in several threads at once.
    """
    give_back_free_memory()
    try:
        CLEAR_REFS.write_text(FORGET_PEAK)
    except OSError:  # not Linux, or not permitted
        return False
    return True


def reached(begun: bool) -> Peak:
    """The peak since `begin`, given its answer."""
    since_kib = _high_water_kib() if begun else None
    if since_kib is None:
        return Peak(process_peak_mb(), is_own=False)
    return Peak(round(since_kib / 2**10, 1), is_own=True)


def process_peak_mb() -> float:
    """The highest resident memory of this process so far in MiB (getrusage's ru_maxrss)."""
    unit = 2**20 if sys.platform == "darwin" else 2**10  # bytes there, KiB elsewhere
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit, 1)


def give_back_free_memory() -> None:
    """Let the system have what earlier work has let go; glibc keeps it for later (malloc_trim(3))."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def _high_water_kib() -> int | None:
    """VmHWM, None where it is not told."""
    try:
        lines = STATUS.read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), None)
