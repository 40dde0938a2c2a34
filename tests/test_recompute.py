"""`make results`: each page with commands has its hours, and what was computed is not repeated."""

import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.chdir(ROOT)
    for name in ("KITTI", "POSES", "VIDEOS"):
        monkeypatch.delenv(name, raising=False)
    return runpy.run_path("docs/recompute.py")


def test_each_page_with_commands_has_hours(script: dict[str, Any]) -> None:
    pages = [page for page in (ROOT / "docs/results").glob("*.md") if page.stem != "index"]
    with_commands = {page.stem for page in pages if script["commands"](page)}
    assert set(script["expected_hours"]()) == with_commands
    without = {"predictability", "synsin-published"}  # trained, or not repeated
    assert with_commands == {page.stem for page in pages} - without


def test_commands_are_those_of_the_page(script: dict[str, Any]) -> None:
    assert script["commands"](ROOT / "docs/results/corruption.md") == [
        "python benchmarks/studies corruption path/to/kitti '03[0:180)' --stride 45"
    ]
    assert not any("train" in each for each in script["commands"](ROOT / "docs/results/learned.md"))


def test_an_interrupted_run_goes_on(
    script: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second of three commands fails at first; the second run computes it alone."""
    names, asked, failing = script["main"].__globals__, [], {1}
    names["OUTPUTS"] = tmp_path
    names["missing_folders"] = lambda command: []

    def compute(command: str, output: Path, commit: str) -> bool:
        asked.append(command)
        if len(asked) - 1 in failing:
            return False
        output.parent.mkdir(exist_ok=True)
        output.write_text("a table")
        return True

    names["compute"] = compute
    commands = script["commands"](ROOT / "docs/results/odometry.md")
    assert len(commands) == 3
    assert script["main"](["odometry"]) == 1
    assert asked == commands
    assert script["main"](["odometry"]) == 0
    assert asked[3:] == [commands[1]]
    assert "expected: 0.2 hours for odometry" in capsys.readouterr().out


def test_missing_data_is_named(
    script: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script["main"].__globals__["OUTPUTS"] = tmp_path
    assert script["main"](["forecasting"]) == 1
    assert "forecasting: set POSES for: geovp forecast path/to/poses" in capsys.readouterr().out
