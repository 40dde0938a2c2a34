"""What is written comes back, whole or not at all."""

import dataclasses
import resource
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.failure import Failure
from geovp_benchmarks.results.score_files import Facts
from geovp_benchmarks.results.store import Results, ScoreRecord, Scores, write_bytes
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Intrinsics, Motion, Prediction, Trajectory
from tests.benchmarks.made import dicts, scores, write_protocol, write_row

CAMERA = Intrinsics(20.0, 21.0, 7.5, 5.5, 16, 12)
NAME = "03[180:360)/000010 a"


def trajectory(count: int) -> Trajectory:
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 2, 3] = np.arange(count)
    return Trajectory(poses, np.arange(count) * 0.1, is_metric=True)


def clip(**more: Any) -> Clip:
    frames = np.random.default_rng(0).integers(0, 256, (5, 12, 16, 3), dtype=np.uint8)
    return Clip(NAME, frames, np.arange(5) * 0.1, CAMERA, **more)


def values(results: Results) -> list[float | None]:
    return [row["value"] for row in dicts(results.scores("x"))]


def begun(root: Path, fingerprint: str = "f") -> Results:
    results = Results(root)
    write_protocol(results, "xy", ["a", "b", "it's"])
    write_row(results, "x", fingerprint=fingerprint, status="partial")
    return results


def test_a_clip_comes_back(tmp_path: Path) -> None:
    depths = np.full((5, 12, 16), np.inf, np.float32)
    moving = np.zeros((5, 12, 16), bool)
    kept = clip(trajectory=trajectory(5), depths=depths, moving=moving, camera_height_m=1.65)
    results = begun(tmp_path)
    results.clips().write(NAME, kept)
    assert results.clips().names == [NAME]
    back = results.clips().read(NAME)
    np.testing.assert_array_equal(back.frames, kept.frames)
    np.testing.assert_array_equal(back.depths, depths)
    np.testing.assert_array_equal(back.moving, moving)
    np.testing.assert_array_equal(back.trajectory.world_from_cam, trajectory(5).world_from_cam)
    assert back.trajectory.is_metric
    assert (back.intrinsics, back.camera_height_m) == (CAMERA, 1.65)
    results.clips().write(NAME, clip())
    back = results.clips().read(NAME)
    assert back.trajectory is back.depths is back.moving is back.camera_height_m is None


def test_a_prediction_comes_back_with_and_without_motion(tmp_path: Path) -> None:
    frames = np.arange(2 * 3 * 4 * 5 * 3, dtype=np.uint8).reshape(2, 3, 4, 5, 3)
    covered = np.ones((2, 3, 4, 5), bool)
    past = dataclasses.replace(trajectory(2), scale_uncertainty=0.5)
    motion = Motion(past, np.tile(np.eye(4), (2, 3, 1, 1)), np.array([True, False]))
    results = begun(tmp_path)
    kept = results.predictions(results.by_name()["x"])
    kept.write(NAME, Prediction(frames, covered, motion))
    assert kept.names == [NAME]
    back = kept.read(NAME)
    np.testing.assert_array_equal(back.frames, frames)
    assert back.covered is not None
    np.testing.assert_array_equal(back.motion.futures, motion.futures)
    np.testing.assert_array_equal(back.motion.tracked, [True, False])
    assert back.motion.past.scale_uncertainty == 0.5
    kept.write(NAME, Prediction(frames))
    assert (kept.read(NAME).covered, kept.read(NAME).motion) == (None, None)


def file_of(results: Results, values: Scores, *about: Any) -> Path:
    """Write a score file of method x and return its path."""
    folder = results.root / "x/scores"
    before = set(folder.glob("*"))
    results.write_scores([(values, ScoreRecord("x", *about))])
    (path,) = set(folder.glob("*")) - before
    return path


def rows_of(clip: str, *values: float | None) -> Scores:
    return scores((clip, 0, step, "psnr", value) for step, value in enumerate(values, 1))


def test_rows_come_back_in_the_order_of_clips_and_undefined_is_null(tmp_path: Path) -> None:
    results = begun(tmp_path)
    file_of(results, rows_of("b", 3.0, None), ["b"], "f", {}, {"view": 2.0}, 10.0)
    file_of(results, rows_of("a", 1.0), ["a"], "f", {}, {"view": 1.0}, 11.0)
    assert values(results) == [1.0, 3.0]  # a value that is not defined is NaN
    seconds = {clip: record.seconds for clip, record in results.by_name()["x"].scored.items()}
    assert seconds == {"a": {"view": 1.0}, "b": {"view": 2.0}}


def test_the_newest_scores_of_wanted_clips_count_also_when_merged(tmp_path: Path) -> None:
    results = begun(tmp_path)
    file_of(results, scores([(c, 0, 1, "psnr", 1.0) for c in "acb"]), ["a", "c", "b"], "f", {},
            {"view": 3.0}, 1.0)  # fmt: skip
    for value in (3.0, 2.0):
        file_of(results, rows_of("a", value), ["a"], "f", {}, {"view": 1.0}, 1.0)
    for _ in range(2):
        assert values(results) == [2.0, 1.0]
        assert results.by_name()["x"].scored.seconds["view"] == pytest.approx(2.0)
        assert [*results.by_name()["x"].scored] == ["a", "b"]
        results.merge([results.by_name()["x"]])
    assert len(list((tmp_path / "x/scores").iterdir())) == 1
    write_protocol(results, "x", "c")
    assert values(results) == [1.0]  # clips that are not wanted now are still stored


