"""Metric scale from the camera's height above the road, and from a prior of speeds."""

import numpy as np
import pytest

from geovp_classic import interfaces
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.odometry.ground_plane_scale import GroundPlane
from geovp_classic.types import ByteArray, FloatArray
from geovp_classic.types.speed_prior import SpeedPrior
from tests.geovp_classic.odometry.corridor import CAMERA, STRAIGHT, drive


def show(
    estimator: interfaces.ScaleEstimator, frames: ByteArray, poses: FloatArray, unit_m: float = 1.0
) -> None:
    """Update an estimator with all neighbouring images, with lengths in units of `unit_m`."""
    for i in range(1, len(poses)):
        before_from_now = se3.inverse(poses[i - 1]) @ poses[i]
        before_from_now[:3, 3] /= unit_m
        estimator.update(frames[i - 1, ..., 0], frames[i, ..., 0], before_from_now)
    estimator.finalize(length=0.0, duration_s=1.0)


@pytest.mark.parametrize("unit_m", [0.1, 1.0, 3.0])
def test_any_unit_is_estimated(unit_m: float) -> None:
    estimator = GroundPlane().estimator(CAMERA, 1.65)
    assert estimator.uncertainty == np.inf
    show(estimator, *STRAIGHT, unit_m)
    assert estimator.unit == pytest.approx(unit_m, rel=0.03)
    assert estimator.uncertainty < 0.06


def test_pitch_and_roll_are_estimated() -> None:
    tilt = np.radians(1.5)  # looking up
    ahead = [0, 0.5 * np.sin(tilt), 0.5 * np.cos(tilt), 0, 0, 0]
    frames, poses = drive(np.array([[0, 0, 0, tilt, 0, 0], *[ahead] * 9]))
    estimator = GroundPlane().estimator(CAMERA, 1.65)
    show(estimator, frames[1:], poses[1:])
    assert estimator.unit == pytest.approx(1.0, rel=0.03)
    assert np.degrees(estimator.pitch_rad) == pytest.approx(1.5, abs=0.5)
    assert np.degrees(estimator.roll_rad) == pytest.approx(0, abs=0.5)


def test_a_restart_changes_the_unit_but_not_the_tilt() -> None:
    estimator = GroundPlane().estimator(CAMERA, 1.65)
    show(estimator, *STRAIGHT)
    pitch_rad = estimator.pitch_rad
    estimator.restart()
    assert estimator.pitch_rad == pitch_rad
    show(estimator, *STRAIGHT, unit_m=0.5)
    first, second = np.split(estimator.units, 2)
    np.testing.assert_allclose(first, 1.0, rtol=0.03)
    np.testing.assert_allclose(second, 0.5, rtol=0.03)


def test_a_blank_or_stationary_road_is_uninformative() -> None:
    frames, poses = STRAIGHT
    estimator = GroundPlane().estimator(CAMERA, 1.65)
    show(estimator, np.full_like(frames, 90), poses)
    show(estimator, frames, np.tile(np.eye(4), (len(poses), 1, 1)))
    assert (estimator.unit, estimator.uncertainty) == (1.0, np.inf)


def test_the_unit_is_followed_when_the_map_drifts() -> None:
    frames, poses = STRAIGHT
    estimator = GroundPlane().estimator(CAMERA, 1.65)
    units_m = np.geomspace(1.0, 1.5, 12)
    for unit_m in units_m:
        show(estimator, frames, poses, unit_m)
    np.testing.assert_allclose(estimator.units, np.repeat(units_m, len(poses) - 1), rtol=0.06)


def test_the_ground_plane_needs_the_cameras_height() -> None:
    with pytest.raises(Incompatible, match="unit-speed"):
        GroundPlane().estimator(CAMERA, None)


def test_without_a_road_the_prior_is_assumed() -> None:
    estimator = GroundPlane(prior=SpeedPrior(median_m_s=8.0, spread=0.4)).estimator(CAMERA, 1.65)
    estimator.finalize(length=4.0, duration_s=0.9)
    assert estimator.unit == pytest.approx(8.0 * 0.9 / 4.0)  # 7.2 m for 4 units
    assert estimator.uncertainty == pytest.approx(0.4)
    measured = GroundPlane().estimator(CAMERA, 1.65)
    show(measured, *STRAIGHT)
    result = (measured.unit, measured.uncertainty)
    measured.finalize(length=4.0, duration_s=0.9)
    assert (measured.unit, measured.uncertainty) == result
