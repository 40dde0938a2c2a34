"""`device` of a matrix and `--device`: every network is built for it, rows say it, and the protocol
stays the same.
"""

import json
from pathlib import Path

import pytest

from geovp.prediction.request import PredictionRequest
from geovp_benchmarks import cli
from geovp_classic.errors import BadData
from tests.benchmarks.made import write_matrix

pytest.importorskip("torch", reason="torch is not installed: devices need the extra 'learned'")

PROTOCOL = {
    "dataset": {"name": "synthetic", "num_clips": 1},
    "num_past": 3,
    "num_future": 2,
    "size_px": [64, 64],
}
PROTOCOL |= {"stride": 10}
FRAME = ["psnr", {"name": "lpips", "weights": "nowhere.npz"}]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    tables = {
        "protocol": PROTOCOL,
        "predictors": {"svg-tiny": "svg-tiny"},
        "metrics": {"frame": FRAME, "trajectory": []},
    }
    return write_matrix(tmp_path / "one.toml", tables)


def test_rows_say_their_device_and_the_protocols_id_does_not_depend_on_it(
    file: Path, tmp_path: Path
) -> None:
    told = {}
    for device in ("cpu", "auto"):
        out = tmp_path / device
        cli.main(["run", str(file), "--out", str(out), "--no-report", "--device", device])
        told[device] = json.loads((out / "protocol.json").read_text())
        method = json.loads((out / "svg-tiny/method.json").read_text())
        assert method["status"] == "done"
        assert method["components"]["predictor"]["device"] in ("cpu", "cuda")
        assert "parameters on " in method["about"][0]
    assert told["cpu"]["metrics"]["lpips"]["device"] == "cpu"
    assert "device" not in told["cpu"]["metrics"]["psnr"]
    assert told["cpu"]["id"] == told["auto"]["id"]


def test_a_device_that_is_not_here_ends_the_run_with_a_sentence(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        cli.main(["run", str(file), "--out", str(file.with_name("out")), "--device", "cuda:99"])
        == 2
    )
    assert "predictors.svg-tiny: device 'cuda:99' cannot be used" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        cli.main(["run", str(file), "--device", "abacus"])
    with pytest.raises(BadData, match="--predictor: device 'cuda:99' cannot be used"):
        PredictionRequest(Path("clip.mp4"), predictor="svg-tiny", device="cuda:99").build()
