"""Future poses keep their height above the road that the last image shows."""

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.pose_refinement.road_height import RoadProfile
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(200, 200, 127.5, 99.5, 256, 200)
HEIGHT_M = 1.65
PROFILE = RoadProfile()


def ground(unit_m: float = 1.0) -> GroundPlane:
    return GroundPlane(np.array([0.0, 1.0, 0.0]), HEIGHT_M / unit_m)


def road(slope: float = 0.0, unit_m: float = 1.0) -> FloatArray:
    """Return points of a road that falls by a slope, fitted by a level plane."""
    falling = np.array([0.0, 1.0, -slope])
    inverse_depth = np.maximum(pinhole.rays(CAMERA) @ falling * unit_m / HEIGHT_M, 0)
    return PROFILE.points(inverse_depth, CAMERA, ground(unit_m))


def ahead(climb: float = 0.0, unit_m: float = 1.0, turn_rad: float = 0.0) -> FloatArray:
    """Return twenty poses [F, 4, 4], a metre apart, that climb by a fraction of the path."""
    step = np.array([0, -climb / unit_m, 1 / unit_m, 0, turn_rad, 0])
    return se3.exp(np.arange(1, 21)[:, None] * step)


def slope(points: FloatArray, poses: FloatArray) -> float:
    return PROFILE.slope(poses[:, :3, 3], points, ground())


@pytest.mark.parametrize("unit_m", [0.2, 1.0, 30.0])
@pytest.mark.parametrize("turn_rad", [0.0, 0.01, -0.02])
def test_a_camera_that_climbs_above_a_level_road_is_lowered(unit_m: float, turn_rad: float) -> None:
    given = ahead(0.01, unit_m, turn_rad)
    corrected = PROFILE.correct_heights(given, road(unit_m=unit_m), ground(unit_m))
    down_m = (corrected - given)[:, 1, 3] * unit_m
    expected_m = PROFILE.weight * 0.01 * np.array([10, 20])
    np.testing.assert_allclose(down_m[9::10], expected_m, rtol=0.1)
    np.testing.assert_array_equal(corrected[:, [0, 2]], given[:, [0, 2]])


def test_a_path_along_a_falling_road_stays() -> None:
    assert abs(slope(road(0.01), ahead(-0.01))) < 2e-4
    assert slope(road(0.01), ahead(0.0)) == pytest.approx(0.01, abs=2e-4)


def test_surroundings_and_outliers_do_not_count() -> None:
    points = road()
    bumpy = points.copy()
    bumpy[np.abs(points[:, 0]) > PROFILE.corridor_heights, 1] -= 0.2
    bumpy[(points[:, 2] > 4) & (points[:, 2] < 5), 1] -= 0.05
    assert slope(bumpy, ahead(0.01)) == pytest.approx(slope(points, ahead(0.01)), abs=1e-3)


def test_slopes_are_limited() -> None:
    assert slope(road(), ahead(0.1)) == PROFILE.max_slope


@pytest.mark.parametrize(
    "path",
    [
        np.zeros((3, 3)),
        ahead()[:, :3, 3] * -1,
        ahead()[:, :3, 3] * [1, 1, 0],
        np.zeros((0, 3)),
        np.ones((1, 3)) * 1e-9,
    ],
    ids=["stationary", "backward", "on the spot", "none", "hardly"],
)
def test_paths_that_leave_the_visible_road_stay(path: FloatArray) -> None:
    poses = se3.compose(np.eye(3), path)
    corrected = PROFILE.correct_heights(poses, road(), ground())
    np.testing.assert_allclose(corrected, poses, atol=1e-6)


def test_poses_stay_without_a_visible_road() -> None:
    wall = PROFILE.points(np.full((200, 256), 0.1), CAMERA, ground())
    given = ahead(0.01)
    np.testing.assert_array_equal(PROFILE.correct_heights(given, wall, ground()), given)
