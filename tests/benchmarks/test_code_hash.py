"""Rows say which code computed them; a change of the code is told, and nothing is lost or mixed in
silence.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from geovp import progress, provenance
from geovp.provenance import code_hash, sources
from geovp_benchmarks.matrix import schema as matrices
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.running import plan, scoring, task
from geovp_benchmarks.running.executors import Serial
from geovp_benchmarks.running.plan import Plan
from geovp_benchmarks.running.run import run
from geovp_benchmarks.tables import tables
from geovp_classic.pose_sources.constant_turn import ConstantTurn
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from tests.benchmarks.made import STILL, content

CLIPS = 5
MATRIX = content(metrics={"frame": ["toy-difference"]}, predictors=STILL)


def go(root: Path, caplog: pytest.LogCaptureFixture, **options: Any) -> tuple[Method, list[int]]:
    """The one method of the matrix, and how many clips were computed for it at each report."""
    caplog.clear()
    (method,) = run(Plan(matrices.parse("m", MATRIX), Results(root), **options), Serial())
    steps = (record.args for record in caplog.records if record.name == progress.steps.name)
    return method, [step[0] for step in steps if isinstance(step, tuple) and step]  # type: ignore[misc]


@pytest.mark.usefixtures("toys")
def test_rows_of_other_code_are_kept_and_told_and_fresh_computes_just_those(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    code = ["before"]
    for module in (plan, task):
        monkeypatch.setattr(module, "code_of", lambda _: code[0])
    go(tmp_path, caplog, limit=2)
    code[0] = "after"
    method, done = go(tmp_path, caplog)
    assert (method.status, method.num_clips, method.num_outdated) == ("done", CLIPS, 2)
    assert done[-1] == CLIPS - 2
    notes = tables.build(Results(tmp_path))[0].notes
    assert "still: computed by another version of the code, or partly." in notes
    method, done = go(tmp_path, caplog, is_fresh=True)
    assert (method.num_clips, method.num_outdated, done[-1]) == (CLIPS, 0, 2)
    _, done = go(tmp_path, caplog, is_fresh=True)
    assert done == [0]


class TestCode:
    @pytest.fixture
    def package(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
        """Return a package of a user with one component that uses one of its other modules."""
        folder = tmp_path / "somebodys_package"
        folder.mkdir()
        (folder / "__init__.py").write_text("")
        (folder / "parts.py").write_text(
            "class Hover:\n    def f(self):\n        from . import used\n"
        )
        for name in ("used", "unused"):
            (folder / f"{name}.py").write_text("")
        monkeypatch.syspath_prepend(tmp_path)
        yield folder
        provenance._source.cache_clear()
        for name in [name for name in sys.modules if name.startswith("somebodys_package")]:
            del sys.modules[name]

    def test_a_change_counts_in_the_modules_that_a_component_uses_alone(
        self, package: Path
    ) -> None:
        hover = importlib.import_module("somebodys_package.parts").Hover()
        before, ours = code_hash([hover]), code_hash([CopyLast()])
        assert before != ours
        for name, is_other in (("unused", False), ("used", True)):
            (package / f"{name}.py").write_text("SPEED = 3\n")
            provenance._source.cache_clear()
            assert (code_hash([hover]) != before) == is_other
        assert code_hash([CopyLast()]) == ours

    def test_a_loader_does_not_count_for_a_predictor(self) -> None:
        fusion = GeometricPredictor(ConstantTurn(), DepthFusion())
        for component in (CopyLast(), fusion):
            used = sources([component], [task.__name__, scoring.__name__])
            assert "geovp_classic.data.layouts.kitti" not in used
            assert {type(component).__module__, "geovp_classic.metrics.strata"} <= used.keys()
        assert {"geovp_classic.rendering.fusion", "geovp_classic.depth.multiview"} <= used.keys()
