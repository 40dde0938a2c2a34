"""Window of keyframes that observe known points."""

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.odometry.windowed_map import KeyframePolicy, WindowedMap
from geovp_classic.types import FloatArray
from tests.geovp_classic.odometry.known_points import CAMERA, path, project, scene


def filled() -> tuple[WindowedMap, FloatArray]:
    """Return a window of the last three of five keyframes, and the true points [N, 3]."""
    points = scene()
    window = WindowedMap(CAMERA, 0.25, KeyframePolicy(window=3))
    for index, pose in enumerate(path(5)):
        if index:
            window.pixels[:] = project(points, pose)
        window.add_keyframe(pose)
        if index == 0:
            window.add_tracks(project(points, pose))
        window.triangulate()
    return window, points


def test_the_map_triangulates_points_and_keeps_a_window_of_keyframes() -> None:
    window, points = filled()
    np.testing.assert_allclose(window.cam_from_world, path(5)[2:])
    assert window.observations.shape == (3, 120, 2)
    known = window.triangulated
    assert known.mean() > 0.9
    np.testing.assert_allclose(window.points[known], points[known], rtol=1e-4, atol=1e-4)


def test_the_map_predicts_where_points_appear() -> None:
    window, points = filled()
    ahead = se3.exp(np.array([0, 0, -3.0, 0, 0.03, 0]))
    predicted = window.predict_pixels(path(5)[-1], ahead)
    known = window.triangulated
    np.testing.assert_allclose(predicted[known], project(points, ahead)[known], atol=0.05)
    # points without depth are as far as their neighbours: better than no prediction
    window.points[::4] = np.nan
    guessed = window.predict_pixels(path(5)[-1], ahead)[::4]
    truth = project(points, ahead)[::4]
    error_px = np.median(np.linalg.norm(guessed - truth, axis=1))
    assert error_px < np.median(np.linalg.norm(window.pixels[::4] - truth, axis=1))


def test_points_behind_the_new_camera_are_expected_where_they_were() -> None:
    window, _ = filled()
    beyond = se3.exp(np.array([0, 0, -100.0, 0, 0, 0]))
    known = window.triangulated
    predicted = window.predict_pixels(path(5)[-1], beyond)
    np.testing.assert_array_equal(predicted[known], window.pixels[known])


def test_outliers_are_culled() -> None:
    window, _ = filled()
    window.observations[1:, 0] += 40
    window.cull()
    assert not window.triangulated[0]
    assert not window.active[0]
    assert window.triangulated[1:].mean() > 0.9


def test_ended_tracks_leave_with_their_points() -> None:
    window, _ = filled()
    window.pixels[::2] = np.nan
    ids = window.track_ids.copy()
    window.keep_newest_only()
    window.add_keyframe(path(6)[-1])
    np.testing.assert_array_equal(window.track_ids, ids[1::2])
