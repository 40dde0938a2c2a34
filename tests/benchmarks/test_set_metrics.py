"""Metrics of sets of clips: features are stored by clip and sample, tables have their distance."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.plots import horizon
from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.plots.style import Options
from geovp_benchmarks.results.store import Results, ScoreRecord, Scores
from geovp_benchmarks.running.rescore import rescore, stored_metrics
from geovp_benchmarks.tables import tables
from tests.benchmarks.made import content, go

METRICS = {
    "frame": ["toy-difference"],
    "trajectory": [],
    "set": {"fvd": {"name": "toy-brightness"}},
}


def run(root: Path, **predictors: Any) -> Results:
    """Five clips; the last observed and last real frames have grey levels 10 c + 2 and 10 c + 4."""
    go(root, content(metrics=METRICS, predictors=predictors), keep="all")
    return Results(root)


@pytest.fixture
def results(tmp_path: Path, toys: Path) -> Results:
    still = {"name": "toy-still"}
    noise = {"name": "toy-noise", "num_samples": 3}
    return run(tmp_path / "results", still=still, noise=noise)


def test_features_of_the_truth_and_of_samples_are_stored(results: Results) -> None:
    stored = results.scores("still").values["fvd@features"]
    assert stored.shape == (5, 2, 2)  # clip; truth, sample; feature
    np.testing.assert_allclose(stored[3], [[32, 34], [32, 32]])
    assert results.scores("noise").values["fvd@features"].shape == (5, 3, 2)  # max_samples = 2


def test_the_table_has_the_distance_with_its_interval_and_clips(results: Results) -> None:
    """`still` repeats the last observed frame: the second mean is off by 2 grey levels, 2^2 = 4."""
    main = tables.build(results)[0]
    (column,) = (column for column in main.columns if column.key == "fvd")
    assert (column.heading, column.higher_is_better) == ("FVD ↓", False)
    still, mean_of_noise, best_of_noise = main.rows
    score = still.scores["fvd"]
    assert score.mean == pytest.approx(4.0)
    assert (score.clips, score.low, score.high) == (5, pytest.approx(4.0), pytest.approx(4.0))
    of_noise = mean_of_noise.scores["fvd"]
    assert of_noise.low < of_noise.mean < of_noise.high
    assert of_noise.mean > 400  # every frame is about 127.5; the real ones are at most 44
    assert best_of_noise.scores["fvd"] == of_noise
    assert [table.name for table in tables.build(results)] == ["scores"]


def test_figures_over_steps_leave_features_out(results: Results) -> None:
    assert horizon.metrics(Material(results, Options())) == ["toy-difference"]


def test_kept_predictions_can_be_rescored(results: Results, tmp_path: Path) -> None:
    again = Results(tmp_path / "again")
    rescore(results, again, stored_metrics(results))
    assert tables.build(again)[0].rows[0].scores["fvd"].mean == pytest.approx(4.0)


def test_with_eight_drives_the_interval_is_over_drives(results: Results) -> None:
    clips = [f"{drive}/{clip}" for drive in range(8) for clip in range(2)]
    results.write_protocol({**results.protocol(), "clips": clips, "digests": {}})
    features = np.random.default_rng(0).normal(size=(16, 2, 2))
    record = ScoreRecord("still", clips, results.by_name()["still"].fingerprint)
    results.write_scores([(Scores(clips, {"fvd@features": features}), record)])
    (row,) = tables.build(results.select("still"))[0].rows
    assert row.scores["fvd"].is_over_drives
