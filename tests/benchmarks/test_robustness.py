"""Paths, names and values that cannot be used end in one sentence and exit code 2, and nothing
hangs.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from geovp_benchmarks.results.store import Results
from tests.benchmarks.conftest import Command, Says
from tests.benchmarks.made import rows, write_images, write_matrix

PROTOCOL = {"num_past": 3, "num_future": 2, "size_px": [32, 32], "stride": 3}
REST = {"predictors": {"copy-last": {"name": "copy-last"}}, "metrics": {"frame": ["psnr"]}}


@pytest.fixture
def street(tmp_path: Path) -> Path:
    """A matrix file beside eleven images."""
    noise = np.random.default_rng(0).integers(0, 256, (11, 40, 40, 3), dtype=np.uint8)
    write_images(tmp_path / "images", noise, digits=1)
    (tmp_path / "times.txt").write_text("".join(f"{number / 10}\n" for number in range(11)))
    dataset = {
        "name": "folder",
        "path": str(tmp_path / "images"),
        "intrinsics": [40, 40, 19.5, 19.5],
    }
    dataset["times"] = str(tmp_path / "times.txt")
    return write_matrix(tmp_path / "m.toml", {"protocol": {"dataset": dataset, **PROTOCOL}, **REST})


@pytest.fixture(autouse=True)
def no_hang() -> Iterator[None]:
    """Fail a test that hangs; by default the signal would end the process with all its tests."""
    previous = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("it hangs"))
    signal.alarm(240)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, previous)


def run(street: Path, out: Path | None = None) -> tuple[str | Path, ...]:
    return "run", street, "--out", out or street.parent / "out", "--no-report"


@pytest.mark.parametrize("out", ["times.txt", "times.txt/out", "/proc/geovp-results"])
def test_a_results_folder_that_cannot_be(street: Path, refused: Says, out: str) -> None:
    assert refused(*run(street, street.parent / out))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("copy-last = {", '"protocol.json" = {', "would be called 'protocol.json'"),
        ("[32, 32]", "[32, 16]", "expected a square"),
        (
            "intrinsics = [40",
            "intrinsics = [nan",
            "not JSON compliant",
        ),
        ("stride = 3", f"stride = {'[' * 2000}{']' * 2000}", "is not TOML"),
    ],
)
def test_what_a_matrix_cannot_say(
    street: Path, refused: Says, old: str, new: str, says: str
) -> None:
    content = street.read_text()
    assert old in content
    street.write_text(content.replace(old, new))
    said = refused(*run(street))
    assert says in said
    assert len(said) < 3000


def test_pipes_devices_and_folders_are_no_files(street: Path, refused: Says) -> None:
    times = street.parent / "times.txt"
    times.unlink()
    os.mkfifo(times)
    assert "times.txt: is a pipe or device, expected a file" in refused(*run(street))
    image = street.parent / "images/4.png"
    times.unlink()
    times.write_text("".join(f"{number / 10}\n" for number in range(11)))
    image.unlink()
    image.symlink_to("/dev/zero")
    assert "4.png is a pipe or device" in refused(*run(street))
    image.unlink()
    image.symlink_to(image)
    assert "4.png cannot be read (Too many levels of symbolic links)" in refused(*run(street))


def test_a_full_disk_says_what_is_kept_and_how_to_go_on(street: Path) -> None:
    """A file may have 3 kB: protocol.json fits, a kept clip of 15 kB does not."""
    command = f"{sys.executable} -m geovp_benchmarks.cli run {street} --out {street.parent}/out"
    ended = in_shell(f"ulimit -f 3; {command}")
    assert ended.returncode == 2
    assert "Traceback" not in ended.stderr
    assert "File too large" in ended.stderr
    assert "make room and rerun, finished work is kept" in ended.stderr
    assert in_shell(f"{command} --no-report").returncode == 0
    scores = Results(street.parent / "out").scores("copy-last")
    assert {values.shape for values in scores.values.values()} == {(3, 1, 2)}  # clips, steps


def in_shell(line: str) -> subprocess.CompletedProcess[str]:
    """Run a line in a shell and wait for its end."""
    command = ["bash", "-c", line]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


HOLD = """
import sys, time
from pathlib import Path
from filelock import FileLock
with FileLock(Path(sys.argv[1], ".lock")):
    print("held", flush=True)
    time.sleep(float(sys.argv[2]))
"""


def hold(root: Path, seconds: float) -> subprocess.Popen[str]:
    """Start a process that holds the lock of a results folder, as a run does."""
    command = [sys.executable, "-c", HOLD, str(root), str(seconds)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    return process


def test_a_second_run_waits_for_the_first(street: Path, command: Command, printed: Says) -> None:
    printed(*run(street))
    with hold(street.parent / "out", 3) as other:
        ended = command(*run(street), "--set", "protocol.num_past=2")
        assert ended.code == 0
        assert "waiting for another run in" in ended.err
        assert other.wait() == 0


def test_what_was_damaged_is_named_set_aside_and_computed_again(
    street: Path, printed: Says, refused: Says, caplog: pytest.LogCaptureFixture
) -> None:
    out = street.parent / "out"
    printed(*run(street))
    before = rows(out, "copy-last")
    damaged = [
        *(out / "copy-last/scores").glob("part-*.parquet"),
        *(out / "copy-last/predictions").glob("*.npz"),
    ]
    for path in damaged:
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    assert ".parquet is damaged: `geovp run` sets it aside" in refused("table", out)
    printed(*run(street))
    for path in damaged:
        assert f"{path} was damaged: it is set aside" in caplog.text
        assert path.with_name(f"{path.name}.damaged").exists()
    assert rows(out, "copy-last") == before
