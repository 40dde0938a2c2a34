"""The notebook runs from its first cell to its last, and is stored without outputs."""

import json
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).parents[1] / "docs/examples/first-hour.ipynb"


def code_cells() -> list[dict[str, Any]]:
    """Return the cells that hold code, in order."""
    cells = json.loads(NOTEBOOK.read_text("utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def test_its_cells_run_and_the_prediction_beats_the_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, Any] = {}
    for cell in code_cells():
        exec("".join(cell["source"]), namespace)
    assert "PSNR (dB)" in capsys.readouterr().out
    psnr = {name: values["psnr"].mean() for name, values in namespace["scores"].items()}
    assert psnr["from ten frames"] > psnr["copied"]
