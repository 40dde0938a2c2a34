"""Long commands end, and keep their results, when standard output or error is closed or full."""

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


def geovp(words: str, streams: str, folder: Path) -> int:
    """Run a command in a shell and return its exit code."""
    line = f"set -o pipefail; {sys.executable} -m geovp_benchmarks.cli {words} {streams}"
    return subprocess.run(["bash", "-c", line], cwd=folder, timeout=120).returncode


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


def test_a_report_is_written_although_nobody_reads(folder: Path) -> None:
    assert geovp("run matrix.toml --out results", ">&- 2>&-", folder) == 0
    assert (folder / "results" / "report.html").is_file()


def test_a_full_disk_under_the_output_is_an_error(folder: Path) -> None:
    assert geovp("run matrix.toml --out results --no-report", ">/dev/full", folder) == 2


@pytest.mark.parametrize("streams", ["2>&-", "2>&1 | head -1"])
def test_a_clip_is_predicted_although_nobody_reads(streams: str, folder: Path) -> None:
    words = "predict frames --fov 90 --fps 10 --past 4 --future 2 --out predicted"
    assert geovp(words, streams, folder) == 0
    assert any((folder / "predicted").iterdir())
