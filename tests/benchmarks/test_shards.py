"""Parts of a matrix on several machines: shards, merging, and a Dask cluster."""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kitti_files import write_kitti

from geovp_benchmarks.results.store import Results, ScoreRecord, Scores
from geovp_classic.data.synthetic.dataset import Synthetic
from tests.benchmarks.conftest import Command, Says
from tests.benchmarks.made import content, rows, write_matrix, write_protocol, write_row

NOISE = {"noise": {"name": "toy-noise", "num_samples": 2}}


@pytest.fixture
def file(tmp_path: Path, toys: Path) -> Path:
    """Return a matrix of seven clips."""
    return write_matrix(tmp_path / "m.toml", content({"clips": 7}, predictors=NOISE))


@pytest.fixture
def whole(file: Path, tmp_path: Path, command: Command) -> list[dict[str, Any]]:
    """Return the rows of a run without shards."""
    command("run", file, "--out", tmp_path / "whole", "--no-report")
    return rows(tmp_path / "whole", "noise")


def test_shards_in_folders_of_their_own_merge_to_the_whole(
    file: Path, tmp_path: Path, whole: list[dict[str, Any]], printed: Says
) -> None:
    shards = [tmp_path / f"shard{part}" for part in (1, 2, 3)]
    counts = []
    for part, folder in enumerate(shards, 1):
        printed("run", file, "--out", folder, "--shard", f"{part}/3", "--keep", "all")
        counts.append(Results(folder).by_name()["noise"].num_clips)
    assert counts == [2, 2, 3]
    merged = tmp_path / "merged"
    assert "| noise" in printed("merge", merged, *shards)
    assert rows(merged, "noise") == whole
    assert len([*merged.glob("noise/scores/part-*")]) == 1
    assert len(Results(merged).clips().names) == 7


def test_a_compact_folder_has_one_score_file_for_all_methods(
    tmp_path: Path, toys: Path, printed: Says
) -> None:
    two = {**NOISE, "still": {"name": "toy-still"}}
    file = write_matrix(tmp_path / "m.toml", content({"clips": 7}, predictors=two))
    shards = [tmp_path / "1", tmp_path / "2"]
    for part, folder in enumerate(shards, 1):
        printed("run", file, "--out", folder, "--shard", f"{part}/2", "--no-report")
    merged, stored = tmp_path / "merged", tmp_path / "stored"
    printed("merge", merged, *shards)
    printed("merge", stored, *shards, "--compact")
    files = [path.relative_to(stored) for path in stored.rglob("*") if path.is_file()]
    assert {str(path) for path in files if path.suffix != ".parquet"} == {
        "protocol.json",
        "noise/method.json",
        "still/method.json",
    }
    (scores,) = (path for path in files if path.suffix == ".parquet")
    assert scores.parent == Path("scores")
    for method in two:
        expected = [row["value"] for row in rows(merged, method)]
        assert [row["value"] for row in rows(stored, method)] == pytest.approx(expected)
    assert "7 of 7 reproduce" in printed("verify", stored, "--pairs", "7", "--tolerance", "0.001")


def test_a_compact_folder_may_have_no_scores(file: Path, tmp_path: Path, printed: Says) -> None:
    printed("run", file, "--out", tmp_path / "none", "--shard", "1/8", "--no-report")  # 7 clips
    printed("merge", tmp_path / "stored", tmp_path / "none", "--compact")
    assert Results(tmp_path / "stored").by_name()["noise"].num_clips == 0


def test_shards_write_into_one_folder_at_the_same_time(
    file: Path, tmp_path: Path, toys: Path, whole: list[dict[str, Any]], printed: Says
) -> None:
    words = ["run", str(file), "--out", str(tmp_path / "shared"), "--no-report", "--workers", "0"]
    environment = {**os.environ, "PYTHONPATH": str(toys)}
    command = [sys.executable, "-m", "geovp_benchmarks.cli", *words]
    processes = [
        subprocess.Popen([*command, "--shard", f"{part}/3"], env=environment) for part in (1, 2, 3)
    ]
    assert [process.wait(120) for process in processes] == [0, 0, 0]
    assert rows(tmp_path / "shared", "noise") == whole
    assert "0 to do, 7 stored" in printed(*words, "--dry-run")


