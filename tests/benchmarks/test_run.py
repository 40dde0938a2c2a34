"""A run fills what is missing, records what cannot be, and computes nothing twice."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks import plots, report
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.running.executors import Processes
from geovp_benchmarks.running.rescore import rescore, stored_metrics
from geovp_benchmarks.tables import clips, tables
from geovp_classic.errors import GeovpError
from geovp_classic.types import Prediction
from tests.benchmarks.made import STILL, content, crossed, go, rows, values


def samples(count: int) -> Prediction:
    return Prediction(np.zeros((count, 2, 8, 8, 3), np.uint8))


@pytest.mark.usefixtures("toys")
class TestRows:
    def test_covered_pixels_and_trajectories_have_rows_of_their_own(self, tmp_path: Path) -> None:
        go(tmp_path, content(**crossed(tmp_path / "log", step_m=1.5)))
        assert values(tmp_path, "a--r", "toy-difference@covered") == [1.0, 2.0] * 5
        assert values(tmp_path, "a--r", "coverage") == [0.5] * 10
        np.testing.assert_allclose(values(tmp_path, "a--r", "toy-gap"), [0.5, 1.0] * 5)
        # Half of the pixels, and three tracked frames out of four and five; no column of tables.
        stored = np.reshape(values(tmp_path, "a--r", "confidence"), (5, 2))
        np.testing.assert_allclose(stored[:, 1] / stored[:, 0], 4 / 5)
        assert (stored > 0).all()
        assert (stored[:, 0] <= 0.5 * 3 / 4).all()
        columns = tables.build(Results(tmp_path))[0].columns
        assert [column.key for column in columns] == ["toy-difference", "toy-gap"]

    def test_what_was_used_is_written_down(self, tmp_path: Path) -> None:
        methods = go(tmp_path, content(**crossed(tmp_path / "log"), predictors=STILL))
        assert methods["a--r"].privileged_inputs == ["PAST_POSES"]
        assert methods["still"].components == {
            "predictor": {"name": "toy-still", "sleep_s": 0.0, "log": ""}
        }
        protocol = Results(tmp_path).protocol()
        assert protocol["clips"] == [f"road/{i:03d}" for i in range(5)]
        assert protocol["metrics"]["toy-difference"]["unit"] == "grey levels"
        assert (
            protocol["metrics"]["toy-difference"]["definition"] == "mean over pixels and channels"
        )
        assert protocol["dataset"]["num_frames"] == 5


@pytest.mark.usefixtures("toys")
class TestAgain:
    def test_a_limit_takes_no_clips_from_a_folder_that_has_more(self, tmp_path: Path) -> None:
        noise = {"noise": {"name": "toy-noise"}}
        go(tmp_path, content({"clips": 4}, predictors=STILL), limit=3)
        methods = go(tmp_path, content({"clips": 4}, predictors=STILL | noise), limit=2)
        assert [method.num_clips for method in methods.values()] == [3, 2]
        assert len(Results(tmp_path).protocol()["clips"]) == 3

    def test_a_method_that_left_the_matrix_is_noted_below_tables(self, tmp_path: Path) -> None:
        noise = {"noise": {"name": "toy-noise"}}
        for predictors in (STILL | noise, STILL):
            go(tmp_path, content(predictors=predictors))
        notes = tables.build(Results(tmp_path))[0].notes
        [note] = [note for note in notes if "the matrix of the last run" in note]
        assert ": noise (" in note

    def test_old_rows_come_back_with_the_old_settings_and_nothing_is_computed(
        self, tmp_path: Path
    ) -> None:
        log = tmp_path / "log"
        tables = content({"clips": 4}, predictors={"still": {"name": "toy-still", "log": str(log)}})
        go(tmp_path, tables)
        first, tried = rows(tmp_path, "still"), len(log.read_text().split())
        for key, value in (("num_past", 2), ("num_future", 1)):
            go(tmp_path, {**tables, "protocol": {**tables["protocol"], key: value}})
        assert values(tmp_path, "still", "toy-difference") == [1.0] * 4
        assert len(Results(tmp_path).clips().read("road/000").frames) == 4
        assert len(log.read_text().split()) == 3 * tried
        go(tmp_path, tables)
        assert rows(tmp_path, "still") == first
        assert len(Results(tmp_path).clips().read("road/000").frames) == 5
        assert len(log.read_text().split()) == 3 * tried

    def test_a_new_metric_is_computed_and_a_changed_one_again(self, tmp_path: Path) -> None:
        tables = content(predictors=STILL)
        go(tmp_path, tables)
        double = {"name": "toy-difference", "scale": 2.0}
        tables["metrics"] = {
            "frame": {"toy-difference": double, "plain": {"name": "toy-difference"}},
            "trajectory": [],
        }
        go(tmp_path, tables)
        assert values(tmp_path, "still", "toy-difference") == [2.0, 4.0] * 5
        assert values(tmp_path, "still", "plain") == [1.0, 2.0] * 5


@pytest.mark.usefixtures("toys")
class TestFailures:
    def test_a_failure_is_recorded_and_the_matrix_goes_on(self, tmp_path: Path) -> None:
        names = ("broken", "picky", "needless", "uninstalled", "still")
        methods = go(
            tmp_path, content(predictors={name: {"name": f"toy-{name}"} for name in names})
        )
        assert [methods[name].status for name in names] == [
            "failed",
            "skipped",
            "failed",
            "skipped",
            "done",
        ]
        assert methods["broken"].reason == "ZeroDivisionError: the road ended"
        assert "the road ended" in methods["broken"].traceback
        assert methods["picky"].reason == "picky needs a dark road: give one"
        assert "'needless' does not say what it needs" in methods["needless"].reason
        assert "package_that_nobody_has" in methods["uninstalled"].reason

    @pytest.mark.parametrize(
        ("predict", "reason"),
        [
            (lambda *_: None, "predict returned None, expected a Prediction with up to 1 samples"),
            (lambda *_: samples(0), "predicted frames have shape (0, 2, 8, 8, 3)"),
            (lambda *_: samples(2), "predict returned Prediction(frames=[2, 2, 8, 8, 3])"),
            (lambda *_: sys.exit(), "SystemExit"),
        ],
    )
    def test_wrong_outputs_are_recorded(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, predict: Any, reason: str
    ) -> None:
        monkeypatch.setattr("geovp_toys.Still.predict", predict)
        said = go(tmp_path, content(predictors=STILL))["still"].reason
        assert said.startswith(reason)
        assert not said.endswith(":")

    def test_a_clip_that_fails_is_scored_as_a_copy_and_tried_again(self, tmp_path: Path) -> None:
        log = tmp_path / "log"
        broken = {
            "name": "toy-broken",
            "brightness": 32,
            "log": str(log),
        }  # clips 3 and 4 end so bright
        tables = content(
            {"clips": 5}, predictors={"broken": broken, "still": {"name": "toy-still"}}
        )
        method = go(tmp_path, tables, keep="0")["broken"]
        assert (method.status, method.num_clips, len(method.scored.failures)) == ("done", 5, 2)
        assert "the road ended" in method.traceback
        reason = "ZeroDivisionError: the road ended"
        assert [failure.reason for failure in method.scored.failures.values()] == [reason] * 2
        copied = [row["value"] for row in rows(tmp_path, "broken") if row["clip"] == "road/004"]
        assert copied == [1.0, 2.0]  # the road gets brighter by one a frame
        tried = len(log.read_text().split())
        go(tmp_path, tables, keep="0")  # failed clips only: 3 and 4
        assert len(log.read_text().split()) == tried + 2

    def test_tables_report_and_rescoring_count_what_was_shown(self, tmp_path: Path) -> None:
        predictors = {"fallback": {"name": "toy-fallback"}, **STILL}
        metrics = {"frame": ["toy-difference"], "trajectory": []}
        out = Results(tmp_path / "out")
        go(out.root, content({"clips": 5}, metrics, predictors=predictors), keep="all")
        counts = "2 of 5 clips by image motion, 1 by the last frame"
        again = Results(tmp_path / "again")
        rescore(out, again, stored_metrics(out))
        for results in (out, again):
            (note,) = [note for note in tables.build(results)[0].notes if "image motion" in note]
            assert note.startswith(f"fallback: {counts}")
        report.write(out, plots.Options())
        assert f"fallback shows {counts}, and the others" in out.report.read_text()

    def test_tables_say_which_clips_failed_and_leave_them_out_when_asked(
        self, tmp_path: Path
    ) -> None:
        broken = {"name": "toy-broken", "brightness": 32}
        results = Results(tmp_path)
        go(tmp_path, content({"clips": 5}, predictors={"broken": broken, **STILL}))
        said, strict = (tables.build(results, strict=strict)[0] for strict in (False, True))
        assert (said.rows[0].num_clips, strict.rows[0].num_clips) == (5, 3)
        words = (
            "broken: 2 of 5 clips could not be predicted, scored as copies of the last frame if "
            "readable (--strict leaves them out)"
        )
        note = f"{words}: road/003, road/004: ZeroDivisionError: the road ended."
        assert note in said.notes
        assert note in tables.against(results.select("still"), "broken").notes
        heading, *lines = clips.per_clip(results.select("broken"))
        assert heading[1:4] == [
            "broken: toy difference (grey levels)",
            "broken: shown by",
            "labels",
        ]
        shown = {clip: (score, way) for clip, score, way, *_ in lines}
        assert shown["road/004"] == (1.5, "a copy (failed)")
        assert shown["road/002"] == (1.5, None)
        assert any("could not be predicted, left out" in note for note in strict.notes)

    def test_a_part_that_does_not_suit_a_clip_is_not_tried_again(self, tmp_path: Path) -> None:
        log = tmp_path / "log"
        picky = {"name": "toy-picky", "brightness": 32, "log": str(log)}
        matrix = content({"clips": 5}, predictors={"picky": picky})
        assert go(tmp_path, matrix)["picky"].scored.failures.keys() == {"road/003", "road/004"}
        tried = log.read_text()
        assert go(tmp_path, matrix)["picky"].scored.failures.keys() == {"road/003", "road/004"}
        assert log.read_text() == tried

    def test_a_metric_without_its_weights_is_a_column_without_numbers(self, tmp_path: Path) -> None:
        weights = tmp_path / "weights"
        metrics = {
            "frame": {
                "toy-difference": "toy-difference",
                "toy-weightless": {"name": "toy-weightless", "weights": str(weights)},
                "scalar": {"name": "toy-weightless", "weights": str(tmp_path)},
            },
            "trajectory": [],
        }
        tables = content(metrics=metrics, predictors=STILL)
        assert go(tmp_path, tables)["still"].status == "done"
        entry = Results(tmp_path).protocol()["metrics"]["toy-weightless"]
        assert entry["unavailable"] == "weights of toy-weightless are not here: fetch them"
        assert values(tmp_path, "still", "toy-weightless") == []
        scalar = Results(tmp_path).protocol()["metrics"]["scalar"]
        assert scalar["unavailable"].startswith("ValueError: it returns values of shape ()")
        weights.touch()
        go(tmp_path, tables)
        assert values(tmp_path, "still", "toy-weightless") == [0.0] * 10
        weights.unlink()
        go(tmp_path, tables)  # losing them again costs nothing that was computed
        assert values(tmp_path, "still", "toy-weightless") == [0.0] * 10

    def test_a_method_that_predicted_nothing_leaves_nothing_but_earlier_settings(
        self, tmp_path: Path
    ) -> None:
        log, name = tmp_path / "log", "other"
        table = {"name": "toy-broken", "brightness": 255, "log": str(log)}
        go(tmp_path, content(predictors={name: table}), keep="all")
        before = rows(tmp_path, name)
        misfit = content(predictors={name: {"name": "toy-picky", "log": str(log)}})
        for _ in range(2):
            assert go(tmp_path, misfit, keep="all")[name].status == "skipped"
            results = Results(tmp_path)
            assert (
                results.by_name()[name].scored,
                results.predictions(results.by_name()[name]).names,
            ) == ({}, [])
        tried = len(log.read_text().split())
        assert go(tmp_path, content(predictors={name: table}), keep="all")[name].status == "done"
        assert rows(tmp_path, name) == before != []
        assert len(log.read_text().split()) == tried

    def test_rows_of_another_machine_stay_when_their_method_cannot_be_built_here(
        self, tmp_path: Path
    ) -> None:
        tables = content(
            predictors={"still": {"name": "toy-still"}, "gone": {"name": "toy-uninstalled"}}
        )
        go(tmp_path, tables)
        results = Results(tmp_path)
        record = results.by_name()["still"].scored["road/000"]
        results.write_scores([(results.scores("still"), replace(record, method="gone"))])
        there = json.loads((tmp_path / "still/method.json").read_text())
        here = json.loads((tmp_path / "gone/method.json").read_text())
        gone = {**there, **{key: here[key] for key in ("label", "asked")}}
        results.write_method(Method(name="gone", **gone))
        assert go(tmp_path, tables)["gone"].status == "done"
        assert len(rows(tmp_path, "gone")) == 10
        tables["predictors"]["gone"]["seed"] = 3
        assert go(tmp_path, tables)["gone"].status == "skipped"
        assert rows(tmp_path, "gone") == []

    def test_a_users_mistake_is_one_sentence_before_anything_runs(self, tmp_path: Path) -> None:
        with pytest.raises(GeovpError, match="'toy-stil': did you mean 'toy-still'"):
            go(tmp_path, content(predictors={**STILL, "x": "toy-stil"}))
        assert not list(tmp_path.glob("*/scores"))


def test_processes_give_the_rows_of_one_process(tmp_path: Path, toys: Path) -> None:
    broken, noise = (
        {"name": "toy-broken", "brightness": 25},
        {"name": "toy-noise", "num_samples": 2},
    )
    tables = content(
        {"clips": 7}, **crossed(tmp_path / "log"), predictors={"noise": noise, "broken": broken}
    )
    alone, together = (
        go(tmp_path / "one", tables),
        go(tmp_path / "two", tables, executor=Processes(workers=2)),
    )
    for name, method in alone.items():
        assert (method.status, method.reason) == (together[name].status, together[name].reason)
        assert rows(tmp_path / "one", name) == rows(tmp_path / "two", name)
