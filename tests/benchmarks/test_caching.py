"""Steps that methods share are computed once, and each method is charged their cost."""

from geovp_benchmarks.running.profiling import Usage
from geovp_benchmarks.running.task import SharedSteps


def test_each_method_is_charged_what_it_would_have_cost_alone() -> None:
    shared, usages, calls = SharedSteps(), [Usage(), Usage()], []
    for usage in usages:
        assert shared.get(usage, "motion", "source", lambda: calls.append(0) or 7) == 7
    assert len(calls) == 1
    assert usages[0].seconds == usages[1].seconds
    assert usages[0].seconds["motion"] > 0
