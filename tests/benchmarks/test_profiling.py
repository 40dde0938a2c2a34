"""Peak memory is that of a stage where the system can tell, and unknown elsewhere."""

import sys
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.running.profiling import Usage

LARGE_MB = 300


def hold(megabytes: int) -> int:
    """Take so much memory, every page of it, and let it go."""
    return int(np.ones(megabytes * 2**20, np.uint8)[-1])


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux forgets the peak of a process")
def test_each_method_is_charged_what_it_would_have_cost_alone() -> None:
    """The first two share a step with a large peak, which is computed once."""
    steps: dict[Any, Any] = {}
    usages, calls = (Usage(steps), Usage(steps), Usage(steps)), []
    for usage in usages[:2]:
        usage.shared("reconstruct", (), lambda: calls.append(hold(LARGE_MB)))
    assert len(calls) == 1
    assert usages[0].seconds == usages[1].seconds
    for usage in usages:
        with usage.measure("view"):
            hold(1)
    first, second, third = (usage.peak_mb for usage in usages)
    assert first == pytest.approx(second, abs=20)
    assert second - third == pytest.approx(LARGE_MB - 1, abs=20)
