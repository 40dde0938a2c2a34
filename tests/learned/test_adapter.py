from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
import street
import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from geovp_benchmarks import cli
from geovp_benchmarks.checks import contracts
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running import task
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.types import PrivilegedInput
from geovp_learned.adapter import TorchPredictor

CONTEXT, _ = street.clip().split(7, PrivilegedInput.NONE)


class Darker(nn.Module):
    """Two more images, each with half the light of the one before, and noise."""

    def __init__(self, noise: float) -> None:
        super().__init__()
        self.share, self.noise = nn.Parameter(torch.tensor(0.5)), noise

    def forward(self, images: Tensor) -> Tensor:
        last = images[:, -1] + self.noise * torch.randn(1)
        return torch.stack([self.share * last, self.share**2 * last], dim=1)


@dataclass(frozen=True)
class Dusk(TorchPredictor):
    noise: float = 0.0

    def network(self) -> nn.Module:
        return Darker(self.noise)


def test_a_network_goes_on_from_its_own_images_as_long_as_is_asked_for() -> None:
    frames = Dusk().predict(CONTEXT).frames  # three steps from a network that makes two at a time
    assert frames.shape == (1, 3, *CONTEXT.frames.shape[1:])
    for step, frame in enumerate(frames[0], 1):
        np.testing.assert_allclose(frame, CONTEXT.frames[-1] / 2**step, atol=0.51)


def test_samples_differ_and_the_first_do_not_depend_on_how_many_follow() -> None:
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    three, one = (Dusk(noise=0.1, num_past=2).predict(CONTEXT, count).frames for count in (3, 1))
    assert torch.equal(torch.rand(1), expected)  # the caller's random numbers go on as they were
    np.testing.assert_array_equal(three[:1], one)
    assert not np.array_equal(three[0], three[1])
    assert not np.array_equal(one, Dusk(noise=0.1, num_past=2, seed=1).predict(CONTEXT).frames)


@pytest.mark.parametrize("suffix", ["safetensors", "pt"])
def test_weights_are_read_and_identified(suffix: str, tmp_path: Path) -> None:
    file, state = tmp_path / f"weights.{suffix}", {"share": torch.tensor(1.0)}
    save_file(state, file) if suffix == "safetensors" else torch.save(state, file)
    predictor = Dusk(checkpoint=file)
    np.testing.assert_array_equal(predictor.predict(CONTEXT).frames[0, 2], CONTEXT.frames[-1])
    assert len(predictor.fingerprint) == 12
    with pytest.raises(BadData, match="expected 123456789abc: give the weights that are asked for"):
        Dusk(checkpoint=file, fingerprint="123456789abc")
    file.write_bytes(b"nothing of use")
    with pytest.raises(BadData, match=r"is not a state dict|is not a whole safetensors file"):
        Dusk(checkpoint=file).predict(CONTEXT)


def test_it_keeps_the_contract_and_joins_a_matrix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known, own = (
        registry._entry_points("predictors"),
        EntryPoint("dusk", f"{__name__}:Dusk", "geovp.predictors"),
    )
    found = registry._entry_points
    both = {**known, "dusk": own}
    monkeypatch.setattr(
        registry, "_entry_points", lambda role: both if role == "predictors" else found(role)
    )
    assert [
        finding.detail for finding in contracts.check("predictors", Dusk()) if not finding.passed
    ] == []
    task.build_matrix.cache_clear()
    (tmp_path / "dusk.toml").write_text(
        '[protocol]\ndataset = { name = "synthetic", num_clips = 1 }\nnum_past = 3\nnum_future = 2\n'
        'size_px = [32, 32]\nstride = 10\ndevice = "auto"\n[predictors]\ndusk = { name = "dusk", noise = 0.1 }\n'
        '[metrics]\nframe = ["psnr"]\ntrajectory = []\n'
    )
    out = tmp_path / "out"
    # In this process, as others do not see the entry point
    args = ["run", str(tmp_path / "dusk.toml"), "--workers", "0", "--out", str(out), "--no-report"]
    assert cli.main(args) == 0
    task.build_matrix.cache_clear()
    method = Results(out).by_name()["dusk"]
    assert method.status == "done"
    assert method.components["predictor"]["noise"] == 0.1
    assert method.components["predictor"]["device"] in ("cpu", "cuda")
