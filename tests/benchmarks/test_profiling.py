"""Peak memory is that of a stage where the system can tell, and unknown elsewhere."""

import sys

import numpy as np
import pytest

from geovp_benchmarks.running import profiling
from geovp_benchmarks.running.built_matrix import Cache
from geovp_benchmarks.running.profiling import StageProfiler

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
def test_a_cached_result_keeps_its_peak_and_metrics_are_left_out() -> None:
    cache, profilers = Cache(), (StageProfiler(), StageProfiler(), StageProfiler())
    for profiler in profilers[:2]:
        cache.get_or_compute("scene", lambda: hold(LARGE_MB), profiler, "reconstruct")
    with profilers[2].measure("metrics"):
        hold(LARGE_MB)
    for profiler in profilers:
        with profiler.measure("view"):
            hold(1)
    first, second, third = (profiler.peak_without("metrics") for profiler in profilers)
    assert first == pytest.approx(second, abs=20)  # made for the first, charged to both
    assert second - third == pytest.approx(LARGE_MB - 1, abs=20)
    assert profilers[2].peaks_mb["metrics"] - third == pytest.approx(LARGE_MB - 1, abs=20)