def test_scores_of_an_older_method_do_not_count_and_half_a_file_is_named(tmp_path: Path) -> None:
    results = begun(tmp_path, fingerprint="new")
    file_of(results, rows_of("a", 1.0), ["a"], "old", {}, {}, 0.0)
    cut = file_of(results, rows_of("b", 2.0), ["b"], "new", {}, {}, 0.0)
    other = file_of(results, rows_of("a", 3.0), ["a"], "new", {}, {}, 0.0)
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    with pytest.raises(BadData, match=rf"{cut.name} is damaged"):
        results.scores("x")
    assert results.damaged_files() == [cut]
    cut.unlink()
    assert values(Results(tmp_path)) == [3.0]
    assert other.exists()


def test_a_table_is_read_while_files_are_merged(tmp_path: Path) -> None:
    results, reader = begun(tmp_path), Results(tmp_path)
    for clip_name in "ab":
        file_of(results, rows_of(clip_name, 1.0), [clip_name], "f", {}, {}, 0.0)
    read, merges = reader._score_files.scores, [results.merge]

    def scores_after_merge(*parts_and_clips: Any) -> Scores:
        while merges:
            merges.pop()([results.by_name()["x"]])
        return read(*parts_and_clips)

    reader._score_files.scores = scores_after_merge  # type: ignore[method-assign]
    assert values(reader) == [1.0, 1.0]


def test_names_may_hold_quotes_and_values_may_be_undefined_or_infinite(tmp_path: Path) -> None:
    failure = Failure("failed", "'\0\n\u00fc")
    about = ScoreRecord("x", ["it's"], "f", {"m'": {"a": "'"}}, failures={"it's": failure})
    stored = scores(
        ("it's", 0, step, "m'", value) for step, value in enumerate((1.0, None, float("inf")), 1)
    )
    results = begun(tmp_path)
    results.write_scores([(stored, about)])
    assert dicts(results.scores("x")) == dicts(stored)
    record = results.by_name()["x"].scored["it's"]
    assert record.metrics == {"m'": {"a": "'"}}
    assert record.failures == {"it's": failure}


def test_no_room_for_a_part_is_an_error_of_the_system(tmp_path: Path) -> None:
    results, before = begun(tmp_path), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            results.write_scores([(rows_of("a", 1.0), ScoreRecord("x", ["a"], "f"))])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    results.write_scores([(rows_of("a", 1.0), ScoreRecord("x", ["a"], "f"))])
    assert values(results) == [1.0]


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "protocol.json"
    write_bytes(path, b"old")
    with pytest.raises(ValueError, match="float"):
        Results(tmp_path).write_protocol({"stride": float("nan")})
    assert path.read_bytes() == b"old"
    assert [each.name for each in tmp_path.iterdir()] == ["protocol.json"]


def test_facts_and_failures_of_clips_are_gathered_from_parts(tmp_path: Path) -> None:
    results = begun(tmp_path)
    failures = {"b": Failure("failed", "no features", "trace")}
    for index, name in enumerate("ab"):
        facts: Facts = {name: {"yaw_deg": float(index)}}
        record = ScoreRecord(
            "x", [name], "f", failures=failures, facts=facts, shown_by={name: f"way {name}"}
        )
        results.write_scores([(rows_of(name, 1.0), record)])
    assert results.by_name()["x"].scored.failures == failures
    assert results.clip_facts() == {"a": {"yaw_deg": 0.0}, "b": {"yaw_deg": 1.0}}
    results.merge([results.by_name()["x"]])
    write_protocol(results, "x", "b")
    assert results.clip_facts() == {"b": {"yaw_deg": 1.0}}
    assert results.by_name()["x"].scored.shown_by == {"b": "way b"}


def test_damaged_kept_files_are_noticed(tmp_path: Path) -> None:
    results = begun(tmp_path)
    results.clips().write(NAME, clip())
    results.predictions(results.by_name()["x"]).write("good", Prediction(clip().frames[None]))
    results.predictions(results.by_name()["x"]).write("bad", Prediction(clip().frames[None]))
    (results.root / "x/predictions/.scratch.npz").write_bytes(b"")
    bad = tmp_path / "x/predictions/bad.f.npz"
    (kept,) = (tmp_path / "clips").iterdir()
    for path in (bad, kept):
        path.write_bytes(path.read_bytes()[:-30])
    assert results.damaged_files() == [kept, bad]


def test_a_pickle_is_not_read(tmp_path: Path) -> None:
    results = begun(tmp_path)
    (tmp_path / "clips").mkdir()
    np.savez(tmp_path / "clips" / "evil..npz", frames=np.array([object()]))
    with pytest.raises(BadData, match="evil"):
        results.clips().read("evil")
