"""Times of the poses that a scene is asked for."""

import numpy as np
import pytest

from geovp_classic.render import pace


@pytest.mark.parametrize(
    ("count", "expected"),
    [(1, [0.1]), (3, [0.1, 0.2, 0.4]), (5, [0.1, 0.2, 0.4, 0.6, 0.8])],
)
def test_times_beyond_the_last_one_go_on_at_its_interval(count: int, expected: list[float]) -> None:
    np.testing.assert_allclose(pace.seconds_of(np.array([0.1, 0.2, 0.4]), count), expected)


def test_a_single_time_is_its_own_interval() -> None:
    np.testing.assert_allclose(pace.seconds_of(np.array([0.3]), 3), [0.3, 0.6, 0.9])
