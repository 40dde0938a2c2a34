"""FVD and FID with tiny networks whose features are known."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from geovp_classic import registry
from geovp_classic.errors import BadData, MissingExtra
from geovp_classic.types import ByteArray

pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit")


class MeanColour(nn.Module):
    """The mean of each channel over time and pixels."""

    def forward(self, images: Tensor) -> Tensor:
        return images.flatten(2).mean(dim=2)


class OwnScale(nn.Module):
    """A network with the options of StyleGAN-V's file, which scales grey levels itself."""

    def forward(
        self,
        clip: Tensor,
        rescale: bool = False,
        resize: bool = False,
        return_features: bool = False,
    ) -> Tensor:
        features = clip.flatten(2).mean(dim=2)
        return torch.cat([features, torch.tensor([[float(rescale and resize)]])], dim=1)


class NoMean(nn.Module):
    def forward(self, images: Tensor) -> Tensor:
        return images


def script(path: Path, network: nn.Module) -> str:
    torch.jit.script(network).save(str(path))
    return str(path)


def frames(*levels: int) -> ByteArray:
    """One frame of 40x32 per grey level; blue is black."""
    images = np.zeros((len(levels), 32, 40, 3), np.uint8)
    images[..., :2] = np.array(levels)[:, None, None, None]
    return images


def test_fvd_is_of_observed_and_future_frames(tmp_path: Path) -> None:
    """Grey levels 0, 255 and 255, in [-1, 1]: a mean of 1/3; blue is -1."""
    path = script(tmp_path / "mean.pt", MeanColour())
    metric = registry.build("set_metrics", {"name": "fvd", "weights": path, "size_px": [16, 16]})
    features = metric.features(frames(0), frames(255, 255))
    np.testing.assert_allclose(features, [1 / 3, 1 / 3, -1], atol=1e-6)
    assert metric.fingerprint in metric.protocol


def test_fid_is_of_one_predicted_frame(tmp_path: Path) -> None:
    path = script(tmp_path / "mean.pt", MeanColour())
    for step, expected in ((-1, 1.0), (0, -1.0)):
        metric = registry.build("set_metrics", {"name": "fid", "weights": path, "step": step})
        features = metric.features(frames(51), frames(0, 255))
        np.testing.assert_allclose(features, [expected, expected, -1], atol=1e-6)


@pytest.mark.parametrize("name", ["fvd", "fid"])
def test_a_file_that_scales_its_input_gets_grey_levels(tmp_path: Path, name: str) -> None:
    path = script(tmp_path / "own.pt", OwnScale())
    metric = registry.build("set_metrics", {"name": name, "weights": path})
    features = metric.features(frames(100), frames(100))
    np.testing.assert_allclose(features, [100, 100, 0, 1])


def test_an_onnx_file_gives_the_same_features(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    onnx = pytest.importorskip("onnx", reason="needs the extra 'onnx'")
    pytest.importorskip("onnxruntime", reason="needs the extra 'pretrained'")
    helper, float_type = onnx.helper, onnx.TensorProto.FLOAT
    clip = helper.make_tensor_value_info("clip", float_type, [1, 3, "t", 16, 16])
    mean = helper.make_tensor_value_info("mean", float_type, [1, 3])
    node = helper.make_node("ReduceMean", ["clip"], ["mean"], axes=[2, 3, 4], keepdims=0)
    graph = helper.make_graph([node], "mean", [clip], [mean])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, tmp_path / "mean.onnx")
    monkeypatch.setenv("GEOVP_I3D_WEIGHTS", str(tmp_path / "mean.onnx"))
    metric = registry.build("set_metrics", {"name": "fvd", "size_px": [16, 16]})
    np.testing.assert_allclose(
        metric.features(frames(0), frames(255, 255)), [1 / 3, 1 / 3, -1], atol=1e-6
    )


@pytest.mark.parametrize(
    ("name", "variable"), [("fvd", "GEOVP_I3D_WEIGHTS"), ("fid", "GEOVP_INCEPTION_WEIGHTS")]
)
def test_without_a_network_the_variable_is_named(
    monkeypatch: pytest.MonkeyPatch, name: str, variable: str
) -> None:
    monkeypatch.delenv(variable, raising=False)
    with pytest.raises(MissingExtra, match=variable):
        registry.build("set_metrics", name)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = script(tmp_path / "maps.pt", NoMean())
    metric = registry.build("set_metrics", {"name": "fid", "weights": path})
    with pytest.raises(BadData, match="expected"):
        metric.features(frames(1), frames(1))
    (tmp_path / "text.pt").write_text("no network")
    metric = registry.build("set_metrics", {"name": "fid", "weights": str(tmp_path / "text.pt")})
    with pytest.raises(BadData, match="cannot be run"):
        metric.features(frames(1), frames(1))
