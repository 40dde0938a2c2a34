"""Error budget: paired changes by hand, and runs on the synthetic street."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.error_budget.changes import MeasuredMethod, error_budget, read_method
from geovp_benchmarks.error_budget.oracles import OracleClip, Oracles
from geovp_benchmarks.matrix import schema
from geovp_benchmarks.tables.formats import markdown
from geovp_classic.errors import Incompatible
from geovp_classic.types import ByteArray, PrivilegedInput
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import rows_of, write_matrix

PAST = {
    "name": "chained",
    "odometry": {"name": "ground-truth"},
    "forecaster": {"name": "constant-velocity"},
}
TABLES: dict[str, dict[str, Any]] = {
    "protocol": {
        "dataset": {"name": "synthetic", "num_clips": 2},
        "num_past": 6,
        "num_future": 6,
        "stride": 10,
        "size_px": [64, 64],
    },
    "pose_sources": {"past": PAST},
    "renderers": {"fusion": "depth-fusion"},
    "predictors": {"copy-last": "copy-last"},
    "metrics": {"frame": ["psnr", "ssim"]},
}


@pytest.fixture
def matrix_file(tmp_path: Path) -> Path:
    return write_matrix(tmp_path / "street.toml", TABLES)


@pytest.fixture
def method() -> MeasuredMethod:
    """Return the method of the street with three clips and one metric."""
    dataset = {"name": "synthetic", "num_clips": 3}
    protocol = {**TABLES["protocol"], "dataset": dataset, "size_px": [32, 32]}
    matrix = schema.parse(
        "street", {**TABLES, "protocol": protocol, "metrics": {"frame": ["psnr"]}}
    )
    return read_method(matrix, None, None, PrivilegedInput.NONE)


def test_impossible_variants_leave_out_the_clip(
    method: MeasuredMethod, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One grey level off is 48.13 dB, two are 42.11 dB; the truth is impossible on one clip."""
    grey = np.full((1, 32, 32, 3), 100, np.uint8)
    clips: list[str] = []

    def frames(oracle: OracleClip, oracles: Oracles) -> tuple[ByteArray, ByteArray]:
        if oracle.context.name not in clips:
            clips.append(oracle.context.name)
        if oracles and len(clips) == 2:
            raise Incompatible("no scale")
        return grey + np.uint8(not oracles), grey - np.uint8(1)

    monkeypatch.setattr(OracleClip, "frames", frames)
    (table,) = error_budget(method)
    lines = markdown(table).splitlines()
    assert lines[0].endswith("change of PSNR (dB), forecast 42.11, truth 48.13")
    assert rows_of(lines)["yaw"][:2] == ["3 (2)", "+6.02 (n=2)"]
    assert "- no scale" in lines


def test_a_method_that_is_impossible_on_all_clips_is_refused(
    method: MeasuredMethod, monkeypatch: pytest.MonkeyPatch
) -> None:
    def frames(oracle: OracleClip, oracles: Oracles) -> None:
        raise Incompatible("no scale")

    monkeypatch.setattr(OracleClip, "frames", frames)
    with pytest.raises(Incompatible, match="no scale"):
        error_budget(method)


def test_the_budget_of_the_street_adds_up(matrix_file: Path, printed: Says) -> None:
    lines = printed("budget", matrix_file).splitlines()
    title = "## past + fusion: 2 clips of synthetic, every 10 frames, horizons 1, 5: change of PSNR (dB)"
    assert lines[0].startswith(f"{title}, forecast")
    rows = rows_of(lines)
    rows = {name: row for name, row in rows.items() if row[0].startswith("2")}
    assert len(rows) == 11  # depth and masks are exact here
    forecast, truth = (float(words.split()[-1]) for words in lines[0].split(",")[-2:])
    one_by_one = [float(row[2]) for row in rows.values()]
    assert sum(one_by_one) == pytest.approx(truth - forecast, abs=0.07)  # of rounded numbers
    assert truth > forecast + 1
    assert not [line for line in lines if "nan" in line]


def test_stages_that_cannot_be_measured_are_named(matrix_file: Path, printed: Says) -> None:
    write_matrix(matrix_file, {**TABLES, "renderers": {"plane": "ground-far-plane"}})
    lines = printed("budget", matrix_file, "--limit", "1").splitlines()
    assert [line for line in lines if line.startswith("- depth is not measured")]
    assert "depth" not in rows_of(lines)


def test_an_unavailable_metric_is_named(
    matrix_file: Path, printed: Says, refused: Says, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GEOVP_LPIPS_WEIGHTS", str(matrix_file.parent / "none"))
    write_matrix(matrix_file, {**TABLES, "metrics": {"frame": ["psnr", "lpips"]}})
    lines = printed("budget", matrix_file, "--limit", "1").splitlines()
    assert [line for line in lines if line.startswith("- lpips is unavailable: ")]
    write_matrix(matrix_file, {**TABLES, "metrics": {"frame": ["lpips"]}})
    assert "lpips is unavailable: " in refused("budget", matrix_file, "--limit", "1")
