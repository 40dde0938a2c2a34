"""Errors of past rotations say how coming ones will err."""

from __future__ import annotations

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.pose_refinement import rotation_drift
from geovp_classic.pose_refinement.rotation_drift import Drift, Errors
from geovp_classic.types import FloatArray, Trajectory

PAST_S, FUTURE_S = np.arange(-9, 0) * 0.1, np.arange(1, 21) * 0.1
TIMES_S = np.arange(-9, 21) * 0.1
NOW = 9


def samples(errors: Errors, count: int) -> FloatArray:
    """Errors [count, 30] of 30 frames against the tenth, step by step: rates decay and are stirred, and add up."""
    random = np.random.default_rng(0)
    fine_s = 0.01
    rate = random.normal(size=count)
    keep = np.exp(-fine_s / errors.lasting_s)
    at, drifted = np.zeros(count), [np.zeros(count)]
    for _ in range(29):
        for _ in range(10):
            following = keep * rate + np.sqrt(1 - keep**2) * random.normal(size=count)
            at, rate = at + fine_s * (rate + following) / 2, following
        drifted.append(at)
    wrong = np.stack(drifted, axis=1) + errors.white_s * random.normal(size=(count, 30))
    return wrong - wrong[:, 9:10]


def standing(errors_rad: FloatArray) -> Drift:
    """A camera that stands still; its recorded rotations [P, 3] before the last one err."""
    still = np.tile(np.eye(4), (len(errors_rad) + 1, 1, 1))
    seen = np.concatenate([se3.turned(still[1:], errors_rad), still[:1]])
    return Drift(still, seen, np.concatenate([PAST_S[len(PAST_S) - len(errors_rad) :], [0.0]]), is_metric=True)


def turned(errors_rad: FloatArray) -> FloatArray:
    """Rotation vectors [20, 3] of the poses after that, which are recorded as they are."""
    return se3.log(standing(errors_rad).mended(np.tile(np.eye(4), (20, 1, 1)), FUTURE_S))[:, 3:]


def driven(times_s: FloatArray) -> FloatArray:
    """A car that pitches and turns now to one side, now to the other: poses [T, 4, 4] in metres."""
    zero = np.zeros_like(times_s)
    pitch, yaw = 0.02 * np.sin(5 * times_s), 0.3 * np.sin(2 * times_s)
    across = 10 * 0.3 / 2 * (1 - np.cos(2 * times_s))
    return se3.compose(
        se3.exp(np.stack([zero, zero, zero, pitch, yaw, zero], axis=1))[:, :3, :3],
        np.stack([across, zero, 10 * times_s], axis=1),
    )


def from_now(world_from_cam: FloatArray) -> FloatArray:
    """Reference from camera."""
    return se3.inverse(world_from_cam[NOW]) @ world_from_cam


@pytest.mark.parametrize("errors", [Errors(0.4, 0.2), Errors(0.2, 0.4), Errors(0.05, 1.0, 0.1)])
def test_nothing_linear_foretells_simulated_errors_better(errors: Errors) -> None:
    wrong = samples(errors, 20_000)
    noisy = wrong[:, :9] + errors.registration_s * np.random.default_rng(1).normal(size=(len(wrong), 9))
    truth = wrong[:, 10:]
    foretold = noisy @ np.linalg.solve(errors.known(PAST_S), errors.covariance(PAST_S, FUTURE_S))
    fitted = noisy @ np.linalg.lstsq(noisy, truth, rcond=None)[0]
    left, best = (((given - truth) ** 2).mean(axis=0) for given in (foretold, fitted))
    np.testing.assert_allclose(left, best, rtol=0.01)
    assert (left < (truth**2).mean(axis=0)).all()


def test_the_last_frame_s_trembling_is_in_every_coming_pose() -> None:
    # All past frames say that the last one looks a twentieth of a degree too high.
    trembled = np.zeros((9, 3))
    trembled[:, 0] = np.radians(0.05)
    after = turned(trembled)
    assert (after[:, 0] > np.radians(0.01)).all()
    assert (after[:, 0] < np.radians(0.05)).all()
    np.testing.assert_allclose(after[:, 1:], 0, atol=1e-12)


def test_a_heading_that_drifts_goes_on_for_a_while() -> None:
    drifting = np.zeros((9, 3))
    drifting[:, 1] = np.radians(0.01) * np.arange(-9, 0)
    after = turned(drifting)[:, 1]
    assert (np.diff(after) > 0).all()
    assert np.radians(0.01) < after[-1] < np.radians(0.15)


def test_rotations_that_jumped_are_no_drift() -> None:
    jumped = np.zeros((9, 3))
    jumped[:5, 1] = np.radians(3)
    assert np.abs(turned(jumped)).max() < np.radians(0.03)


@pytest.mark.parametrize("lag_s", [0.006, -0.004])
def test_a_recording_out_of_step_is_brought_into_step(lag_s: float) -> None:
    given, truth = from_now(driven(TIMES_S)), from_now(driven(TIMES_S + lag_s))
    mended = Drift(given[: NOW + 1], truth[: NOW + 1], TIMES_S[: NOW + 1], True).mended(given[NOW + 1 :], FUTURE_S)
    before, after = (np.abs(se3.turn(poses, truth[NOW + 1 :])) for poses in (given[NOW + 1 :], mended))
    assert before[:, 1].max() > 0.0015  # the heading turns by up to 0.6 rad/s
    assert after[:, :2].max() < 0.5 * before[:, :2].max()
    before, after = (
        np.linalg.norm((poses - truth[NOW + 1 :])[:, :3, 3], axis=1) for poses in (given[NOW + 1 :], mended)
    )
    assert after.mean() < 0.6 * before.mean()


