"""The confidence of stored predictions, and how well it ranks their errors."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.analysis import confidence
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import tables
from tests.benchmarks.made import content, crossed, dicts, go, scores, values

METRIC = "toy-difference"


def rewrite(
    results: Results, method: str, change: Callable[[dict[str, Any]], dict[str, Any] | None]
) -> None:
    """Change or drop stored rows."""
    rows, records = dicts(results.scores(method)), results.score_records(method)
    for record in records:
        kept = [
            new for row in rows if row["clip"] in record.clips and (new := change(row)) is not None
        ]
        results.write_scores([(scores([*row.values()] for row in kept), record)])


@pytest.fixture
def results(toys: Path, tmp_path: Path) -> Results:
    """Four geometric rows of five clips and two steps, the left half inpainted, and the last frame."""
    go(tmp_path / "out", content(predictors={"still": "toy-still"}, **crossed(tmp_path / "log")))
    return Results(tmp_path / "out")


def test_it_is_stored_per_step_and_shown_nowhere_as_a_score(results: Results) -> None:
    # Half of the pixels, three tracked frames out of four and five, and the hindcast's agreement.
    stored = np.reshape(values(results.root, "a--r", "confidence"), (5, 2))
    np.testing.assert_allclose(stored[:, 1] / stored[:, 0], 4 / 5)
    assert (stored[:, 0] > 0).all()
    assert (stored[:, 0] <= 0.5 * 3 / 4).all()
    assert values(results.root, "still", "confidence") == []
    about = results.protocol()["metrics"]["confidence"]
    assert (about["higher_is_better"], about["bounds"]) == (None, [0.0, 1.0])
    assert [column.key for column in tables.build(results)[0].columns] == [METRIC, "toy-gap"]


def test_where_both_fall_with_the_step_the_ranking_is_perfect(results: Results) -> None:
    found = confidence.rankings(results, METRIC)
    assert [label for label, *_ in found] == ["a + r", "a + q", "b + r", "b + q"]
    assert found[0][1:4] == (5, pytest.approx(1), pytest.approx(1))
    assert np.isnan(found[0][4])  # all clips are alike


def test_among_clips_it_is_apart_from_the_step(results: Results) -> None:
    """Errors 0..4 by clip, confidences in the order 1 0 3 2 4 at both steps: -(1 - 6 * 4 / (5 *
    24)) = -0.8.
    """

    def change(row: dict[str, Any]) -> dict[str, Any]:
        number = int(row["clip"][-1])
        changed = {METRIC: float(number), "confidence": [0.1, 0.0, 0.3, 0.2, 0.4][number]}
        return {**row, "value": changed.get(row["metric"], row["value"])}

    rewrite(results, "a--r", change)
    correlations = confidence.rankings(results, METRIC)[0][2:]
    assert correlations == pytest.approx((-0.8, 0, -0.8), abs=1e-9)


def test_values_that_are_not_there_or_do_not_vary_are_left_out() -> None:
    one, other = np.array([1.0, 2, 3, 4, np.nan]), np.array([2.0, 1, 4, 3, 9])
    assert confidence.spearman(one, other) == pytest.approx(0.6)  # 1 - 6 * 4 / (4 * 15)
    assert np.isnan(confidence.spearman(np.ones(5), other))
