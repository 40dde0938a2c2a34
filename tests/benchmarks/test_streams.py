"""Long commands end, and keep their results, when standard output or error is closed or full."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

MATRIX = """
[protocol]
dataset = { name = "synthetic", num_clips = 1 }
num_past = 4
num_future = 2
size_px = [64, 64]
stride = 20

[predictors]
copy-last = { name = "copy-last" }

[metrics]
frame = ["psnr"]
"""
UNREADABLE = ("2>&-", "2>&1 | head -1", "2>/dev/full")
PREDICT = "predict frames --fov 90 --fps 10 --past 4 --future 2 --out predicted"


def geovp(words: str, streams: str, folder: Path) -> int:
    """Run a command in a shell and return its exit code."""
    line = f"set -o pipefail; {sys.executable} -m geovp_benchmarks.cli {words} {streams}"
    command = ["bash", "-c", line]
    return subprocess.run(command, cwd=folder, env=buffered(), timeout=120).returncode


def buffered() -> dict[str, str]:
    """Return the environment in which Python buffers its streams, and flushes them at exit."""
    return {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "matrix.toml").write_text(MATRIX)
    rng = np.random.default_rng(0)
    (tmp_path / "frames").mkdir()
    for step in range(10):
        frame = rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)
        Image.fromarray(frame).save(tmp_path / "frames" / f"{step}.png")
    return tmp_path


@pytest.mark.parametrize("streams", UNREADABLE)
def test_a_matrix_is_run_although_nobody_reads(streams: str, folder: Path) -> None:
    assert geovp("run matrix.toml --out results --no-report", streams, folder) == 0
    assert any((folder / "results" / "tables").iterdir())


def test_a_full_disk_under_the_output_is_an_error(folder: Path) -> None:
    assert geovp("run matrix.toml --out results --no-report", ">/dev/full", folder) == 2


@pytest.mark.parametrize(
    ("words", "code"),
    [(PREDICT, 0), ("predict nowhere --fps 10", 2), ("list renderers", 0), ("list nothing", 2)],
)
def test_a_closed_pipe_does_not_change_the_exit_code(words: str, code: int, folder: Path) -> None:
    """The reader of both streams has ended before the first line."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "geovp_benchmarks.cli", *words.split()]
    streams = {"stdout": writer, "stderr": writer}
    ended = subprocess.run(command, cwd=folder, env=buffered(), timeout=120, **streams)
    os.close(writer)
    assert ended.returncode == code
