"""What is written comes back, whole or not at all."""

import dataclasses
import json
import multiprocessing
import os
import resource
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pytest

from geovp_benchmarks import part_files
from geovp_benchmarks.store import Part, Results, Rows, check_clip_name, write_bytes
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.types import Clip, Intrinsics, Motion, Prediction, Trajectory
from tests.benchmarks.made import dicts, scores, write_row

CAMERA = Intrinsics(20.0, 21.0, 7.5, 5.5, 16, 12)
NAME = "03[180:360)/000010 a"


def trajectory(count: int) -> Trajectory:
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 2, 3] = np.arange(count)
    return Trajectory(poses, np.arange(count) * 0.1, is_metric=True)


def clip(**more: Any) -> Clip:
    frames = np.random.default_rng(0).integers(0, 256, (5, 12, 16, 3), dtype=np.uint8)
    return Clip(NAME, frames, np.arange(5) * 0.1, CAMERA, **more)


def rows(*values: float | None) -> Rows:
    return scores(("a", 0, step, "psnr", value) for step, value in enumerate(values, 1))


def values(results: Results) -> list[float | None]:
    return [row["value"] for row in dicts(results.scores("x"))]


def begun(root: Path, fingerprint: str = "f") -> Results:
    results = Results(root)
    results.write_protocol({"cells": ["x", "y"]})
    write_row(results, "x", fingerprint=fingerprint, status="partial")
    return results


def test_a_clip_comes_back(tmp_path: Path) -> None:
    depths = np.full((5, 12, 16), np.inf, np.float32)
    moving = np.zeros((5, 12, 16), bool)
    kept = clip(trajectory=trajectory(5), depths=depths, moving=moving, camera_height_m=1.65)
    results = Results(tmp_path)
    results.write_clip(kept)
    assert [name for name, _ in results.clips()] == [NAME]
    back = results.clip(NAME)
    np.testing.assert_array_equal(back.frames, kept.frames)
    np.testing.assert_array_equal(back.depths, depths)
    np.testing.assert_array_equal(back.moving, moving)
    assert back.trajectory is not None
    np.testing.assert_array_equal(back.trajectory.world_from_cam, trajectory(5).world_from_cam)
    assert (back.intrinsics, back.camera_height_m, back.trajectory.is_metric) == (
        CAMERA,
        1.65,
        True,
    )


def test_a_clip_of_images_alone_comes_back(tmp_path: Path) -> None:
    Results(tmp_path).write_clip(clip())
    back = Results(tmp_path).clip(NAME)
    assert (back.trajectory, back.depths, back.moving, back.camera_height_m) == (
        None,
        None,
        None,
        None,
    )


def test_a_prediction_comes_back_with_and_without_motion(tmp_path: Path) -> None:
    frames = np.arange(2 * 3 * 4 * 5 * 3, dtype=np.uint8).reshape(2, 3, 4, 5, 3)
    covered = np.ones((2, 3, 4, 5), bool)
    past = dataclasses.replace(trajectory(2), scale_uncertainty=0.5)
    motion = Motion(past, np.tile(np.eye(4), (2, 3, 1, 1)), np.array([True, False]))
    results = Results(tmp_path)
    results.write_prediction("x", NAME, Prediction(frames, covered, motion))
    results.write_prediction("y", NAME, Prediction(frames))
    assert [name for name, _ in results.predictions("x")] == [NAME]
    back = results.prediction("x", NAME)
    np.testing.assert_array_equal(back.frames, frames)
    assert back.motion is not None
    assert back.covered is not None
    np.testing.assert_array_equal(back.motion.futures, motion.futures)
    np.testing.assert_array_equal(back.motion.tracked, [True, False])
    assert back.motion.past.scale_uncertainty == 0.5
    plain = results.prediction("y", NAME)
    assert (plain.covered, plain.motion) == (None, None)


def test_rows_come_back_in_the_order_of_parts_and_undefined_is_null(tmp_path: Path) -> None:
    results = begun(tmp_path)
    results.write_part("x", rows(3.0, None), Part(1, ("b",), "f", {}, {"view": 2.0}, 10.0))
    results.write_part("x", rows(1.0), Part(0, ("a",), "f", {}, {"view": 1.0}, 11.0))
    assert values(results) == [1.0, 3.0, None]
    assert [(part.index, part.clips, part.seconds) for part in results.parts("x")] == [
        (0, ("a",), {"view": 1.0}),
        (1, ("b",), {"view": 2.0}),
    ]


