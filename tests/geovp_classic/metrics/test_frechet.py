"""The Frechet distance against closed forms, SciPy's matrix root and a direct bootstrap."""

import numpy as np
import pytest
import scipy.linalg

from geovp_classic.metrics.frechet import frechet_distances
from geovp_classic.types import FloatArray


def random_sets(count: int, size: int) -> tuple[FloatArray, FloatArray]:
    """Correlated features [N, D] of another mean and covariance in the second set."""
    rng = np.random.default_rng(0)
    mixing = rng.normal(size=(size, size))
    real = rng.normal(size=(count, size)) @ mixing
    return real, 0.6 * real + rng.normal(size=(count, size)) + 0.5


@pytest.mark.parametrize(("count", "size"), [(400, 8), (40, 30), (300, 300)])
def test_the_distance_is_that_of_scipys_matrix_root(count: int, size: int) -> None:
    real, predicted = random_sets(count, size)
    covariance, other = np.cov(real.T), np.cov(predicted.T)
    root = scipy.linalg.sqrtm(covariance @ other)
    gap = real.mean(axis=0) - predicted.mean(axis=0)
    expected = gap @ gap + np.trace(covariance + other - 2 * root.real)
    assert frechet_distances(real, predicted).mean() == pytest.approx(expected, rel=1e-4)


def test_gaussians_on_a_line_differ_by_their_means_and_deviations() -> None:
    """Standard deviations of 1 and 2 and a gap of 3: 3^2 + (2 - 1)^2 = 10."""
    real = np.array([[-1.0], [1.0], [0.0]])
    assert frechet_distances(real, 2 * real + 3).mean() == pytest.approx(10.0)


@pytest.mark.parametrize(("count", "size"), [(100, 5), (30, 60)])
def test_a_clips_value_is_its_influence(count: int, size: int) -> None:
    """The distance with a clip twice as heavy changes by its influence / N, to first order."""
    real, predicted = random_sets(count, size)
    values = frechet_distances(real, predicted)
    repeats = 400
    for clip in (0, 7):
        weights = np.full(count, repeats)
        weights[clip] += 4
        heavier = frechet_distances(
            np.repeat(real, weights, axis=0), np.repeat(predicted, weights, axis=0)
        ).mean()
        same = frechet_distances(np.tile(real, (repeats, 1)), np.tile(predicted, (repeats, 1)))
        slope = (heavier - same.mean()) / (4 / (repeats * count))
        assert slope == pytest.approx(values[clip] - values.mean(), rel=0.1)
