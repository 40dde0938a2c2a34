"""Poses that no vehicle drove through are found; driving is not."""

import numpy as np
import pytest

from geovp_classic.geometry import se3
from geovp_classic.odometry.consistency import driven, is_sideways, measured
from geovp_classic.types import FloatArray

TIMES_S = 0.1 * np.arange(10)


def path(progress: FloatArray) -> FloatArray:
    """Poses [P, 4, 4] along a bend of 20 m radius."""
    return np.asarray(se3.exp(progress[:, None] * np.array([0, 0, 1.0, 0, 0.05, 0])))


@pytest.mark.parametrize("swap", [(4, 5), (7, 8), (8, 9)])
def test_swapped_frames(swap: tuple[int, int]) -> None:
    progress = 8.0 * TIMES_S
    progress[list(swap)] = progress[list(swap[::-1])]
    assert np.flatnonzero(~driven(path(progress), TIMES_S)).tolist() == list(swap)


@pytest.mark.parametrize("acceleration", [-8.0, 0.0, 5.0])
def test_braking_standing_and_reversing_are_driven(acceleration: float) -> None:
    noise = np.random.default_rng(0).normal(0, 0.01, 10)
    assert driven(path(8 * TIMES_S + acceleration / 2 * TIMES_S**2 + noise), TIMES_S).all()
    assert driven(path(-3 * TIMES_S), TIMES_S).all()
    assert driven(path(0.01 * noise), TIMES_S).all()
    assert driven(path(TIMES_S[:1]), TIMES_S[:1]).all()


def test_where_nothing_agrees_nothing_is_said() -> None:
    progress = np.random.default_rng(1).uniform(-5, 5, 10)
    assert driven(path(progress), TIMES_S).all()


def test_a_camera_goes_sideways_where_it_does() -> None:
    assert not is_sideways(path(8.0 * TIMES_S))
    assert not is_sideways(path(-3.0 * TIMES_S))
    assert is_sideways(se3.exp(TIMES_S[:, None] * np.array([-5.0, 0, 2.0, 0, 1.3, 0])))
    assert not is_sideways(path(TIMES_S[:1]))


@pytest.mark.parametrize(
    ("tracked", "known"),
    [
        ("1111111111", "1111111111"),
        ("1000010000", "1000010000"),  # found again in the same map: measured relative to the first
        ("1000001111", "0000011111"),  # started anew from the sixth; the first has nothing to do with it
        ("1111000000", "1111000000"),
        ("1110000011", "1110000000"),  # started anew as well, but with fewer
        ("1100000111", "0000001111"),
        ("1110011000", "1110011000"),
        ("1000000000", "1000000000"),
        ("1", "1"),
    ],
)
def test_what_was_measured_of_a_path_with_gaps(tracked: str, known: str) -> None:
    marks = np.array([mark == "1" for mark in tracked])
    assert "".join("1" if found else "0" for found in measured(marks, most_bridged=4)) == known
