"""Errors of past rotations say how coming ones will err."""

from __future__ import annotations

import numpy as np
import pytest

from geovp_classic.depth import drift
from geovp_classic.depth.drift import Drift, Errors
from geovp_classic.geometry import se3
from geovp_classic.types import FloatArray

PAST_S, FUTURE_S = np.arange(-9, 0) * 0.1, np.arange(1, 21) * 0.1


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


@pytest.mark.parametrize("errors", [Errors(0.4, 0.2), Errors(0.2, 0.4), Errors(0.05, 1.0, 0.1)])
def test_nothing_linear_foretells_simulated_errors_better(errors: Errors) -> None:
    wrong = samples(errors, 20_000)
    noisy = wrong[:, :9] + errors.registration_s * np.random.default_rng(1).normal(size=(len(wrong), 9))
    truth = wrong[:, 10:]
    foretold = noisy @ errors.weights(PAST_S, FUTURE_S).T
    fitted = noisy @ np.linalg.lstsq(noisy, truth, rcond=None)[0]
    left, best = (((given - truth) ** 2).mean(axis=0) for given in (foretold, fitted))
    np.testing.assert_allclose(left, best, rtol=0.01)
    assert (left < (truth**2).mean(axis=0)).all()


def test_the_last_frame_s_trembling_is_in_every_coming_pose() -> None:
    # All past frames say that the last one looks a twentieth of a degree too high.
    trembled = np.zeros((9, 3))
    trembled[:, 0] = np.radians(0.05)
    mended = Drift(PAST_S, trembled).mended(np.tile(np.eye(4), (20, 1, 1)), FUTURE_S)
    turned = se3.log(mended)[:, 3:]
    assert (turned[:, 0] > np.radians(0.01)).all()
    assert (turned[:, 0] < np.radians(0.05)).all()
    np.testing.assert_allclose(turned[:, 1:], 0, atol=1e-12)


def test_a_heading_that_drifts_goes_on_for_a_while() -> None:
    drifting = np.zeros((9, 3))
    drifting[:, 1] = np.radians(0.01) * np.arange(-9, 0)
    turned = se3.log(Drift(PAST_S, drifting).mended(np.tile(np.eye(4), (20, 1, 1)), FUTURE_S))[:, 4]
    assert (np.diff(turned) > 0).all()
    assert np.radians(0.01) < turned[-1] < np.radians(0.05)


def test_rotations_that_jumped_are_no_drift() -> None:
    jumped = np.zeros((9, 3))
    jumped[:5, 1] = np.radians(3)
    mended = Drift(PAST_S, jumped).mended(np.tile(np.eye(4), (20, 1, 1)), FUTURE_S)
    assert np.abs(se3.log(mended)).max() < np.radians(0.01)


def test_poses_that_the_pictures_agree_with_stay_and_positions_do_always() -> None:
    past = se3.exp(np.arange(10)[:, None] * np.array([0.1, 0, 1.0, 0, 0.02, 0]))
    future = se3.exp(np.arange(1, 21)[:, None] * np.array([0.1, 0, 1.0, 0, 0.02, 0]))
    times_s = np.arange(10) * 0.1
    agreeing = drift.observed(past, past, times_s)
    np.testing.assert_allclose(agreeing.mended(future, FUTURE_S), future, atol=1e-12)
    turned = past.copy()
    turned[-1] = past[-1] @ se3.exp(np.array([0, 0, 0, np.radians(0.1), 0, 0]))
    mended = drift.observed(turned, past @ se3.inverse(past[-1]) @ turned[-1], times_s).mended(future, FUTURE_S)
    np.testing.assert_array_equal(mended[:, :3, 3], future[:, :3, 3])


def test_errors_are_those_of_the_given_rotations() -> None:
    seen = se3.exp(np.arange(10)[:, None] * np.array([0, 0, 1.0, 0, 0.03, 0]))
    wrong = np.array([0, 0, 0, 0.001, -0.002, 0.0005])
    given = seen.copy()
    given[:-1] = seen[-1] @ se3.exp(-wrong) @ se3.inverse(seen[-1]) @ seen[:-1]
    found = drift.observed(given, seen, np.arange(10) * 0.1)
    np.testing.assert_allclose(found.errors_rad, np.tile(wrong[3:], (9, 1)), atol=1e-9)
    np.testing.assert_allclose(found.seconds, PAST_S, atol=1e-12)


@pytest.mark.parametrize("count", [0, 1])
def test_little_past_is_enough(count: int) -> None:
    little = Drift(PAST_S[:count], np.full((count, 3), 1e-4))
    assert np.isfinite(little.mended(np.tile(np.eye(4), (2, 1, 1)), FUTURE_S[:2])).all()
