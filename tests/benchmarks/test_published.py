"""Published numbers: the pages show what is stored beside them, and this machine computes the same."""

import os
import shutil
from pathlib import Path

import pytest

from geovp_benchmarks import cli

PAGES = Path(__file__).parents[2] / "docs" / "results"
STORED = PAGES / "stored"
# half of what tables show of a dB; another processor may be off by more than half of that
TOLERANCE = "0.005"


def table_lines(page: Path) -> list[str]:
    """The tables that were written, not those of the notes."""
    return [
        line
        for line in page.read_text().partition("\n## Notes\n")[0].splitlines()
        if line.startswith("|")
    ]


@pytest.mark.parametrize(
    ("name", "form"), [("demo", []), ("fusion", ["--spread", "standard-error"])]
)
def test_a_page_shows_what_is_stored(name: str, form: list[str], tmp_path: Path) -> None:
    results = shutil.copytree(STORED / name, tmp_path / name)  # tables are written into it
    assert cli.main(["table", str(results), *form, "--page", str(tmp_path / "page.md")]) == 0
    shown = table_lines(PAGES / f"{name}.md")
    assert len(shown) > 20
    assert table_lines(tmp_path / "page.md") == shown


@pytest.mark.usefixtures("lpips_weights")
def test_the_demos_numbers_are_computed_here(capsys: pytest.CaptureFixture[str]) -> None:
    code = cli.main(["verify", str(STORED / "demo"), "--pairs", "3", "--tolerance", TOLERANCE])
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
