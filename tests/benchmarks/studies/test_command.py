"""The command line of the studies."""

import subprocess
import sys
from pathlib import Path

import pytest

from studies import main

STUDIES = Path(__file__).resolve().parents[3] / "benchmarks" / "studies"


@pytest.mark.parametrize("words", ["", "weather", "depth many", "depth 0", "depth 1 2 3"])
def test_wrong_arguments_are_bad_input(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(words.split())
    assert end.value.code == 2
    assert "error: " in capsys.readouterr().err


def test_help_names_the_studies() -> None:
    command = [sys.executable, str(STUDIES), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    for name in ("depth", "corruption", "budget-figure"):
        assert f"    {name} " in done.stdout or f"    {name}\n" in done.stdout
