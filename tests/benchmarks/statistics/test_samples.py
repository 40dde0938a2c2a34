"""Means and best of samples with numbers that one can work out by hand."""

import numpy as np

from geovp_benchmarks.statistics import samples


def test_best_sample_is_one_sample_over_all_steps() -> None:
    # sample 0: 10, 2 (mean 6); sample 1: 5, 5 (mean 5). The best step of each would give 10, 5.
    table = np.array([[[10.0, 2.0], [5.0, 5.0]]])
    np.testing.assert_array_equal(samples.best_of_samples(table, True), [[10.0, 2.0]])
    np.testing.assert_array_equal(samples.best_of_samples(table, False), [[5.0, 5.0]])
    np.testing.assert_array_equal(
        samples.best_of_samples(table, None), [[7.5, 3.5]]
    )  # nothing is better
    np.testing.assert_array_equal(samples.mean_of_samples(table, True), [[7.5, 3.5]])
