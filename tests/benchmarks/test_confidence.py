"""The confidence of stored predictions."""

from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import tables
from tests.benchmarks.made import content, crossed, go, values

METRIC = "toy-difference"


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
