"""Measurements of speed: they run the real components, and compare like with like."""

import numpy as np
import pytest

from performance import Comparison, libraries, live, splat


def test_a_live_frame_is_the_sum_of_its_stages() -> None:
    *stages, whole, _ = (line.split() for line in live.lines(2, None, num_warm_up=8))
    names = ["observe", "track", "scale", "scene", "forecast", "hindcast", "view"]
    assert [name for name, *_ in stages] == names
    # The median of two frames is their mean; rounding adds up to 0.4 ms.
    assert 0 < sum(float(line[1]) for line in stages) <= float(whole[1]) + 0.4


@pytest.mark.parametrize("problem", libraries.problems(), ids=lambda problem: problem.name)
def test_our_solvers_are_about_as_accurate_as_those_of_libraries(
    problem: Comparison,
) -> None:
    ours, rival = (problem.error(solve()) for solve in (problem.ours, problem.rival))
    assert ours < 1.5 * rival


def test_both_renderers_draw_the_same_street() -> None:
    comparison = splat.comparison(num_views=2)
    surface, dots = np.array(comparison.ours()), np.array(comparison.rival())
    both = (surface > 0) & (dots > 0)
    assert both.mean() > 0.7
    assert np.median(np.abs(surface - dots)[both] / surface[both]) < 0.02
    assert (surface > 0).mean() > (dots > 0).mean()  # squares leave no gaps