def test_parts_of_an_older_cell_do_not_count_and_half_a_file_is_named(tmp_path: Path) -> None:
    results = begun(tmp_path, fingerprint="new")
    results.write_part("x", rows(1.0), Part(0, ("a",), "old", {}, {}, 0.0))
    results.write_part("x", rows(2.0), Part(1, ("b",), "new", {}, {}, 0.0))
    whole = (tmp_path / "x/scores/part-00001.parquet").read_bytes()
    (tmp_path / "x/scores/part-00002.parquet").write_bytes(whole[: len(whole) // 2])
    assert [part.index for part in results.parts("x")] == [1]
    with pytest.raises(
        BadData,
        match=r"part-00002.parquet is damaged: `geovp run` sets it aside and computes it again",
    ):
        results.scores("x")
    assert [path.name for path in results.set_damaged_aside("x")] == ["part-00002.parquet"]
    assert values(results) == [2.0]
    assert (tmp_path / "x/scores/part-00002.parquet.damaged").exists()


def test_a_peak_is_the_cells_own_only_where_its_part_says_so(tmp_path: Path) -> None:
    results = begun(tmp_path)
    results.write_part("x", rows(1.0), Part(0, ("a",), "f", {}, {}, 10.0, peak_is_own=True))
    older = {
        "clips": ["b"],
        "fingerprint": "f",
        "metrics": {},
        "seconds": {},
        "peak_memory_mb": 11.0,
    }
    write_unsealed(tmp_path / "x/scores/part-00001.parquet", ROW, older)
    told = [(part.clips, part.peak_memory_mb, part.peak_is_own) for part in results.parts("x")]
    assert told == [(("a",), 10.0, True), (("b",), 11.0, False)]


def test_a_part_that_pyarrow_wrote_is_read(tmp_path: Path) -> None:
    results = begun(tmp_path)
    write_bytes(
        tmp_path / "x/scores/part-00000.parquet",
        (Path(__file__).parent / "older/pyarrow-26.parquet").read_bytes(),
    )
    assert [*results.scores("x").of_clips(["b"]).lines()] == [("b", 0, 1, "psnr", 30.0)]
    assert values(results) == [20.5, None, 30.0]
    assert results.parts("x") == [
        Part(0, ("a", "b"), "f", {"psnr": {}}, {"view": 2.5}, 100.0, code="c0de")
    ]


ROW = "SELECT 'b' AS clip, 0 AS sample, 1 AS step, 'psnr' AS metric, 2.0 AS value"
HOSTILE = {
    "SELECT * REPLACE (NULL::VARCHAR AS clip)": "a row without a clip, sample, step or metric",
    "SELECT * REPLACE (NULL AS step)": "a row without a clip, sample, step or metric",
    "SELECT * REPLACE (-1 AS sample)": "a negative sample or step",
    "SELECT * REPLACE (0 AS step)": "a negative sample or step",
    "SELECT * REPLACE (4294967296 AS step)": ".* out of range .*",
    "SELECT * REPLACE ('much' AS value)": ".* Could not convert string 'much' to DOUBLE.*",
    "SELECT * REPLACE (repeat('b', 1001) AS metric)": ".*a name of more than 1000 bytes",
    "SELECT * EXCLUDE (value)": '.*"value".*',
    "SELECT 1 AS clip": ".*",
    f"SELECT * EXCLUDE (n) FROM range({part_files.ROWS_AT_ONCE}) AS numbers(n),": "more than 1000 rows",
}


def write_unsealed(path: Path, rows: str, about: Any) -> None:
    """A part of an older version, or one that somebody made up."""
    key_value = f"KV_METADATA {{geovp: '{json.dumps(about)}'}}"
    duckdb.sql(f"COPY ({rows}) TO '{path}' (FORMAT parquet, {key_value})")


@pytest.mark.parametrize("choice", HOSTILE)
def test_a_part_with_other_columns_is_refused_in_a_sentence(
    tmp_path: Path, choice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(part_files, "LIMIT_ROWS", 1000)
    results = begun(tmp_path)
    results.write_part("x", rows(1.0), Part(0, ("a",), "f", {}, {}, 0.0))
    about = {
        "clips": ["b"],
        "fingerprint": "f",
        "metrics": {},
        "seconds": {},
        "peak_memory_mb": 11.0,
    }
    path = tmp_path / "x/scores/part-00001.parquet"
    write_unsealed(path, f"{choice}{'' if choice.endswith(',') else ' FROM'} ({ROW})", about)
    reason = rf"^.*part-00001.parquet is no part of results \({HOSTILE[choice]}\): remove it and run again$"
    with pytest.raises(BadData, match=reason):
        results.scores("x")
    path.unlink()
    assert values(results) == [1.0]


def test_rows_that_no_memory_can_hold_as_an_array_are_refused(tmp_path: Path) -> None:
    results = begun(tmp_path)
    results.write_part(
        "x", scores([("a", 2**20, 1, "psnr", 1.0)]), Part(0, ("a",), "f", {}, {}, 0.0)
    )
    assert values(results) == [1.0]
    results.write_part(
        "x", scores([("b", 0, 2**10, "psnr", 1.0)]), Part(1, ("b",), "f", {}, {}, 0.0)
    )
    with pytest.raises(
        BadData,
        match="x has rows of 2 clips, 1048577 samples and 1024 steps, which no run has: remove",
    ):
        results.scores("x")


def test_equal_rows_are_equal_bytes_and_names_may_hold_quotes(tmp_path: Path) -> None:
    about = Part(
        0,
        ("it's",),
        "f",
        {"m'": {"a": "'"}},
        {},
        0.0,
        failures={"it's": ("failed", "'\0\n\u00fc", "")},
    )
    stored = scores(
        ("it's", 0, step, "m'", value) for step, value in enumerate((1.0, None, float("inf")), 1)
    )
    written = []
    for root in (tmp_path / "a", tmp_path / "a longer name"):
        results = begun(root)
        results.write_part("x", stored, about)
        written.append((root / "x/scores/part-00000.parquet").read_bytes())
        assert dicts(results.scores("x")) == dicts(stored)
        assert [(part.clips, part.metrics, part.failures) for part in results.parts("x")] == [
            (("it's",), {"m'": {"a": "'"}}, {"it's": ["failed", "'\0\n\u00fc", ""]})
        ]
    assert written[0] == written[1]


def test_a_part_of_more_rows_than_are_read_at_once_comes_back(tmp_path: Path) -> None:
    count = part_files.ROWS_AT_ONCE + 1
    results, clips = begun(tmp_path), [f"clip {number // 1000}" for number in range(count)]
    stored = Rows.of(
        clips, [0] * count, np.arange(count) % 1000 + 1, ["psnr"] * count, np.arange(count)
    )
    results.write_part("x", stored, Part(0, tuple(stored.clip.categories), "f", {}, {}, 0.0))
    found = results.scores("x")
    assert found.clip.categories == stored.clip.categories
    for one, other in ((found.clip.codes, stored.clip.codes), (found.step, stored.step)):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(found.value, np.arange(count))


def test_no_room_for_a_part_is_an_error_of_the_system(tmp_path: Path) -> None:
    results, before = begun(tmp_path), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with pytest.raises(OSError, match="Could not write"):
            results.write_part("x", rows(1.0), Part(0, ("a",), "f", {}, {}, 0.0))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    results.write_part("x", rows(1.0), Part(0, ("a",), "f", {}, {}, 0.0))
    assert values(results) == [1.0]


def test_the_database_sees_no_other_file(tmp_path: Path) -> None:
    (tmp_path / "secret.csv").write_text("1")
    with (
        pytest.raises(GeovpError, match="refuses a file"),
        part_files._database() as (database, _, _),
    ):
        database.execute(f"SELECT * FROM read_csv('{tmp_path}/secret.csv')")
    with part_files._database() as (database, _, _), pytest.raises(duckdb.Error, match="locked"):
        database.execute("SET enable_external_access = true")


def _file_of_the_database() -> int:
    with part_files._database() as (_, file, _):
        return os.fstat(file.fileno()).st_ino


def test_a_fork_writes_parts_into_a_file_of_its_own() -> None:
    own = _file_of_the_database()
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply(_file_of_the_database) != own
    assert _file_of_the_database() == own


def test_one_other_bit_in_the_middle_of_a_part_is_noticed(tmp_path: Path) -> None:
    results = begun(tmp_path)
    results.write_part("x", rows(*np.linspace(1, 2, 200)), Part(0, ("a",), "f", {}, {}, 0.0))
    path = tmp_path / "x/scores/part-00000.parquet"
    whole = path.read_bytes()
    path.write_bytes(whole[:700] + bytes([whole[700] ^ 4]) + whole[701:])
    with pytest.raises(BadData, match="is damaged"):
        results.scores("x")
    path.write_bytes(whole)
    assert len(results.scores("x")) == 200


def test_nothing_begun_is_no_rows(tmp_path: Path) -> None:
    results = begun(tmp_path)
    assert results.cell("y") is None
    assert [cell.name for cell in results.cells()] == ["x"]
    assert len(results.scores("y")) == 0


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "cell.json"
    write_bytes(path, b"old")
    with pytest.raises(ValueError, match="float"):
        Results(tmp_path.parent).write_cell(tmp_path.name, {"seconds": float("nan")})
    assert path.read_bytes() == b"old"
    assert [each.name for each in tmp_path.iterdir()] == ["cell.json"]


def test_a_pickle_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "clips").mkdir()
    np.savez(tmp_path / "clips" / "evil.npz", frames=np.array([object()]))
    with pytest.raises(BadData, match="evil"):
        Results(tmp_path).clip("evil")


def test_a_folder_that_is_none_of_ours_is_said_to_be_so(tmp_path: Path) -> None:
    with pytest.raises(BadData, match="not a results folder"):
        Results(tmp_path).protocol()


def test_several_data_sets_are_folders_beside_each_other(tmp_path: Path) -> None:
    results = Results(tmp_path)
    assert results.by_dataset() == {"": results}
    results.write_datasets(["near", "far"])
    assert results.by_dataset() == {
        "near": Results(tmp_path / "near"),
        "far": Results(tmp_path / "far"),
    }
    with pytest.raises(
        BadData, match=rf"holds several data sets: give one, such as {tmp_path / 'far'}$"
    ):
        results.protocol()
    for _ in range(2):  # what is not there need not be removed
        results.write_datasets([""])
        assert results.by_dataset() == {"": results}


def test_a_folder_is_begun_with_its_protocol(tmp_path: Path) -> None:
    assert not Results(tmp_path).begun
    assert begun(tmp_path).begun


def test_views_have_their_places(tmp_path: Path) -> None:
    results = Results(tmp_path)
    assert (results.tables, results.plots) == (tmp_path / "tables", tmp_path / "plots")
    assert results.report == tmp_path / "report.html"
    assert results.recording(NAME) == tmp_path / "recordings/03%5B180%3A360%29%2F000010 a.rrd"


@pytest.mark.parametrize("other", ["e", "g", ""])
def test_only_parts_of_the_same_settings_count(other: str, tmp_path: Path) -> None:
    results = begun(tmp_path)
    results.write_part("x", rows(1.0), Part(0, ("a",), other, {}, {}, 0.0))
    assert results.parts("x") == []


def test_facts_and_failures_of_clips_are_gathered_from_parts(tmp_path: Path) -> None:
    results = begun(tmp_path)
    failed = {"b": ("failed", "no features", "trace")}
    results.write_part(
        "x", rows(1.0), Part(0, ("a",), "f", {}, {}, 0.0, facts={"a": {"yaw_deg": 2.0}})
    )
    results.write_part(
        "x",
        rows(1.0),
        Part(1, ("b",), "f", {}, {}, 0.0, failures=failed, facts={"b": {"yaw_deg": 3.0}}),
    )
    assert results.failures("x") == {"b": "no features"}
    assert results.clip_facts() == {"a": {"yaw_deg": 2.0}, "b": {"yaw_deg": 3.0}}


def test_cells_and_clips_of_earlier_settings_come_back_with_these(tmp_path: Path) -> None:
    results = begun(tmp_path, "old")
    results.write_part("x", rows(1.0), Part(0, ("a",), "old", {}, {}, 0.0))
    results.swap("x", "old", "new")
    assert not (tmp_path / "x").exists()
    begun(tmp_path, "new").write_part("x", rows(2.0, 3.0), Part(0, ("a",), "new", {}, {}, 0.0))
    assert values(results.with_rows_of("x", "new")) == [2.0, 3.0]
    assert results.set_aside() == {tmp_path / "earlier/old/x"}
    assert results.with_rows_of("x", "old").root == tmp_path / "earlier/old"
    results.swap("x", "new", "old")
    assert results.set_aside() == {tmp_path / "earlier/new/x"}
    assert values(results) == [1.0]
    results.swap(
        "x", "old", "0123456789abcdef0"
    )  # a folder is named by 16 letters, and replaces one before it
    results.write_clip(clip())
    results.swap("clips", "", "other")
    assert {path.relative_to(tmp_path / "earlier").as_posix() for path in results.set_aside()} == {
        "new/x",
        "old/x",
        "unknown/clips",
    }
    assert results.with_rows_of("x", "0123456789abcdef0").root.name == "0123456789abcdef"


def test_a_cell_without_rows_is_not_set_aside(tmp_path: Path) -> None:
    results = begun(tmp_path)
    results.swap("x", "f", "g")
    assert not (tmp_path / "x").exists()
    assert results.set_aside() == set()


def test_what_is_set_aside_replaces_what_was(tmp_path: Path) -> None:
    for value in (1.0, 2.0):
        begun(tmp_path).write_part("x", rows(value), Part(0, ("a",), "f", {}, {}, 0.0))
        Results(tmp_path).swap("x", "f", "g")
    Results(tmp_path).swap("x", "g", "f")
    assert values(Results(tmp_path)) == [2.0]


def test_kept_clips_belong_to_the_protocol_of_their_fingerprint(tmp_path: Path) -> None:
    assert Results(tmp_path).with_clips_of("f").root == tmp_path / "earlier/f"
    results = begun(tmp_path)
    results.write_protocol({"cells": ["x"], "fingerprint": "f"})
    assert results.with_clips_of("f") is results
    for other in ("e", "g"):
        assert results.with_clips_of(other).root == tmp_path / "earlier" / other


def test_damaged_kept_files_are_set_aside_by_cell_or_for_all(tmp_path: Path) -> None:
    results = begun(tmp_path)
    results.write_clip(clip())
    results.write_prediction("x", "good", Prediction(clip().frames[None]))
    results.write_prediction("x", "bad", Prediction(clip().frames[None]))
    bad, kept = results.root / "x/predictions/bad.npz", results.clips()[0][1]
    assert (
        results.size_bytes("x", "predictions")
        > bad.stat().st_size
        == results.size_bytes("x", "predictions") / 2
    )
    for path in (bad, kept):
        path.write_bytes(path.read_bytes()[:-30])
    assert results.set_damaged_aside("x") == [bad]
    assert [name for name, _ in results.predictions("x")] == ["good"]
    assert results.set_damaged_aside(None) == [kept]
    assert (results.clips(), results.set_damaged_aside(None)) == ([], [])


def test_removing_twice_is_removing_once(tmp_path: Path) -> None:
    results = begun(tmp_path)
    for index in (0, 1):
        results.write_part("x", rows(1.0), Part(index, ("a",), "f", {}, {}, 0.0))
    for _ in range(2):
        results.remove_part("x", 0)
        assert [part.index for part in results.parts("x")] == [1]
    for _ in range(2):
        results.remove_cell("x")
        assert results.cells() == []


def test_scratch_files_are_no_predictions(tmp_path: Path) -> None:
    results = Results(tmp_path)
    results.write_prediction("x", "a", Prediction(clip().frames[None]))
    path = tmp_path / "x/predictions/a.npz"
    path.with_name(".a.npz").write_bytes(b"")
    assert results.predictions("x") == [("a", path)]


def test_a_clips_name_fits_a_files_name() -> None:
    check_clip_name("a")
    check_clip_name("a" * 226)  # and ".npz": 230 bytes
    with pytest.raises(
        BadData, match=rf"the clip '{'a' * 40}'\.\.\. takes 231 bytes .* a name of 230 at most"
    ):
        check_clip_name("a" * 227)
    with pytest.raises(BadData, match="takes 232 bytes"):
        check_clip_name("\u00e9" * 38)  # two bytes in UTF-8, %C3%A9 in the file's name


def test_what_older_runs_did_not_say_of_a_cell_is_nothing(tmp_path: Path) -> None:
    cell = begun(tmp_path).cell("x")
    assert cell is not None
    assert (cell.num_failed, cell.num_outdated, cell.reason) == (0, 0, "")
    assert (cell.pose_source, cell.renderer) == (None, None)
