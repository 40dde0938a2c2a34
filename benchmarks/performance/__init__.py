"""Measurements of speed, to be run by hand on a quiet machine; no test asserts them.

The package is not installed: run it from the repository root with `benchmarks` on the path, as
`PYTHONPATH=benchmarks python -m performance`.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geovp_classic.parallel import single_threaded_blas


@dataclass(frozen=True)
class Comparison:
    """One problem, solved by our code and by a rival."""

    name: str
    ours: Callable[[], Any]
    rival_name: str
    rival: Callable[[], Any]
    error: Callable[[Any], float] | None = None  # of a solution, against the truth
    unit: str = ""  # of the error

    @single_threaded_blas
    def line(self, rounds: int) -> str:
        """Return the medians of both, timed in turns after a warm-up, their ratio, and errors."""
        seconds = [[cpu_s(self.ours), cpu_s(self.rival)] for _ in range(rounds + 1)]
        ours_s, rival_s = np.median(seconds[1:], axis=0)
        line = (
            f"{self.name}: {1e3 * ours_s:.3g} ms, {self.rival_name} {1e3 * rival_s:.3g} ms, "
            f"ratio {rival_s / ours_s:.1f}"
        )
        if self.error is not None:
            errors = [self.error(solve()) for solve in (self.ours, self.rival)]
            line += f"; errors {errors[0]:.2g} and {errors[1]:.2g} {self.unit}"
        return line


def cpu_s(work: Callable[[], Any]) -> float:
    """Return the CPU time of the work in all threads, which depends little on other load."""
    start_s = time.process_time()
    work()
    return time.process_time() - start_s
