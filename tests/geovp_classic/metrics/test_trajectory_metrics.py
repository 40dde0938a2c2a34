"""Pose errors per step: worked numbers, invariances, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.metrics.trajectory import (
    AverageDisplacement,
    FinalDisplacement,
    RotationError,
    ScaleUncertainty,
    TranslationError,
    YawError,
    relative_to_last_observed,
)
from geovp_classic.types import FloatArray, Trajectory

BY_NAME = {
    "translation-error": TranslationError(),
    "rotation-error": RotationError(),
    "yaw-error": YawError(),
    "scale-uncertainty": ScaleUncertainty(),
    "average-displacement": AverageDisplacement(),
    "final-displacement": FinalDisplacement(),
}
TWISTS = hnp.arrays(np.float64, (4, 6), elements=st.floats(-1.5, 1.5))
TWIST = hnp.arrays(np.float64, (6,), elements=st.floats(-1.5, 1.5))


def trajectory(world_from_cam: FloatArray, is_metric: bool = True) -> Trajectory:
    return Trajectory(world_from_cam, 0.1 * np.arange(1, len(world_from_cam) + 1), is_metric)


def straight(speed: float, is_metric: bool = True) -> Trajectory:
    """`speed` along z per step, starting at one step from the origin."""
    centres = np.outer(np.arange(1, 5), [0.0, 0.0, speed])
    return trajectory(se3.compose(np.eye(3), centres), is_metric)


def turned(axis: int, angles_deg: list[float]) -> Trajectory:
    """Cameras at the origin turned about one of their axes."""
    twists = np.zeros((len(angles_deg), 6))
    twists[:, 3 + axis] = np.deg2rad(angles_deg)
    return trajectory(se3.exp(twists))


def test_scale_uncertainty_is_that_of_the_prediction() -> None:
    truth = straight(1.0)
    past = replace(truth, scale_uncertainty=0.5)
    predicted = relative_to_last_observed(past, truth.world_from_cam, truth.times_s)
    np.testing.assert_allclose(ScaleUncertainty()(predicted, truth), 50.0)
    np.testing.assert_array_equal(ScaleUncertainty()(truth, truth), 0.0)
    assert np.isnan(ScaleUncertainty()(straight(1.0, is_metric=False), truth)).all()


def test_translation_error_grows_with_a_wrong_speed() -> None:
    np.testing.assert_allclose(
        TranslationError()(straight(1.5), straight(1.0)), [0.5, 1.0, 1.5, 2.0]
    )


def test_displacements_are_returned_at_the_last_step() -> None:
    average = AverageDisplacement()(straight(1.5), straight(1.0))
    final = FinalDisplacement()(straight(1.5), straight(1.0))
    np.testing.assert_array_equal(
        average, [np.nan, np.nan, np.nan, 1.25]
    )  # (0.5 + 1.0 + 1.5 + 2.0) / 4
    np.testing.assert_array_equal(final, [np.nan, np.nan, np.nan, 2.0])
    assert (np.nanmean(average), np.nanmean(final)) == (1.25, 2.0)


@pytest.mark.parametrize(
    "name", ["translation-error", "average-displacement", "final-displacement"]
)
@pytest.mark.parametrize("metric_sides", [(False, True), (True, False), (False, False)])
def test_lengths_without_metres_are_nan(name: str, metric_sides: tuple[bool, bool]) -> None:
    predicted, target = (
        straight(1.0, is_metric=metric_sides[0]),
        straight(1.0, is_metric=metric_sides[1]),
    )
    assert np.isnan(BY_NAME[name](predicted, target)).all()


def test_rotation_error_is_exact_up_to_180_degrees() -> None:
    angles_deg = [1e-6, 5.0, 90.0, 179.999]
    for axis in range(3):
        np.testing.assert_allclose(
            RotationError()(turned(axis, angles_deg), turned(axis, [0] * 4)), angles_deg
        )
    across = RotationError()(turned(1, [179.0]), turned(1, [-179.0]))
    np.testing.assert_allclose(across, [2.0], atol=1e-9)  # the short way round


def test_yaw_error_ignores_pitch_and_roll() -> None:
    level = turned(1, [0.0, 0.0])
    np.testing.assert_allclose(YawError()(turned(1, [10.0, -170.0]), level), [10.0, 170.0])
    np.testing.assert_allclose(
        YawError()(turned(0, [10.0, -20.0]), level), 0.0, atol=1e-12
    )  # pitch
    np.testing.assert_allclose(YawError()(turned(2, [10.0, -20.0]), level), 0.0, atol=1e-12)  # roll


@settings(max_examples=30, deadline=None)
@given(poses=TWISTS, world=TWIST)
def test_relative_to_last_observed_removes_the_world_frame(
    poses: FloatArray, world: FloatArray
) -> None:
    real, other_from_world = se3.exp(poses), se3.exp(world)
    times_s = np.array([0.3, 0.4])
    truth = relative_to_last_observed(trajectory(real[:2]), real[2:], times_s)
    elsewhere = relative_to_last_observed(
        trajectory(other_from_world @ real[:2]), other_from_world @ real[2:], times_s
    )
    np.testing.assert_allclose(TranslationError()(elsewhere, truth), 0.0, atol=1e-9)
    np.testing.assert_allclose(RotationError()(elsewhere, truth), 0.0, atol=1e-5)


@pytest.mark.parametrize("name", BY_NAME)
def test_other_instants_are_refused(name: str) -> None:
    target = straight(1.0)
    with pytest.raises(BadData, match="3 predicted poses for 4 real ones"):
        BY_NAME[name](target[:3], target)
    with pytest.raises(BadData, match=r"up to 0.05 s apart: compare the same instants"):
        BY_NAME[name](Trajectory(target.world_from_cam, target.times_s + 0.05, True), target)