def test_shards_by_sequence_merge(tmp_path: Path, street: Path, printed: Says) -> None:
    write_kitti(street, "08", Synthetic(num_clips=2, num_frames=12, size_px=(160, 160))[1])
    for sequence in ("07", "08"):
        dataset = {"name": "kitti", "root": str(street), "sequences": [sequence]}
        tables = content(metrics={"frame": ["psnr"]}, predictors={"copy-last": "copy-last"})
        tables["protocol"] |= {"dataset": dataset, "size_px": [32, 32], "stride": 5}
        path = write_matrix(tmp_path / "m.toml", tables)
        printed("run", path, "--out", tmp_path / sequence, "--no-report")
    printed("merge", tmp_path / "both", tmp_path / "07", tmp_path / "08")
    results = Results(tmp_path / "both")
    assert {clip[:2] for clip in results.protocol()["clips"]} == {"07", "08"}
    assert results.by_name()["copy-last"].status == "done"


def test_folders_that_disagree_are_refused(
    file: Path, tmp_path: Path, whole: list[dict[str, Any]], command: Command, refused: Says
) -> None:
    seed = ["--set", "predictors.noise.seed=1"]
    clips = ["--set", "protocol.dataset.with_depths=true"]
    for name, more in {"settings": seed, "frames": clips}.items():
        command("run", file, "--out", tmp_path / name, "--no-report", *more)
    a, out = tmp_path / "whole", tmp_path / "out"
    assert "'noise' with other settings" in refused("merge", out, a, tmp_path / "settings")
    assert "differ in the protocol's dataset" in refused("merge", out, a, tmp_path / "frames")
    for path in (tmp_path / "frames").glob("noise/scores/part-*"):
        path.write_bytes(b"half a file")
    assert "is damaged" in refused("merge", out, tmp_path / "frames")
    assert not out.exists()
    results = Results(a)
    protocol = results.protocol()
    Results(tmp_path / "settings").write_protocol(
        {**protocol, "versions": {**protocol["versions"], "numpy": "1.0"}}
    )
    assert "numpy" in refused("merge", out, a, tmp_path / "settings")
    assert "holds something already" in refused("merge", a, tmp_path / "settings")


def test_a_method_that_was_copied_into_the_folder_is_shown(
    file: Path, tmp_path: Path, whole: list[dict[str, Any]], printed: Says
) -> None:
    results = Results(tmp_path / "whole")
    (tmp_path / "whole" / "noise").rename(tmp_path / "whole" / "other")
    protocol = {**results.protocol(), "methods": []}
    results.write_protocol(protocol)
    for path in (tmp_path / "whole" / "other" / "scores").iterdir():
        path.unlink()
    clip = protocol["clips"][0]
    asked, digests = {"protocol": protocol["fingerprint"]}, {clip: protocol["digests"][clip]}
    write_row(results, "other", fingerprint="f", asked=asked)
    scored = ScoreRecord("other", [clip], "f", digests=digests)
    results.write_scores([(Scores([clip], {"toy-difference": np.full((1, 1, 2), 3.0)}), scored)])
    assert "| other" in printed("table", tmp_path / "whole")


def test_dask_workers_with_another_working_directory_write_the_same_rows(
    file: Path,
    tmp_path: Path,
    toys: Path,
    whole: list[dict[str, Any]],
    printed: Says,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    distributed = pytest.importorskip("distributed", reason="needs the extra: cluster")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.setenv("PYTHONPATH", str(toys))
    with distributed.LocalCluster(
        2, threads_per_worker=1, dashboard_address=None, protocol="tcp"
    ) as cluster:
        monkeypatch.chdir(tmp_path)
        address = cluster.scheduler_address
        printed("run", "m.toml", "--out", "by-dask", "--no-report", "--workers", address)
    assert rows(tmp_path / "by-dask", "noise") == whole


def test_many_clips_in_64_shards_are_merged_and_tabulated_quickly(
    tmp_path: Path, printed: Says
) -> None:
    """A twentieth of 100,000 clips, so that the test takes seconds."""
    clips = [f"{drive:03d}/{first:06d}" for drive in range(50) for first in range(100)]
    for part in range(64):
        results = Results(tmp_path / f"{part}")
        write_protocol(results, ["x"], clips, metrics={"psnr": {"role": "frame"}})
        write_row(results, "x")
        own = clips[part * len(clips) // 64 : (part + 1) * len(clips) // 64]
        values = np.arange(20.0)[None, None].repeat(len(own), axis=0)
        results.write_scores([(Scores(own, {"psnr": values}), ScoreRecord("x", own, "f"))])
    start_s = time.process_time()
    printed("merge", tmp_path / "all", *(tmp_path / f"{part}" for part in range(64)))
    assert time.process_time() - start_s < 10
    assert Results(tmp_path / "all").means("x")["psnr"].mean() == 9.5
