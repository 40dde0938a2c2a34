"""Published numbers: the pages show what is stored beside them, and this machine computes the same."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from geovp_benchmarks import cli

PAGES = Path(__file__).parents[2] / "docs" / "results"
STORED = PAGES / "stored"
# half of what tables show of a dB; another processor may be off by more than half of that
TOLERANCE = "0.005"


@pytest.mark.parametrize(("name", "spread"), [("demo", "interval"), ("fusion", "standard-error")])
def test_a_page_shows_what_is_stored(name: str, spread: str, tmp_path: Path) -> None:
    page = shutil.copy(PAGES / f"{name}.md", tmp_path)
    script = PAGES.parent / "results_page.py"
    subprocess.run([sys.executable, script, STORED / name, page, spread], check=True)
    written, before = Path(page).read_text(), (PAGES / f"{name}.md").read_text()
    assert written.count("\n|") > 20
    assert re.sub("Written on .*? by", "", written) == re.sub("Written on .*? by", "", before)


@pytest.mark.usefixtures("lpips_weights")
def test_the_demos_numbers_are_computed_here(capsys: pytest.CaptureFixture[str]) -> None:
    code = cli.main(["verify", str(STORED / "demo"), "--pairs", "2", "--tolerance", TOLERANCE])
    assert code == 0, capsys.readouterr().out


def test_fusions_numbers_are_computed_here(capsys: pytest.CaptureFixture[str]) -> None:
    if not {"GEOVP_TEST_DATA", "GEOVP_LPIPS_WEIGHTS"} <= os.environ.keys():
        pytest.skip(
            "GEOVP_TEST_DATA or GEOVP_LPIPS_WEIGHTS is not set: needs KITTI odometry and the "
            "weights of LPIPS"
        )
    root = Path(os.environ["GEOVP_TEST_DATA"]) / "kitti"
    words = [
        "verify",
        str(STORED / "fusion"),
        "--root",
        str(root),
        "--pairs",
        "2",
        "--tolerance",
        TOLERANCE,
    ]
    assert cli.main(words) == 0, capsys.readouterr().out


def test_the_doctor_names_methods_that_lack_clips(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(STORED / "demo", tmp_path / "demo")
    assert cli.main(["doctor", str(folder)]) == 0
    assert capsys.readouterr().out == "nothing is missing\n"
    protocol = json.loads((folder / "protocol.json").read_text())
    protocol["clips"].append("seed0-more/000")
    (folder / "protocol.json").write_text(json.dumps(protocol))
    assert cli.main(["doctor", str(folder)]) == 1
    *lines, advice = capsys.readouterr().out.splitlines()
    lacks = "scores of 1 of 5 clips are missing, such as seed0-more/000"
    assert lines == [f"{name}: {lacks}" for name in protocol["methods"]]
    assert advice.startswith("`geovp run`")
