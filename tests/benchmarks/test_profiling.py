"""Peak memory is that of a stage where the system can tell, and unknown elsewhere."""

import sys

import numpy as np
import pytest

from geovp_benchmarks.running import profiling
from geovp_benchmarks.running.profiling import Usage
from geovp_benchmarks.running.task import SharedSteps

LARGE_MB = 300
on_linux = pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux forgets the peak of a process"
)


def hold(megabytes: int) -> int:
    """Take so much memory, every page of it, and let it go."""
    return int(np.ones(megabytes * 2**20, np.uint8)[-1])


def peak_of(megabytes: int) -> float:
    assert profiling.reset_peak()
    hold(megabytes)
    return profiling.peak_mb()


@on_linux
def test_a_small_piece_of_work_is_not_charged_with_the_large_one_before_it() -> None:
    small_before, large, small = (peak_of(megabytes) for megabytes in (1, LARGE_MB, 1))
    assert large - small == pytest.approx(LARGE_MB - 1, abs=20)
    assert small == pytest.approx(small_before, abs=20)


@on_linux
def test_a_shared_step_keeps_its_peak() -> None:
    shared, usages = SharedSteps(), (Usage(), Usage(), Usage())
    for usage in usages[:2]:
        shared.get(usage, "reconstruct", (), lambda: hold(LARGE_MB))
    for usage in usages:
        with usage.measure("view"):
            hold(1)
    first, second, third = (usage.peak_mb for usage in usages)
    assert first == pytest.approx(second, abs=20)  # made for the first, charged to both
    assert second - third == pytest.approx(LARGE_MB - 1, abs=20)
