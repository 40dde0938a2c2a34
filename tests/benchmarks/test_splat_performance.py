"""The speed benchmark of the splat compares like with like."""

import numpy as np
import pytest

from benchmarks.performance import splat


def test_all_three_draw_the_same_street() -> None:
    scene, poses = splat.street()
    assert len(scene.points_world) == len(scene.cloud) == 3 * 256 * 256
    surface, dots, open3d = (draw(scene, poses[:2]) for draw in splat.WAYS.values())
    same = np.abs(dots - open3d) <= 0.01 * open3d
    assert same[open3d > 0].mean() > 0.98  # a point between two pixels may be rounded either way
    both = (surface > 0) & (dots > 0)
    assert both.mean() > 0.7
    assert np.median(np.abs(surface - dots)[both] / surface[both]) < 0.02
    assert (surface > 0).mean() > (dots > 0).mean()  # squares leave no gaps


def test_points_a_second_are_points_times_views_by_median_time() -> None:
    timing = splat.Timing(1000, {"splat": np.array([[0.5, 0.6], [0.1, 0.3], [0.2, 0.4]])}, (3.0, 1.0))
    assert timing.points_per_s("splat") == pytest.approx(1000 * 20 / 0.2)
    assert timing.lines()[1] == "splat: 0.1 million points/s, 200 ms, of the processor 400 ms"
    assert timing.lines()[-1].endswith("process: 3.0 s, of the next one 1.00 s")
