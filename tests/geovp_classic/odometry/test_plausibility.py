"""Plausibility of trajectories: swapped frames, sideways motion, and restarts of tracking."""

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.odometry.plausibility import Plausibility, longest_segment
from geovp_classic.types import FloatArray

CHECK = Plausibility()
TIMES_S = 0.1 * np.arange(10)


def path(progress: FloatArray) -> FloatArray:
    """Return poses [P, 4, 4] along a bend of 20 m radius."""
    return np.asarray(se3.exp(progress[:, None] * np.array([0, 0, 1.0, 0, 0.05, 0])))


@pytest.mark.parametrize("swap", [(0, 2), (4, 5), (7, 8), (8, 9)])
def test_swapped_frames_do_not_fit_the_acceleration(swap: tuple[int, int]) -> None:
    progress = 8.0 * TIMES_S
    progress[list(swap)] = progress[list(swap[::-1])]
    fits = CHECK.fits_acceleration(path(progress), TIMES_S)
    assert np.flatnonzero(~fits).tolist() == list(swap)


@pytest.mark.parametrize("acceleration", [-8.0, 0.0, 5.0])
def test_braking_stationary_and_reversing_cameras_are_plausible(acceleration: float) -> None:
    noise = np.random.default_rng(0).normal(0, 0.01, 10)
    braking = 8 * TIMES_S + acceleration / 2 * TIMES_S**2 + noise
    for progress in (braking, -3 * TIMES_S, 0.01 * noise, TIMES_S[:1]):
        assert CHECK.fits_acceleration(path(progress), TIMES_S[: len(progress)]).all()


def test_without_a_majority_all_poses_stay() -> None:
    progress = np.random.default_rng(1).uniform(-5, 5, 10)
    assert CHECK.fits_acceleration(path(progress), TIMES_S).all()


def test_sideways_motion() -> None:
    assert CHECK.is_sideways(se3.exp(TIMES_S[:, None] * np.array([-5.0, 0, 2.0, 0, 1.3, 0])))
    for progress in (8.0 * TIMES_S, -3.0 * TIMES_S, TIMES_S[:1]):
        assert not CHECK.is_sideways(path(progress))


@pytest.mark.parametrize(
    ("tracked", "expected"),
    [
        ("1111111111", "1111111111"),
        ("1000010000", "1000010000"),  # localised again in the same map
        ("1000001111", "0000011111"),  # restarted at the sixth image
        ("1110000011", "1110000000"),  # restarted as well, but with fewer tracked images
        ("1100000111", "0000001111"),
        ("1110011000", "1110011000"),
        ("1000000000", "1000000000"),
        ("0000000000", "0000000000"),
    ],
)
def test_the_longest_segment_of_a_path_with_gaps(tracked: str, expected: str) -> None:
    marks = np.array([mark == "1" for mark in tracked])
    segment = longest_segment(marks, max_bridged=4)
    assert "".join("1" if mark else "0" for mark in segment) == expected