def test_a_lag_is_nothing_to_a_pose_that_does_not_go_on_from_the_past() -> None:
    given, truth = from_now(driven(TIMES_S)), from_now(driven(TIMES_S + 0.006))
    known = Drift(given[: NOW + 1], truth[: NOW + 1], TIMES_S[: NOW + 1], is_metric=True)
    last = given[-1:]
    mended = known.mended(last, FUTURE_S[:1])
    np.testing.assert_allclose(mended[:, :3, 3], last[:, :3, 3], atol=1e-12)
    assert np.abs(se3.turn(mended, last)).max() < 0.003


def evenly(first: int, last: int) -> FloatArray:
    """The same car, recorded at an even rate from one pose to the other: nothing measured those between."""
    poses = driven(TIMES_S)
    share = (np.arange(first + 1, last) - first) / (last - first)
    start, end = (np.tile(poses[step], (len(share), 1, 1)) for step in (first, last))
    turning = se3.interpolate(start, end, share)[:, :3, :3]
    poses[first + 1 : last] = se3.compose(turning, start[:, :3, 3] + share[:, None] * (end - start)[:, :3, 3])
    return poses


def test_a_gap_that_the_reference_lies_in_is_bridged() -> None:
    given, truth = from_now(evenly(4, 16)), from_now(driven(TIMES_S))
    mended = Drift(given[: NOW + 1], truth[: NOW + 1], TIMES_S[: NOW + 1], True).mended(given[NOW + 1 :], FUTURE_S)
    behind = slice(16 - NOW, None)
    before, after = (np.abs(se3.turn(poses, truth[NOW + 1 :]))[behind] for poses in (given[NOW + 1 :], mended))
    assert before.max() > np.radians(1)
    assert after.max() < 0.1 * before.max()


def test_without_metres_no_gap_is_known() -> None:
    given, truth = from_now(evenly(4, 16)), from_now(driven(TIMES_S))
    mended = Drift(given[: NOW + 1], truth[: NOW + 1], TIMES_S[: NOW + 1], False).mended(given[NOW + 1 :], FUTURE_S)
    before, after = (np.abs(se3.turn(poses, truth[NOW + 1 :])).max() for poses in (given[NOW + 1 :], mended))
    assert after > 0.8 * before


def test_a_gap_in_the_past_says_nothing_of_what_is_measured() -> None:
    given, truth = from_now(evenly(0, 6)), from_now(driven(TIMES_S))
    mended = Drift(given[: NOW + 1], truth[: NOW + 1], TIMES_S[: NOW + 1], True).mended(given[NOW + 1 :], FUTURE_S)
    np.testing.assert_allclose(mended, given[NOW + 1 :], atol=1e-6)


def test_poses_that_the_images_agree_with_stay() -> None:
    past = se3.exp(np.arange(10)[:, None] * np.array([0.1, 0, 1.0, 0, 0.02, 0]))
    future = se3.exp(np.arange(1, 21)[:, None] * np.array([0.1, 0, 1.0, 0, 0.02, 0]))
    times_s = np.arange(10) * 0.1
    agreeing = rotation_drift.observed(Trajectory(past, times_s, is_metric=True), past)
    np.testing.assert_allclose(agreeing.mended(future, FUTURE_S), future, atol=1e-12)
    # Where only the last rotation errs, and no rate of turn, there is no lag: positions stay.
    wrong = past.copy()
    wrong[-1] = past[-1] @ se3.exp(np.array([0, 0, 0, np.radians(0.1), 0, 0]))
    erring = rotation_drift.observed(
        Trajectory(wrong, times_s, is_metric=True), past @ se3.inverse(past[-1]) @ wrong[-1]
    )
    mended = erring.mended(se3.inverse(wrong[-1]) @ past[-1] @ future, FUTURE_S)
    np.testing.assert_allclose(mended[:, :3, 3], (se3.inverse(wrong[-1]) @ past[-1] @ future)[:, :3, 3], atol=1e-4)


def test_errors_are_those_of_the_given_rotations() -> None:
    seen = se3.exp(np.arange(10)[:, None] * np.array([0, 0, 1.0, 0, 0.03, 0]))
    wrong = np.array([0, 0, 0, 0.001, -0.002, 0.0005])
    given = seen.copy()
    given[:-1] = seen[-1] @ se3.exp(-wrong) @ se3.inverse(seen[-1]) @ seen[:-1]
    known = rotation_drift.observed(Trajectory(given, 5 + np.arange(10) * 0.1, is_metric=True), seen)
    np.testing.assert_allclose(se3.turn(known.given[:-1], known.seen[:-1]), np.tile(wrong[3:], (9, 1)), atol=1e-9)
    np.testing.assert_allclose(known.seconds, np.append(PAST_S, 0), atol=1e-12)


@pytest.mark.parametrize("count", [0, 1])
def test_little_past_is_enough(count: int) -> None:
    little = standing(np.full((count, 3), 1e-4))
    assert np.isfinite(little.mended(np.tile(np.eye(4), (2, 1, 1)), FUTURE_S[:2])).all()


def test_no_pose_is_asked_for() -> None:
    assert standing(np.full((9, 3), 1e-4)).mended(np.zeros((0, 4, 4)), np.zeros(0)).shape == (0, 4, 4)
