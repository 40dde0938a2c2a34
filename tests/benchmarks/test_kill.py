"""Kill -9 in the middle of a run, run again: the same rows as an uninterrupted run, none lost or
doubled.
"""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running.executors import TimeLimit
from tests.benchmarks.conftest import Command, Says
from tests.benchmarks.made import content, go, rows, write_matrix

METHODS = ("steady--slide", "slow", "noise")


def matrix(folder: Path, sleep_s: float) -> Path:
    folder.mkdir(exist_ok=True)
    slow, noise = {"name": "toy-still", "sleep_s": sleep_s}, {"name": "toy-noise", "num_samples": 2}
    parts = {"pose_sources": {"steady": "toy-steady"}, "renderers": {"slide": "toy-slide"}}
    return write_matrix(
        folder / "m.toml", content({"clips": 9}, **parts, predictors={"slow": slow, "noise": noise})
    )


def begin(
    folder: Path, toys: Path, sleep_s: float, *more: str, stderr: Any = subprocess.DEVNULL
) -> subprocess.Popen[bytes]:
    words = [
        "run",
        str(matrix(folder, sleep_s)),
        "--out",
        str(folder / "out"),
        "--no-report",
        *more,
    ]
    own = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(toys), os.environ.get("PYTHONPATH", "")]),
    }
    command = [sys.executable, "-m", "geovp_benchmarks.cli", *words]
    return subprocess.Popen(command, env=own, stderr=stderr, preexec_fn=_heed_interrupts)


def _heed_interrupts() -> None:
    """A shell starts what it runs in the background deaf to interrupts, and the tests may run
    there.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def wait_for_files(root: Path, count: int, process: subprocess.Popen[bytes]) -> None:
    for _ in range(1200):
        if len(list(root.glob("*/scores/part-*.parquet"))) >= count:
            return
        assert process.poll() is None, "the run ended before it could be killed"
        time.sleep(0.05)
    pytest.fail("the run wrote no score file in a minute")


def test_a_killed_run_goes_on_to_the_same_rows(tmp_path: Path, toys: Path, printed: Says) -> None:
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    for count in (1, 4):  # twice, so that a resumed run is killed as well
        process = begin(killed, toys, sleep_s=0.5)
        wait_for_files(killed / "out", count, process)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
    done = sum(path.stat().st_size > 0 for path in (killed / "out").glob("*/scores/part-*.parquet"))
    assert 4 <= done < 15, "killed in the middle: 3 methods of 5 files each"
    scratch = [killed / "out/slow/scores/.part-4.parquet.1.part", killed / "out/clips/.b.1.part"]
    for path in scratch:
        path.write_bytes(b"half a file that a kill left behind")
        os.utime(path, (0, 0))  # of long ago: another run may be writing newer ones
    assert begin(killed, toys, sleep_s=0.5).wait() == 0
    printed("run", matrix(whole, 0.0), "--out", whole / "out", "--no-report")
    assert not any(path.exists() for path in scratch)
    for method in METHODS:
        resumed = rows(killed / "out", method)
        assert resumed == rows(whole / "out", method)
        keys = [(row["clip"], row["sample"], row["step"], row["metric"]) for row in resumed]
        assert len(set(keys)) == len(keys)
        assert len({row["clip"] for row in resumed}) == 9


def parent_of(process: Path) -> int:
    """The number of the process that started the one of this folder of /proc; 0 when that has
    ended.
    """
    try:
        return int((process / "stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0


def test_a_killed_runs_workers_end_with_it(tmp_path: Path, toys: Path) -> None:
    process = begin(tmp_path, toys, 0.5, "--workers", "2")
    wait_for_files(tmp_path / "out", 1, process)
    workers = [place for place in Path("/proc").glob("[0-9]*") if parent_of(place) == process.pid]
    assert len(workers) >= 2
    process.send_signal(signal.SIGKILL)
    process.wait()
    for _ in range(200):
        if not any(place.exists() for place in workers):
            return
        time.sleep(0.05)
    pytest.fail("workers outlive the run")


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGINT])
def test_an_interrupted_run_with_workers_ends_soon_with_one_line(
    tmp_path: Path, toys: Path, sent: signal.Signals
) -> None:
    """However often it is interrupted, also while its finished work is stored."""
    errors = tmp_path / "errors"
    with errors.open("wb") as stream:
        process = begin(tmp_path, toys, 1.0, "--workers", "2", stderr=stream)
        wait_for_files(tmp_path / "out", 1, process)
        while process.poll() is None:
            process.send_signal(sent)
            with suppress(subprocess.TimeoutExpired):
                process.wait(timeout=0.1)
        assert process.returncode == 130
    last = errors.read_text().splitlines()[-1]
    assert last == "geovp: interrupted, finished work is kept"
    assert "Traceback" not in errors.read_text()


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize("death", ["kill", "hang"])
def test_a_clip_that_ends_its_process_fails_alone_and_all_else_is_computed(
    tmp_path: Path, death: str, command: Command
) -> None:
    """Clip 4 has a last observed frame of brightness 42."""
    deadly = {"name": "toy-deadly", "brightness": 42, "death": death}
    file = write_matrix(
        tmp_path / "m.toml",
        content({"clips": 8}, predictors={"deadly": deadly, "still": {"name": "toy-still"}}),
    )
    out = tmp_path / "out"
    words = ["run", file, "--out", out, "--no-report", "--workers", "2", "--time-limit", "10"]
    ended = command(*words)
    assert ended.code == 1, ended.err
    methods = Results(out).by_name()
    assert [method.num_clips for method in methods.values()] == [8, 8]
    assert methods["still"].scored.failures == {}
    [(clip, failure)] = methods["deadly"].scored.failures.items()
    reason = {"kill": "died (SIGKILL)", "hang": "longer than the time limit of 10 s"}[death]
    assert (clip, failure.status) == ("road/004", "failed")
    assert reason in failure.reason
    assert reason in ended.out
    # The failed prediction counts as a copy of the last frame, which is what "still" predicts.
    assert rows(out, "deadly") == rows(out, "still")


@pytest.mark.usefixtures("toys")
def test_a_clip_that_cannot_be_read_fails_and_the_others_are_computed(tmp_path: Path) -> None:
    tables = content({"clips": 4, "broken_clip": 2}, predictors={"still": {"name": "toy-still"}})
    (method,) = go(tmp_path, tables).values()
    assert {clip: each.reason for clip, each in method.scored.failures.items()} == {
        "road/002": "road/002.png is truncated: fetch it again"
    }
    assert method.num_outdated == 0  # it is not of other code
    assert {row["clip"] for row in rows(tmp_path, "still")} == {"road/000", "road/001", "road/003"}


def test_the_time_limit_is_20_medians_and_at_least_2_minutes() -> None:
    assert TimeLimit().now_s() == 3600
    assert TimeLimit(taken_s=[1.0, 2.0, 9.0]).now_s() == 120
    assert TimeLimit(taken_s=[1.0, 10.0, 90.0]).now_s() == 200
    assert TimeLimit(7.0, taken_s=[10.0]).now_s() == 7
