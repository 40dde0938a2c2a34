"""Means and standard errors with numbers that one can work out by hand."""

import numpy as np
import pytest

from geovp_benchmarks.results.scores import nanmean
from geovp_benchmarks.statistics import samples
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_classic.types import FloatArray
from tests.benchmarks.made import scores

NAN = float("nan")


def rows(values: dict[tuple[str, int, int], float | None]) -> FloatArray:
    return scores((*key, "psnr", value) for key, value in values.items()).values["psnr"]


def test_steps_are_averaged_within_a_clip_before_clips_are() -> None:
    # clip a: (1 + 3) / 2 = 2; clip b: (5 + 7) / 2 = 6; mean 4; s = sqrt(((2-4)^2 + (6-4)^2) / 1) =
    # 2.828; / sqrt(2) = 2
    table = rows({("a", 0, 1): 1.0, ("a", 0, 2): 3.0, ("b", 0, 1): 5.0, ("b", 0, 2): 7.0})
    by_clip = nanmean(samples.mean_of_samples(table), axis=1)
    assert by_clip.tolist() == [2.0, 6.0]
    assert Intervals().interval(by_clip, "ab").standard_error == pytest.approx(2.0)


def test_best_sample_is_one_sample_over_all_steps() -> None:
    # sample 0: 10, 2 (mean 6); sample 1: 5, 5 (mean 5). The best step of each would give 10, 5.
    table = rows({("a", 0, 1): 10.0, ("a", 0, 2): 2.0, ("a", 1, 1): 5.0, ("a", 1, 2): 5.0})
    np.testing.assert_array_equal(samples.best_of_samples(table, True), [[10.0, 2.0]])
    np.testing.assert_array_equal(samples.best_of_samples(table, False), [[5.0, 5.0]])
    np.testing.assert_array_equal(
        samples.best_of_samples(table, None), [[7.5, 3.5]]
    )  # nothing is better
    np.testing.assert_array_equal(samples.mean_of_samples(table, True), [[7.5, 3.5]])
