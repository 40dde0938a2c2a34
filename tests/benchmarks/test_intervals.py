"""Intervals of means over dependent clips: simulated coverage, and numbers that one can work out by hand."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from geovp_benchmarks import intervals
from geovp_benchmarks.studies import coverage
from geovp_classic import registry


@pytest.mark.parametrize(("name", "least", "most"), [("AR(1), 0.0", 0.93, 0.985), ("AR(1), 0.5", 0.92, 0.98)])
def test_an_interval_holds_the_truth_about_as_often_as_it_says(name: str, least: float, most: float) -> None:
    covered, naive, _ = coverage.coverage((36,), coverage.dependences()[name], coverage.NOISES["normal"], 400)
    assert least < covered < most
    if name == "AR(1), 0.5":  # the variance of the mean is about (1 + .5) / (1 - .5) = 3 times that of independent ones
        assert naive < 0.82


def test_independent_values_get_about_students_interval() -> None:
    values = np.random.default_rng(0).normal(5.0, 2.0, 400)
    found = intervals.interval(values, np.zeros(400))
    low, high = stats.t.interval(0.95, 399, values.mean(), values.std(ddof=1) / 20)
    assert found.mean == pytest.approx(values.mean())
    assert found.high - found.low == pytest.approx(high - low, rel=0.2)
    assert 250 < found.effective <= 400


def test_clips_that_are_alike_count_as_fewer() -> None:
    values = np.repeat(np.random.default_rng(1).normal(size=20), 10)  # twenty values, ten times each
    assert intervals.interval(values, np.zeros(200)).effective < 25


def test_neighbours_of_different_sequences_are_no_neighbours() -> None:
    values = np.random.default_rng(4).normal(size=10).repeat(2)  # neighbours are equal; of each pair one a sequence
    together, _ = intervals.autocorrelation_time(values, [np.arange(20)])
    apart, _ = intervals.autocorrelation_time(values, [np.arange(0, 20, 2), np.arange(1, 20, 2)])
    assert apart < together


def test_the_autocorrelation_time_of_known_processes() -> None:
    # AR(1): (1 + r) / (1 - r) = 3; moving average of 6 values: 6
    noise = np.random.default_rng(5)
    for filters, expected in ((coverage.dependences()["AR(1), 0.5"], 3.0), (coverage.dependences()["overlap, 6"], 6.0)):
        values = lfilter(*filters, noise.normal(size=4000))
        tau, _ = intervals.autocorrelation_time(values, [np.arange(4000)])
        assert tau == pytest.approx(expected, rel=0.25)


def test_a_difference_that_is_always_there_is_not_zero() -> None:
    noise = np.random.default_rng(2).normal(size=30)
    assert intervals.interval(0.1 * noise + 1, np.zeros(30)).p_zero == intervals.LEAST_P
    assert intervals.interval(noise - noise.mean(), np.zeros(30)).p_zero > 0.9


@pytest.mark.parametrize("shift", np.linspace(-1.2, 1.2, 13))
def test_p_is_below_a_twentieth_just_where_the_interval_leaves_zero_out(shift: float) -> None:
    found = intervals.interval(np.random.default_rng(7).exponential(size=20) - 1 + shift, np.zeros(20))
    assert (found.p_zero < 0.05) == (found.low > 0 or found.high < 0)


def test_a_clip_a_sequence_is_a_sample_of_sequences() -> None:
    values = np.random.default_rng(6).normal(size=12)
    found = intervals.interval(values, np.arange(12))
    low, high = stats.t.interval(0.95, 11, values.mean(), values.std(ddof=1) / np.sqrt(12))
    assert found.high - found.low == pytest.approx(high - low, rel=0.25)


def test_undefined_values_are_left_out_and_two_have_no_interval() -> None:
    found = intervals.interval(np.array([1.0, np.nan, 3.0]), np.zeros(3))
    assert found.mean == 2.0
    assert np.isnan(found.low)
    assert np.isnan(intervals.interval(np.array([np.nan]), np.zeros(1)).mean)


def test_the_same_seed_gives_the_same_interval() -> None:
    values = np.random.default_rng(3).normal(size=36)
    first, again = (intervals.interval(values, np.zeros(36)) for _ in range(2))
    assert first == again
    assert first.low < first.mean < first.high


def test_holms_correction_worked_out() -> None:
    # sorted: .01 * 3 = .03, .02 * 2 = .04, .04 * 1 = .04
    corrected = intervals.holm(np.array([0.04, 0.01, np.nan, 0.02]))
    np.testing.assert_allclose(corrected, [0.04, 0.03, np.nan, 0.04])
    np.testing.assert_allclose(intervals.holm(np.array([0.9, 0.8])), [1.0, 1.0])


def test_a_clips_sequence_is_its_name_without_the_number() -> None:
    assert [intervals.sequence_of(name) for name in ("03/000180", "a/b/7", "7")] == ["03", "a/b", ""]


class TestBounds:
    """Four clips alone give wide intervals; none reaches what the metric cannot be."""

    @pytest.mark.parametrize("values", [(0.99, 0.97, 0.4, 0.5), (0.01, 0.0, 0.02, 0.9)])
    def test_a_share_stays_a_share(self, values: tuple[float, ...]) -> None:
        free = intervals.interval(np.array(values), np.zeros(4))
        held = intervals.interval(np.array(values), np.zeros(4), bounds=(0.0, 1.0))
        assert free.low < 0 or free.high > 1
        assert (held.low, held.high) == (max(free.low, 0.0), min(free.high, 1.0))
        assert (held.mean, held.effective, held.p_zero) == (free.mean, free.effective, free.p_zero)

    def test_every_metric_of_ours_says_its_own(self) -> None:
        found = {}
        for role in ("frame_metrics", "trajectory_metrics"):
            found.update({name: registry.load(role, name) for name in registry.names(role)})
        assert found["psnr"]().bounds == (0.0, 100.0)
        assert found["stabilised"]().bounds == (0.0, 100.0)  # of PSNR, its metric
        assert (found["ssim"].bounds, found["ms-ssim"].bounds) == ((-1.0, 1.0), (0.0, 1.0))  # type: ignore[attr-defined]
        for name, metric in found.items():
            if name.endswith(("-error", "-displacement")) or name == "lpips":
                assert metric.bounds[0] == 0.0  # type: ignore[attr-defined]
