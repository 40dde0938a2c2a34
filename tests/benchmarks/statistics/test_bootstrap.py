"""Intervals of means over dependent clips: simulated coverage, and numbers that one can work out by
hand.
"""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from geovp_benchmarks.results.score_names import UNBOUNDED
from geovp_benchmarks.statistics.bootstrap import BlockBootstrap, Groups
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_benchmarks.statistics.score import sequences_of
from geovp_classic.types import FloatArray


def autocorrelation_time(values: FloatArray, *groups: FloatArray) -> tuple[float, int]:
    """Return tau and the visible lags of sequences of values."""
    whole = np.concatenate([values[np.asarray(group, int)] for group in groups])
    sequences = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    (tau,), (visible,) = BlockBootstrap().autocorrelation_time(whole[None], Groups.of(sequences, 3))
    return tau, visible


def clips(count: int) -> list[str]:
    """Return the names of clips of one sequence."""
    return [f"03/{number:06d}" for number in range(count)]


def standard_error(values: FloatArray, tau: float, is_apart: bool = False) -> tuple[float, int]:
    """Return the error and degrees of freedom of one sequence, or of clips that stand alone."""
    sequences = np.arange(len(values)) * is_apart
    (error,), (degrees,) = BlockBootstrap().standard_error(
        values[None], Groups.of(sequences, 3), np.array([tau])
    )
    return error, degrees


@pytest.mark.parametrize(("correlation", "low", "high"), [(0.0, 0.93, 0.985), (0.5, 0.92, 0.98)])
def test_an_interval_holds_the_truth_about_as_often_as_it_says(
    correlation: float, low: float, high: float
) -> None:
    noise = np.random.default_rng(0).normal(size=(400, 236))
    values = lfilter([1.0], [1.0, -correlation], noise, axis=1)[:, 200:]
    found = [
        Intervals(bootstrap=BlockBootstrap(seed=number)).interval(row, clips(36))
        for number, row in enumerate(values)
    ]
    assert low < np.mean([each.low <= 0 <= each.high for each in found]) < high
    # the variance of the mean is about (1 + .5) / (1 - .5) = 3 times that of independent values
    half = stats.t(35).ppf(0.975) * values.std(axis=1, ddof=1) / 6
    naive = (np.abs(values.mean(axis=1)) <= half).mean()
    assert (naive < 0.82) == (correlation == 0.5)


def test_the_autocorrelation_time_of_known_processes() -> None:
    # AR(1): (1 + r) / (1 - r) = 3; moving average of 6 values: 6
    noise = np.random.default_rng(5)
    for filters, expected in (
        (([1.0], [1.0, -0.5]), 3.0),
        (([1.0] * 6, [1.0]), 6.0),
    ):
        values = lfilter(*filters, noise.normal(size=4000))
        tau, _ = autocorrelation_time(values, np.arange(4000))
        assert tau == pytest.approx(expected, rel=0.25)


def test_undefined_values_are_left_out_and_two_have_no_interval() -> None:
    found = Intervals().interval(np.array([1.0, np.nan, 3.0]), clips(3))
    assert found.mean == 2.0
    assert np.isnan(found.low)
    assert np.isnan(Intervals().interval(np.array([np.nan]), clips(1)).mean)


def test_a_clips_sequence_is_its_name_without_the_number() -> None:
    names = ("03/000180", "a/b/7", "7", "03/000190")
    assert sequences_of(names).tolist() == [1, 2, 0, 1]


def test_a_fraction_stays_a_fraction() -> None:
    """Four clips alone give wide intervals; none reaches what the metric cannot be."""
    values = np.array([0.99, 0.97, 0.4, 0.5])
    free = Intervals().interval(values, clips(4))
    held = Intervals().interval(values, clips(4), (0.0, 1.0))
    assert free.high > 1
    assert (held.low, held.high) == (max(free.low, 0.0), 1.0)


class TestAutocorrelationTime:
    """Of patterns whose correlations can be counted."""

    def test_one_visible_lag_goes_on_geometrically(self) -> None:
        # Threes of ones of either sign: of 299 pairs of neighbours 200 are equal, so r = 101 / 299;
        # pairs two apart
        # correlate negatively. A mean taken out of 300 values adds (1 - r) tau / 300; tau is (1 +
        # r) / (1 - r).
        values = np.tile([1.0, 1, 1, -1, -1, -1], 50)
        tau, visible = autocorrelation_time(values, np.arange(300))
        correlation = 101 / 299 + 198 / 299 * tau / 300
        assert tau == pytest.approx((1 + correlation) / (1 - correlation), rel=1e-4)
        assert visible == 1

    def test_equal_alternating_or_few_values_are_independent(self) -> None:
        for values in (np.full(30, 0.1), np.tile([1.0, -1.0], 15), np.arange(3.0)):
            assert autocorrelation_time(values, np.arange(len(values))) == (1.0, 0)


