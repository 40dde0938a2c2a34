"""Coming poses keep their height above the road that the last image shows."""

from __future__ import annotations

import numpy as np
import pytest

from geovp_classic.geometry import pinhole, se3
from geovp_classic.geometry.ground_plane import GroundPlane
from geovp_classic.pose_refinement import road_height
from geovp_classic.pose_refinement.road_height import STEEPEST, WEIGHT, RoadProfile
from geovp_classic.types import FloatArray, Intrinsics

CAMERA = Intrinsics(200, 200, 127.5, 99.5, 256, 200)
HEIGHT_M = 1.65
LEVEL = GroundPlane(np.array([0.0, 1.0, 0.0]), HEIGHT_M)


def road(slope: float = 0.0, unit_m: float = 1.0) -> RoadProfile:
    """A road that falls by a slope from under the camera on, as found by a plane that does not
    quite fit it.
    """
    rays = pinhole.rays(CAMERA)
    falling = np.array([0.0, 1.0, -slope])
    inverse_depth = np.maximum(rays @ falling * unit_m / HEIGHT_M, 0)
    return RoadProfile.of(inverse_depth, CAMERA, GroundPlane(LEVEL.normal, LEVEL.height / unit_m))


def ahead(climb: float = 0.0, unit_m: float = 1.0, turn_rad: float = 0.0) -> FloatArray:
    """Twenty poses [F, 4, 4], a metre apart, that climb by a share of the way."""
    return se3.exp(
        np.arange(1, 21)[:, None] * np.array([0, -climb / unit_m, 1 / unit_m, 0, turn_rad, 0])
    )


@pytest.mark.parametrize("unit_m", [1.0, 0.2, 30.0])
@pytest.mark.parametrize("turn_rad", [0.0, 0.01, -0.02])
def test_a_camera_that_climbs_above_a_level_road_is_brought_down(
    unit_m: float, turn_rad: float
) -> None:
    given = ahead(0.01, unit_m, turn_rad)
    corrected = road(unit_m=unit_m).correct_heights(given)
    down = (corrected - given)[:, 1, 3] * unit_m
    np.testing.assert_allclose(down[9::10], WEIGHT * 0.01 * np.array([10, 20]), rtol=0.1)
    np.testing.assert_array_equal(corrected[:, [0, 2], 3], given[:, [0, 2], 3])
    np.testing.assert_array_equal(corrected[:, :3, :3], given[:, :3, :3])


def test_one_that_follows_a_falling_road_stays() -> None:
    given = ahead(-0.01)
    assert abs(road(0.01).slope(given[:, :3, 3])) < 2e-4
    assert road(0.01).slope(ahead(0.0)[:, :3, 3]) == pytest.approx(0.01, abs=2e-4)


def test_what_stands_beside_the_way_and_outliers_don_t_count() -> None:
    path = ahead(0.01)[:, :3, 3]
    seen = road()
    bumpy = seen.points.copy()
    bumpy[np.abs(seen.points[:, 0]) > road_height.CORRIDOR, 1] -= 0.2
    bumpy[(seen.points[:, 2] > 4) & (seen.points[:, 2] < 5), 1] -= 0.05
    assert RoadProfile(seen.ground, bumpy).slope(path) == pytest.approx(seen.slope(path), abs=1e-3)


def test_no_slope_is_believed_beyond_the_steepest() -> None:
    assert road().slope(ahead(0.1)[:, :3, 3]) == STEEPEST


@pytest.mark.parametrize(
    "path",
    [
        np.zeros((3, 3)),
        ahead()[:, :3, 3] * -1,
        ahead()[:, :3, 3] * [1, 1, 0],
        np.zeros((0, 3)),
        np.ones((1, 3)) * 1e-9,
    ],
    ids=["standing", "backward", "on the spot", "none", "hardly"],
)
def test_ways_that_lead_over_no_road_in_sight_are_left_alone(path: FloatArray) -> None:
    poses = se3.compose(np.eye(3), path)
    corrected = road().correct_heights(poses)
    assert np.isfinite(corrected).all()
    np.testing.assert_allclose(corrected, poses, atol=1e-6)


def test_without_a_road_in_sight_poses_stay() -> None:
    wall = RoadProfile.of(np.full((200, 256), 0.1), CAMERA, LEVEL)
    given = ahead(0.01)
    np.testing.assert_array_equal(wall.correct_heights(given), given)
