"""Errors of past rotations predict those of future ones."""

import numpy as np
import pytest

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.interfaces import PoseRefinement
from geovp_classic.pose_refinement.rotation_drift import DriftModel, RotationDrift
from geovp_classic.pose_refinement.unmeasured_intervals import UnmeasuredIntervals
from geovp_classic.types import Context, FloatArray, Intrinsics, Motion, Trajectory

PAST_S, FUTURE_S = np.arange(-9, 0) * 0.1, np.arange(1, 21) * 0.1
TIMES_S = np.arange(-9, 21) * 0.1
NOW = 9


def samples(errors: DriftModel, count: int) -> FloatArray:
    """Return simulated errors [count, 30] of 30 frames against the tenth: integrated random rates."""
    random = np.random.default_rng(0)
    fine_s = 0.01
    rate = random.normal(size=count)
    keep = np.exp(-fine_s / errors.time_constant_s)
    at, drifted = np.zeros(count), [np.zeros(count)]
    for _ in range(29):
        for _ in range(10):
            following = keep * rate + np.sqrt(1 - keep**2) * random.normal(size=count)
            at, rate = at + fine_s * (rate + following) / 2, following
        drifted.append(at)
    wrong = np.stack(drifted, axis=1) + errors.white_s * random.normal(size=(count, 30))
    return wrong - wrong[:, 9:10]


def corrected(
    given: FloatArray,  # [P + F, 4, 4]
    seen: FloatArray,  # [P, 4, 4], with the same last pose
    times_s: FloatArray = TIMES_S,
    is_metric: bool = True,
    *refinements: PoseRefinement,
) -> FloatArray:
    """Return the refined futures [F, 4, 4] of a recording that deviates from registration."""
    now, clock_s = len(seen), 5 + times_s
    context = Context(np.zeros((now, 1, 1, 3), np.uint8), clock_s, Intrinsics(1, 1, 0, 0, 1, 1))
    recorded = Motion(
        Trajectory(given[:now], clock_s[:now], is_metric), given[None, now:], np.ones(now, bool)
    )
    motion = recorded.refined(Trajectory(seen, clock_s[:now], is_metric), recorded.futures)
    for refinement in refinements or (RotationDrift(),):
        motion = refinement.refine(context, motion)
    return motion.futures[0]


def turned(errors_rad: FloatArray) -> FloatArray:
    """Return future rotation vectors [20, 3] of a stationary camera, for errors [P, 3] of the past."""
    count = len(errors_rad)
    still = np.tile(np.eye(4), (count + 21, 1, 1))
    seen = np.concatenate([se3.turned(still[:count], errors_rad), still[:1]])
    return se3.log(corrected(still, seen, TIMES_S[NOW - count :]))[:, 3:]


def driven(times_s: FloatArray) -> FloatArray:
    """Return poses [T, 4, 4] in metres of a car that pitches and turns left and right."""
    zero = np.zeros_like(times_s)
    pitch, yaw = 0.02 * np.sin(5 * times_s), 0.3 * np.sin(2 * times_s)
    across = 10 * 0.3 / 2 * (1 - np.cos(2 * times_s))
    return se3.compose(
        se3.exp(np.stack([zero, zero, zero, pitch, yaw, zero], axis=1))[:, :3, :3],
        np.stack([across, zero, 10 * times_s], axis=1),
    )


def from_now(world_from_cam: FloatArray) -> FloatArray:
    """Return poses relative to the reference."""
    return se3.inverse(world_from_cam[NOW]) @ world_from_cam


@pytest.mark.parametrize(
    "errors", [DriftModel(0.4, 0.2), DriftModel(0.2, 0.4), DriftModel(0.05, 1.0, 0.1)]
)
def test_no_linear_predictor_of_simulated_errors_is_better(errors: DriftModel) -> None:
    wrong = samples(errors, 20_000)
    noisy = wrong[:, :9] + errors.registration_s * np.random.default_rng(1).normal(
        size=(len(wrong), 9)
    )
    truth = wrong[:, 10:]
    predicted = noisy @ np.linalg.solve(
        errors.observed_covariance(PAST_S), errors.covariance(PAST_S, FUTURE_S)
    )
    fitted = noisy @ np.linalg.lstsq(noisy, truth, rcond=None)[0]
    left, best = (((given - truth) ** 2).mean(axis=0) for given in (predicted, fitted))
    np.testing.assert_allclose(left, best, rtol=0.01)
    assert (left < (truth**2).mean(axis=0)).all()


def test_vibration_of_the_last_frame_is_in_every_future_pose() -> None:
    # All past frames say that the last one looks a twentieth of a degree too high.
    trembled = np.zeros((9, 3))
    trembled[:, 0] = np.radians(0.05)
    after = turned(trembled)
    assert (after[:, 0] > np.radians(0.01)).all()
    assert (after[:, 0] < np.radians(0.05)).all()
    np.testing.assert_allclose(after[:, 1:], 0, atol=1e-12)


