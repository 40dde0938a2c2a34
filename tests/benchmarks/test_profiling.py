"""The peak of memory is that of a piece of work where the system can tell, and of the process elsewhere."""

import resource
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import profiling
from benchmarks.caching import Cache
from benchmarks.profiling import Peak, StageProfiler

LARGE_MB = 300
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forgets the peak of a process")


def hold(megabytes: int) -> int:
    """Take so much memory, every page of it, and let it go."""
    return int(np.ones(megabytes * 2**20, np.uint8)[-1])


def peak_of(megabytes: int) -> Peak:
    begun = profiling.reset_peak()
    hold(megabytes)
    return profiling.peak_since(begun)


@on_linux
def test_a_small_piece_of_work_is_not_charged_with_the_large_one_before_it() -> None:
    small_before, large, small = (peak_of(megabytes) for megabytes in (1, LARGE_MB, 1))
    assert (large.is_own, small.is_own) == (True, True)
    assert large.memory_mb - small.memory_mb == pytest.approx(LARGE_MB - 1, abs=20)
    assert small.memory_mb == pytest.approx(small_before.memory_mb, abs=20)


@on_linux
def test_the_process_itself_is_in_the_peak() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    assert peak_of(1).memory_mb == pytest.approx(pages * resource.getpagesize() / 2**20, abs=20)


@pytest.mark.parametrize("name", ["CLEAR_REFS", "STATUS"])
def test_elsewhere_it_is_the_processs_maximum(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(profiling, name, tmp_path / "proc" / "nowhere")
    if name == "STATUS":
        monkeypatch.setattr(profiling, "CLEAR_REFS", tmp_path / "accepts-anything")
    large, small = peak_of(LARGE_MB), peak_of(1)
    assert (large.is_own, small.is_own) == (False, False)
    assert small.memory_mb >= large.memory_mb > LARGE_MB
    assert small.memory_mb == profiling.process_peak_mb()


def test_a_status_without_the_peak_is_no_status(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(profiling, "STATUS", tmp_path / "status")
    profiling.STATUS.write_text("Name:\tpython\nVmRSS:\t    1024 kB\n")
    assert not profiling.peak_since(was_reset=True).is_own
    profiling.STATUS.write_text("Name:\tpython\nVmHWM:\t    2048 kB\nVmRSS:\t    1024 kB\n")
    assert profiling.peak_since(was_reset=True) == Peak(2.0, is_own=True)


def test_pieces_together_have_the_highest_peak_and_own_it_when_all_do() -> None:
    assert Peak.highest([Peak(3.0, is_own=True), Peak(5.0, is_own=True)]) == Peak(5.0, is_own=True)
    assert Peak.highest([Peak(3.0, is_own=False), Peak(5.0, is_own=True)]) == Peak(5.0, is_own=False)
    assert Peak.highest([]).memory_mb == 0.0


@on_linux
def test_what_is_remembered_keeps_its_peak_and_metrics_are_left_out() -> None:
    memory, watches = Cache(), (StageProfiler(), StageProfiler(), StageProfiler())
    for watch in watches[:2]:
        memory.get_or_compute("scene", lambda: hold(LARGE_MB), watch, "reconstruct")
    with watches[2].measure("metrics"):
        hold(LARGE_MB)
    for watch in watches:
        with watch.measure("view"):
            hold(1)
    first, second, third = (watch.peak_without("metrics").memory_mb for watch in watches)
    assert first == pytest.approx(second, abs=20)  # made for the first, charged to both
    assert second - third == pytest.approx(LARGE_MB - 1, abs=20)
    assert watches[2].peaks["metrics"].memory_mb - third == pytest.approx(LARGE_MB - 1, abs=20)