@pytest.mark.parametrize("value", [0.0, 2.0, -1.0])
def test_equal_values_have_an_interval_without_width(value: float) -> None:
    found = Intervals().interval(np.full(8, value), clips(8))
    assert (found.mean, found.low, found.high, found.effective_clips) == (value, value, value, 8)


def cosine(number: int, count: int) -> FloatArray:
    """A cosine of length one [count] with so many half periods."""
    return np.sqrt(2 / count) * np.cos(np.pi * number * (np.arange(count) + 0.5) / count)


class TestStandardError:
    """Of sums of cosines, whose powers are known."""

    @pytest.mark.parametrize(
        ("tau", "first_share"), [(1.0, 1.0), (3.0, 0.25 / (1.25 - np.cos(np.pi / 10)))]
    )
    def test_the_two_slowest_cosines_of_few_values_count(
        self, tau: float, first_share: float
    ) -> None:
        # of an autoregression with tau = 3 a step keeps one half: at an angle a 1 / 4 of 5 / 4 -
        # cos(a) is left
        values = 7 + 3 * cosine(1, 10) + 4 * cosine(2, 10) + 100 * cosine(9, 10)
        second_share = 0.25 / (1.25 - np.cos(np.pi / 5)) if tau == 3 else 1.0
        error, degrees = standard_error(values, tau)
        assert error == pytest.approx(np.sqrt(25 / (first_share + second_share) / 10))
        assert degrees == 2

    def test_clips_that_stand_alone_have_the_classical_one(self) -> None:
        values = np.random.default_rng(9).normal(size=12)
        error, degrees = standard_error(values, 1.0, is_apart=True)
        assert error == pytest.approx(values.std(ddof=1) / np.sqrt(12))
        assert degrees == 11

    @pytest.mark.parametrize(
        ("count", "level"), [(5, 0.95), (10, 0.95), (10, 0.5), (60, 0.95), (60, 0.8)]
    )
    def test_the_interval_is_students_with_its_degrees(self, count: int, level: float) -> None:
        values = np.random.default_rng(10).normal(size=count)
        tau, _ = autocorrelation_time(values, np.arange(count))
        error, degrees = standard_error(values, tau)
        found = Intervals(bootstrap=BlockBootstrap(level)).interval(values, clips(count))
        half = error * stats.t(degrees).ppf((1 + level) / 2)
        assert (found.high - found.low) / 2 == pytest.approx(half, rel=0.06)
        assert found.effective_clips == pytest.approx(count / tau)


def test_the_slowest_cosine_of_a_sequence_is_its_mean() -> None:
    """Two sequences of four values are 1 and -1, with a squared cosine of 4 each.

    Of two cosines each, less one for the mean of all, 8 / 3 is the variance; over eight values.
    """
    values = np.repeat([[1.0, -1.0]], 4, axis=1)
    groups = Groups.of(np.repeat([0, 1], 4), 3)
    (error,), (degrees,) = BlockBootstrap().standard_error(values, groups, np.ones(1))
    assert (error, degrees) == (pytest.approx(np.sqrt(8 / 3 / 8)), 3)


def test_scores_together_have_the_intervals_of_each_alone() -> None:
    noise = np.random.default_rng(0).normal(size=36)
    alternating = np.tile([1.0, -1.0], 18)
    missing = np.where(np.arange(36) < 5, np.nan, noise)
    rows = np.stack([noise, np.cumsum(noise), alternating, np.full(36, 2.0), missing])
    together = Intervals().intervals(rows, clips(36), [UNBOUNDED] * 5)
    for score, row in zip(together, rows, strict=True):
        alone = Intervals().interval(row, clips(36))
        for name in ("mean", "low", "high", "mean_error", "effective_clips", "p_value", "clips"):
            assert getattr(score, name) == pytest.approx(getattr(alone, name)), name
    # alternating values have no slow changes: 0.6 standard errors at least
    assert together[2].mean_error == pytest.approx(0.6 * np.sqrt(36 / 35) / 6)
