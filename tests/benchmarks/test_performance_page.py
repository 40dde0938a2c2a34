"""The page of speed puts what the measurements print under the command that made it."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from performance import __main__ as performance
from performance import scoring


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[str]]:
    """The arguments that the measurements and the new processes are given; none of them measures
    anything.
    """
    taken: list[Sequence[str]] = []

    def measurement(arguments: Sequence[str]) -> None:
        taken.append(arguments)
        print(f"measured {len(taken)}")

    def run(command: Sequence[str], env: dict[str, str], **_: object) -> SimpleNamespace:
        entries = list(Path(env["NUMBA_CACHE_DIR"]).iterdir())
        taken.append(command)
        (Path(env["NUMBA_CACHE_DIR"]) / "compiled").touch()
        return SimpleNamespace(stdout=f"stages\nfirst round with {len(entries)} files\n")

    for module in (performance.clip, performance.scoring, performance.splat, performance.libraries):
        monkeypatch.setattr(module, "main", measurement)
    monkeypatch.setattr(subprocess, "run", run)
    return taken


def test_the_page_holds_every_measurement_and_its_command(
    calls: list[Sequence[str]], tmp_path: Path
) -> None:
    out = tmp_path / "speed.md"
    performance.main(["3", "--kitti", "/data/kitti", "03[0:180)", "--out", str(out)])
    text = out.read_text()
    assert "python -m performance 3 --kitti path/to/kitti '03[0:180)'" in text
    assert "/data" not in text  # where the data lies is nobody's business
    assert calls[0] == ["3", "--kitti", "/data/kitti", "03[0:180)"]
    assert calls[1] == ["3", "--full", "--kitti", "/data/kitti", "03[0:180)"]
    assert [line for line in text.splitlines() if line.startswith("measured")] == [
        f"measured {n}" for n in (1, 2, 5, 6, 7)
    ]
    assert text.count("## ") == 6


def test_the_first_clip_starts_without_compiled_code(calls: list[Sequence[str]]) -> None:
    lines = performance.first_clips([]).splitlines()
    assert lines == [
        "after installation: first round with 0 files",
        "compiled before: first round with 1 files",
    ]
    assert calls == [[sys.executable, "-m", "performance.clip", "1"]] * 2


def test_the_page_is_printed_without_a_file(
    calls: list[Sequence[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    performance.main(["2"])
    assert capsys.readouterr().out.startswith("# Speed\n\n```sh\npython -m performance 2\n```")


def test_a_metric_and_its_rival_are_timed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scoring, "SIZE_PX", 32)
    scoring.main(["1"])
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["psnr", "ssim", "skimage's ssim", "lpips"]
    assert all(line.endswith(" ms") for line in lines[:3])  # LPIPS needs an extra, else it says so


def test_the_rival_is_the_library_itself() -> None:
    a, b = np.random.default_rng(0).integers(0, 256, (2, 1, 40, 40, 3), dtype=np.uint8)
    expected = structural_similarity(
        a[0], b[0], channel_axis=-1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    assert scoring.skimage_ssim(a, b)[0] == pytest.approx(expected)