def test_a_drifting_heading_continues_for_a_while() -> None:
    drifting = np.zeros((9, 3))
    drifting[:, 1] = np.radians(0.01) * np.arange(-9, 0)
    after = turned(drifting)[:, 1]
    assert (np.diff(after) > 0).all()
    assert np.radians(0.01) < after[-1] < np.radians(0.15)


def test_jumps_of_rotations_do_not_continue() -> None:
    jumped = np.zeros((9, 3))
    jumped[:5, 1] = np.radians(3)
    assert np.abs(turned(jumped)).max() < np.radians(0.03)


def rotation_errors(poses: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the absolute errors [F, 3] of future rotations."""
    return np.abs(se3.turn(poses[-20:], truth[-20:]))


@pytest.mark.parametrize("lag_s", [0.006, -0.004])
def test_a_lag_of_the_recording_is_corrected(lag_s: float) -> None:
    given, truth = from_now(driven(TIMES_S)), from_now(driven(TIMES_S + lag_s))
    refined = corrected(given, truth[: NOW + 1])
    before, after = rotation_errors(given, truth), rotation_errors(refined, truth)
    assert before[:, 1].max() > 0.0015  # the heading turns by up to 0.6 rad/s
    assert after[:, :2].max() < 0.5 * before[:, :2].max()
    position_errors = [(poses - truth[-20:])[:, :3, 3] for poses in (given[-20:], refined)]
    before_m, after_m = np.linalg.norm(position_errors, axis=2).mean(axis=1)
    assert after_m < 0.6 * before_m


def test_a_discontinuous_future_gets_no_lag() -> None:
    given, truth = from_now(driven(TIMES_S)), from_now(driven(TIMES_S + 0.006))
    last = given[-1:]
    jump = np.concatenate([given[: NOW + 1], last])
    refined = corrected(jump, truth[: NOW + 1], TIMES_S[: NOW + 2])
    np.testing.assert_allclose(refined[:, :3, 3], last[:, :3, 3], atol=1e-12)
    assert np.abs(se3.turn(refined, last)).max() < 0.003


def evenly(first: int, last: int) -> FloatArray:
    """Return the same drive, with uniform motion in place of the poses between two steps."""
    poses = driven(TIMES_S)
    fraction = (np.arange(first + 1, last) - first) / (last - first)
    ends = poses[[first, last]]
    positions = ends[0, :3, 3] + fraction[:, None] * (ends[1] - ends[0])[:3, 3]
    rotations = se3.interpolate(ends, np.array([0.0, 1.0]), fraction)[:, :3, :3]
    poses[first + 1 : last] = se3.compose(rotations, positions)
    return poses


@pytest.mark.parametrize("is_metric", [True, False])
def test_an_interval_around_the_reference_is_bridged_in_metres(is_metric: bool) -> None:
    given, truth = from_now(evenly(4, 16)), from_now(driven(TIMES_S))
    refinements = (UnmeasuredIntervals(), RotationDrift())
    refined = corrected(given, truth[: NOW + 1], TIMES_S, is_metric, *refinements)
    behind = slice(16 - NOW, None)
    before = rotation_errors(given, truth)[behind].max()
    after = rotation_errors(refined, truth)[behind].max()
    assert before > np.radians(1)
    assert (after < 0.1 * before) if is_metric else (after > 0.8 * before)


def test_a_past_interval_does_not_change_measured_poses() -> None:
    given, truth = from_now(evenly(0, 6)), from_now(driven(TIMES_S))
    np.testing.assert_allclose(corrected(given, truth[: NOW + 1]), given[NOW + 1 :], atol=1e-6)


def test_poses_that_agree_with_the_images_stay() -> None:
    poses = se3.exp(np.arange(30)[:, None] * np.array([0.1, 0, 1.0, 0, 0.02, 0]))
    past, future = poses[:10], poses[10:]
    np.testing.assert_allclose(corrected(poses, past), future, atol=1e-12)
    # Where only the last rotation errs, and no rate of turn, there is no lag: positions stay.
    wrong = poses.copy()
    wrong[9] = past[-1] @ se3.exp(np.array([0, 0, 0, np.radians(0.1), 0, 0]))
    kept = corrected(wrong, past @ se3.inverse(past[-1]) @ wrong[9])
    np.testing.assert_allclose(kept[:, :3, 3], future[:, :3, 3], atol=1e-4)


def test_registered_poses_are_required() -> None:
    context = Context(np.zeros((10, 1, 1, 3), np.uint8), TIMES_S, Intrinsics(1, 1, 0, 0, 1, 1))
    poses = driven(TIMES_S)
    past = Trajectory(poses[:10], TIMES_S[:10], is_metric=True)
    motion = Motion(past, poses[None, 10:], np.ones(10, bool))
    with pytest.raises(Incompatible, match="put registration before it"):
        RotationDrift().refine(context, motion)


@pytest.mark.parametrize("count", [0, 1])
def test_little_past_is_enough(count: int) -> None:
    assert np.isfinite(turned(np.full((count, 3), 1e-4))).all()
