"""Intervals over drives, and tests of several differences."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from geovp_benchmarks.report import findings
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.statistics.bootstrap import BlockBootstrap
from geovp_benchmarks.statistics.intervals import Intervals, holm
from geovp_benchmarks.statistics.score import Score
from geovp_benchmarks.statistics.student import student_p_value
from geovp_benchmarks.tables import tables
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import write_protocol, write_row
from tests.benchmarks.test_tables import METRICS, write


def clips(*lengths: int) -> list[str]:
    return [
        f"{drive:02d}/{clip:03d}" for drive, count in enumerate(lengths) for clip in range(count)
    ]


def test_equally_long_drives_have_students_interval_over_their_means() -> None:
    values = np.random.default_rng(0).normal(size=(9, 4)) + np.arange(9)[:, None]
    score = Intervals().interval(values.ravel(), clips(*[4] * 9))
    means = values.mean(axis=1)
    expected = stats.ttest_1samp(means, 0.0)
    interval = expected.confidence_interval(0.95)
    assert [score.low, score.high] == pytest.approx([interval.low, interval.high], abs=1e-6)
    assert score.p_value == pytest.approx(expected.pvalue, abs=1e-6)
    assert (score.mean, score.effective_clips) == pytest.approx((means.mean(), 9))


def test_fewer_than_eight_drives_have_the_block_bootstrap() -> None:
    values = np.random.default_rng(1).normal(size=56)
    names = clips(*[8] * 7)
    score = Intervals().interval(values, names)
    is_finite, bounds = np.isfinite(values), [(-np.inf, np.inf)]
    assert [score] == BlockBootstrap().intervals(values[None], is_finite, names, bounds)
    assert not score.is_over_drives
    assert Intervals().interval(values, clips(*[7] * 8)).is_over_drives


def test_drives_of_different_length_count_by_their_clips() -> None:
    """Means 0 of seven drives of a clip and 1 of one of seven: the mean over clips is 1/2.

    Weights are 1/14 and 1/2, their squares sum to 2/7, so that the variance is
    (7 / 14^2 + 1 / 2^2) / 4 / (1 - 2/7) = .1, with 7/2 - 1 degrees of freedom.
    """
    values = np.array([0.0] * 7 + [1.0] * 7)
    score = Intervals().interval(values, clips(1, 1, 1, 1, 1, 1, 1, 7))
    half = stats.t(2.5).ppf(0.975) * np.sqrt(0.1)
    assert score.mean == 0.5
    assert score.high - score.low == pytest.approx(2 * half, abs=1e-5)


@pytest.mark.parametrize("degrees", [1.0, 3.5, 30.0])
def test_p_values_are_students(degrees: float) -> None:
    assert student_p_value(2.0, 0.8, degrees) == pytest.approx(
        2 * stats.t(degrees).sf(2.5), abs=1e-6
    )


def test_holm_rejects_step_by_step() -> None:
    """Of 4: .01 <= .05 / 4, .015 <= .05 / 3, .03 > .05 / 2, so that .04 is not significant either."""
    scores = [Score(1.0, p_value=p, effective_clips=9.0) for p in (0.04, 0.01, 0.03, 0.015)]
    assert holm(scores) == [False, True, False, True]
    few = [Score(1.0, p_value=0.001, effective_clips=7.9)]
    assert holm(few) == [False]


def test_table_and_report_agree_that_few_clips_are_not_tested(
    tmp_path: Path, printed: Says
) -> None:
    """Six drives of one clip: all have 1 dB more, which would be p < 1e-6."""
    results, names = Results(tmp_path), clips(*[1] * 6)
    write_protocol(results, ["copy-last", "x"], names, metrics=METRICS)
    noise = np.random.default_rng(3).normal(0, 0.01, 6)
    for name, gain in (("copy-last", 0 * noise), ("x", 1 + noise)):
        values = {
            (c, 0, "psnr"): 20 + i + g for i, (c, g) in enumerate(zip(names, gain, strict=True))
        }
        write(results, name, values)
    differences = tables.against(results, "copy-last")
    (method,) = differences.rows
    assert method.scores["psnr"].low > 0.9
    assert differences.marked == set()
    assert "fewer than eight effective clips are not tested" in printed(
        "table", tmp_path, "--against", "copy-last"
    )
    main = tables.build(results)[0]
    found = findings.find(main, differences, results.protocol(), "copy-last")
    assert not found.is_significant
    assert main.marked == set()


def test_training_seeds_widen_an_interval(tmp_path: Path, printed: Says) -> None:
    """Seeds of mean 1, 2 and 3: a variance of the mean of 1 / 3, whose t has two degrees."""
    results = Results(tmp_path)
    names = clips(*[1] * 8)
    psnr = {"role": "frame", "unit": "dB", "higher_is_better": True, "unavailable": None}
    write_protocol(results, ["net-0", "net-1", "net-2", "other"], names, metrics={"psnr": psnr})
    for name, value in (("net-0", 1.0), ("net-1", 2.0), ("net-2", 3.0), ("other", 0.0)):
        write_row(results, name, [(clip, 0, 1, "psnr", value) for clip in names])
    (net, other) = tables.build(results, has_seeds=True)[0].rows
    half = stats.t.ppf(0.975, 2) / math.sqrt(3)
    assert (net.label, other.label) == ("net (3 seeds)", "other")
    interval = net.scores["psnr"]
    assert (interval.low, interval.high) == pytest.approx((2 - half, 2 + half), rel=1e-4)
    (difference,) = tables.against(results, "other", has_seeds=True).rows
    assert difference.scores["psnr"].high == pytest.approx(2 + half, rel=1e-4)
    (difference,) = tables.against(results, "net", has_seeds=True).rows
    assert difference.scores["psnr"].low == pytest.approx(-2 - half, rel=1e-4)
    assert "| net (3 seeds)" in printed("table", tmp_path, "--seeds")
