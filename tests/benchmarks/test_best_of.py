"""Futures drawn from a Kalman filter meet other samples on equal terms: the whole way from a matrix
to the tables.
"""

import numpy as np
import pytest

from geovp_benchmarks.audit.contracts import street
from geovp_benchmarks.matrix import schema as matrices
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running import scoring
from geovp_benchmarks.running.executors import Serial
from geovp_benchmarks.running.plan import Options
from geovp_benchmarks.running.run import run
from geovp_benchmarks.running.scoring import Metrics, ScoredClip, score
from geovp_benchmarks.tables import tables
from geovp_benchmarks.tables.table_model import MethodScores
from geovp_classic.types import BoolArray, ByteArray, FloatArray, Prediction

KALMAN = {
    "name": "chained",
    "odometry": {"name": "ground-truth"},
    "forecaster": {"name": "turn-rate-kalman"},
}
PROTOCOL = {"num_past": 6, "num_future": 4, "size_px": [64, 64], "stride": 10}
METRICS = {"frame": ["psnr"], "trajectory": ["translation-error", "yaw-error"]}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Two clips of the synthetic street, five sampled futures each."""
    content = {
        "protocol": {**PROTOCOL, "dataset": {"name": "synthetic", "num_clips": 2}},
        "pose_sources": {"kalman": {**KALMAN, "num_samples": 5}, "mean": KALMAN},
        "renderers": {"planes": {"name": "ground-far-plane"}},
        "metrics": METRICS,
    }
    own = Results(tmp_path_factory.mktemp("best") / "of")
    methods = run(
        matrices.parse("m", content), own, Options(keep="0"), Serial(), lambda done, total: None
    )
    assert [method.status for method in methods] == ["done", "done"]
    return own


@pytest.fixture(scope="module")
def rows(results: Results) -> dict[str, MethodScores]:
    methods = tables.build(results)[0].methods
    return {method.label.removeprefix("kalman + planes"): method for method in methods}


def samples(results: Results, metric: str) -> FloatArray:
    return results.scores("kalman--planes").values[metric]


def test_every_drawn_future_is_seen_and_scored(results: Results) -> None:
    for metric in ("psnr", "translation-error", "yaw-error"):
        values = samples(results, metric)
        assert values.shape == (2, 5, 4)
        assert (np.ptp(values[:, :, -1], axis=1) > 1e-3).all()  # the futures differ


def test_the_best_of_all_columns_is_one_of_the_samples(
    results: Results, rows: dict[str, MethodScores]
) -> None:
    assert list(rows) == [", mean of 5", ", best of 5", ", best of 5 by PSNR", "mean + planes"]
    psnr, metres = (
        samples(results, "psnr").mean(axis=2),
        samples(results, "translation-error").mean(axis=2),
    )
    chosen = psnr.argmax(axis=1)
    by_psnr = rows[", best of 5 by PSNR"].scores
    assert by_psnr["psnr"].mean == pytest.approx(psnr.max(axis=1).mean())
    assert by_psnr["translation-error"].mean == pytest.approx(metres[np.arange(2), chosen].mean())
    best = rows[", best of 5"].scores
    assert best["translation-error"].mean == pytest.approx(metres.min(axis=1).mean())
    assert not rows["mean + planes"].is_oracle_selected
    assert rows[", best of 5"].is_oracle_selected


def test_the_expected_best_rises_from_the_mean_to_the_best(
    results: Results, rows: dict[str, MethodScores]
) -> None:
    (own,) = [table for table in tables.build(results) if table.name == "samples-psnr"]
    (row,) = own.methods
    curve = [row.scores[f"psnr of {k}"].mean for k in (1, 2, 5)]
    assert curve == sorted(curve)
    assert curve[0] == pytest.approx(rows[", mean of 5"].scores["psnr"].mean)
    assert curve[-1] == pytest.approx(rows[", best of 5"].scores["psnr"].mean)


def test_many_samples_are_scored_in_little_more_memory_than_few(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What metrics freed is returned to the system now and then, not kept in pieces between the
    scores.
    """
    released = []
    monkeypatch.setattr(scoring, "release_free_memory", lambda: released.append(scored[-1]))
    scored: list[int] = []
    clip = street.clip()

    class Watched:
        def __call__(
            self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None
        ) -> FloatArray:
            scored.append(int(predicted[0, 0, 0, 0]))
            return np.zeros(len(predicted))

    samples = np.stack([np.full_like(clip.frames[6:], level) for level in range(12)])
    metrics = Metrics({"watched": Watched()}, {})  # type: ignore[dict-item]
    score(ScoredClip(clip, 6), Prediction(samples), metrics)
    assert sorted(set(scored)) == list(range(12))
    assert released == [3, 8]  # the last sample before each
