"""The speed benchmark of the splat compares like with like."""

import numpy as np

from performance import splat


def test_all_three_draw_the_same_street() -> None:
    scene, poses = splat.street()
    assert len(scene.points_world) == len(scene.cloud) == 3 * 256 * 256
    surface, dots, open3d = (draw(scene, poses[:2]) for draw in splat.RENDERERS.values())
    same = np.abs(dots - open3d) <= 0.01 * open3d
    assert same[open3d > 0].mean() > 0.98  # a point between two pixels may be rounded either way
    both = (surface > 0) & (dots > 0)
    assert both.mean() > 0.7
    assert np.median(np.abs(surface - dots)[both] / surface[both]) < 0.02
    assert (surface > 0).mean() > (dots > 0).mean()  # squares leave no gaps


def test_points_per_second_are_points_times_views_by_median_time() -> None:
    """1000 points, 20 views, 0.2 s."""
    lines = splat.lines({"splat": np.array([[0.5, 0.6], [0.1, 0.3], [0.2, 0.4]])}, 1000)
    assert lines[1] == "splat: 0.1 million points/s, 200 ms, of the processor 400 ms"
