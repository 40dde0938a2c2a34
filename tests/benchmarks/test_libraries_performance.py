"""The comparison with libraries: our solvers are no less accurate than theirs."""

import re

import pytest

from performance import libraries


@pytest.mark.parametrize(
    "problem", ["triangulation", "resection", "relative_pose", "local_bundle_adjustment"]
)
def test_our_solvers_are_about_as_accurate_or_more(problem: str) -> None:
    comparison = getattr(libraries, problem)(libraries.Scene.random())
    ours, theirs = comparison.error(comparison.ours()), comparison.error(comparison.library())
    assert ours < 1.5 * theirs


def test_a_line_says_times_ratio_and_errors() -> None:
    line = libraries.measure(libraries.resection(libraries.Scene.random()), rounds=2)
    numbers = re.search(r"ours (\S+) ms, library (\S+) ms, ratio (\S+); error \S+ and \S+ m$", line)
    assert numbers is not None
    ours, library, ratio = map(float, numbers.groups())
    assert ratio == pytest.approx(library / ours, rel=0.1)
