"""LPIPS: published values with the real weights; everything else with small random networks of the
same build.
"""

import hashlib
import os
import shutil
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from geovp_classic.errors import MissingExtra
from geovp_classic.types import ByteArray
from geovp_learned import lpips
from geovp_learned.lpips import Lpips, Net

NETS = get_args(Net)


@pytest.fixture(autouse=True)
def no_weights_by_accident(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither the machine's own weights nor the network are touched."""
    for variable in (lpips.WEIGHTS_VARIABLE, "GEOVP_CACHE"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(
        lpips, "REMOTES", dict.fromkeys(NETS, (("file:///nowhere.pth", "0" * 64),) * 2)
    )


def noise(seed: int, shape: tuple[int, ...] = (3, 48, 64, 3)) -> ByteArray:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def tensors_of(folder: Path) -> dict[str, Tensor]:
    arrays = np.load(folder / "lpips_alex_v0.1.npz")
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def real_weights(net: Net) -> Path:
    root = os.environ.get("GEOVP_TEST_DATA")
    if not root:
        pytest.skip(
            "GEOVP_TEST_DATA is not set: needs lpips/lpips_*_v0.1.npz and the example images"
        )
    return Path(root) / "lpips" / f"lpips_{net}_v0.1.npz"


def image(file: Path) -> ByteArray:
    return np.asarray(cv2.cvtColor(cv2.imread(str(file)), cv2.COLOR_BGR2RGB))[None]


@pytest.mark.parametrize(
    ("net", "published"), [("alex", (0.721881, 0.137566)), ("squeeze", (0.711048, 0.147902))]
)
def test_the_authors_example_images_score_as_published(
    net: Net, published: tuple[float, float]
) -> None:
    file = real_weights(net)
    reference = image(file.with_name("ex_ref.png"))
    scores = [
        float(Lpips(net, file)(image(file.with_name(f"ex_p{k}.png")), reference, None)[0])
        for k in (0, 1)
    ]
    np.testing.assert_allclose(scores, published, atol=2e-6)


def layer_by_layer(weights: dict[str, Tensor], pixels: Tensor) -> list[Tensor]:
    """The outputs of AlexNet's five rectifiers, as its paper lists the layers."""
    outputs = []
    for layer, stride, padding in ((0, 4, 2), (3, 1, 2), (6, 1, 1), (8, 1, 1), (10, 1, 1)):
        if layer in (3, 6):
            pixels = nn.functional.max_pool2d(pixels, 3, 2)
        kernel, bias = (weights[f"features.{layer}.{name}"] for name in ("weight", "bias"))
        pixels = nn.functional.conv2d(pixels, kernel, bias, stride, padding).relu()
        outputs.append(pixels)
    return outputs


@torch.no_grad()
def test_alex_agrees_with_a_slow_twin(lpips_folder: Path) -> None:
    """Frame by frame and cell by cell, as the paper's equation 1 reads."""
    predicted, target, weights = noise(1), noise(2), tensors_of(lpips_folder)
    mean, deviation = torch.tensor([-0.030, -0.088, -0.188]), torch.tensor([0.458, 0.448, 0.450])
    expected = []
    for ours, real in zip(predicted, target, strict=True):
        pair = torch.stack(
            [(torch.tensor(frame) / 255.0 * 2 - 1 - mean) / deviation for frame in (ours, real)]
        )
        total = 0.0
        for index, (a, b) in enumerate(layer_by_layer(weights, pair.permute(0, 3, 1, 2))):
            places = [(y, x) for y in range(a.shape[1]) for x in range(a.shape[2])]
            linear = weights[f"lin{index}.weight"]
            total += sum(
                float(linear @ (unit(a[:, y, x]) - unit(b[:, y, x])) ** 2) for y, x in places
            ) / len(places)
        expected.append(total)
    np.testing.assert_allclose(Lpips("alex", lpips_folder)(predicted, target), expected, rtol=1e-4)


def unit(vector: Tensor) -> Tensor:
    return nn.functional.normalize(vector, dim=0)


@pytest.mark.parametrize("net", NETS)
def test_masks_weigh_the_maps_of_differences(net: Net, lpips_folder: Path) -> None:
    metric, target = Lpips(net, lpips_folder), noise(1, (3, 32, 320, 3))
    predicted = target.copy()
    predicted[:, :, 288:] = (
        255 - predicted[:, :, 288:]
    )  # changed on the right alone, out of reach of the left
    left, right = np.zeros((2, 3, 32, 320), dtype=bool)
    left[:, :, :80], right[::2, :, 240:] = True, True
    everywhere = metric(predicted, target)
    assert (everywhere.shape, everywhere.dtype) == ((3,), np.float64)
    masks = [np.ones_like(left), left, right]
    on_all, on_left, on_right = metric.over(predicted, metric.prepare(target), masks)
    np.testing.assert_allclose(on_all, everywhere, rtol=1e-6)
    np.testing.assert_array_equal(on_left, 0.0)
    assert (on_right[::2] > 2 * everywhere[::2]).all()
    assert np.isnan(on_right).tolist() == [False, True, False]


def test_the_field_wins_over_the_variable_and_the_variable_over_the_cache(
    lpips_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cached = tmp_path / "cache" / "geovp" / "lpips_alex_v0.1.npz"
    cached.parent.mkdir(parents=True)
    cached.touch()
    assert lpips.find_weights("alex", None) == cached
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "elsewhere"))
    monkeypatch.setenv("GEOVP_CACHE", str(cached.parent))
    assert lpips.find_weights("alex", None) == cached
    monkeypatch.setenv(lpips.WEIGHTS_VARIABLE, str(lpips_folder))
    assert lpips.find_weights("alex", None) == lpips_folder / "lpips_alex_v0.1.npz"
    monkeypatch.setenv(lpips.WEIGHTS_VARIABLE, str(lpips_folder / "lpips_squeeze_v0.1.npz"))
    assert lpips.find_weights("squeeze", None) == lpips_folder / "lpips_squeeze_v0.1.npz"
    assert lpips.find_weights("alex", cached) == cached


def test_missing_damaged_and_other_weights_are_refused(lpips_folder: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(b"PK\x03\x04 cut short")
    with pytest.raises(MissingExtra, match=r"damaged\.npz"):
        Lpips("alex", damaged)(noise(1), noise(2))
    with pytest.raises(MissingExtra, match="nowhere cannot be read"):
        Lpips("alex", lpips_folder / "nowhere")(noise(1), noise(2))
    with pytest.raises(MissingExtra, match="'squeeze'"):
        Lpips("squeeze", lpips_folder / "lpips_alex_v0.1.npz")(noise(1), noise(2))


def test_channels_in_the_wrong_order_are_a_setting_that_the_protocol_names(
    lpips_folder: Path,
) -> None:
    predicted, target = noise(1), noise(2)
    swapped = Lpips("alex", lpips_folder, channels="bgr")
    expected = Lpips("alex", lpips_folder)(predicted[..., [2, 1, 0]], target[..., [2, 1, 0]], None)
    np.testing.assert_allclose(swapped(predicted, target), expected)
    assert np.abs(expected - Lpips("alex", lpips_folder)(predicted, target)).max() > 1e-4
    assert swapped.protocol == "LPIPS v0.1, alex, BGR in [-1, 1]"


@pytest.fixture
def remote(lpips_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a backbone and linear layers as published, from which weights are fetched."""
    root = lpips_folder / "remote"
    root.mkdir()
    weights = tensors_of(lpips_folder)
    backbone = {name: tensor for name, tensor in weights.items() if name.startswith("features.")}
    linear = {
        f"lin{k}.model.1.weight": weights[f"lin{k}.weight"][None, :, None, None] for k in range(5)
    }
    torch.save({**backbone, "classifier.1.weight": torch.zeros(4)}, root / "backbone.pth")
    torch.save(linear, root / "linear.pth")
    files = [root / "backbone.pth", root / "linear.pth"]
    hashes = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    urls = [file.as_uri() for file in files]
    monkeypatch.setattr(lpips, "REMOTES", {"alex": tuple(zip(urls, hashes, strict=True))})
    return root


def test_weights_are_downloaded_once_and_score_as_the_npz_does(
    remote: Path, lpips_folder: Path, tmp_path: Path
) -> None:
    expected = Lpips("alex", lpips_folder)(noise(1), noise(2))
    np.testing.assert_array_equal(Lpips()(noise(1), noise(2)), expected)
    shutil.rmtree(remote)
    np.testing.assert_array_equal(Lpips()(noise(1), noise(2)), expected)
    [cached] = (tmp_path / "cache" / "geovp").iterdir()
    assert cached.name == "lpips_alex_v0.1.npz"
    assert "classifier.1.weight" not in np.load(cached).files


def test_a_download_with_another_hash_is_never_opened(remote: Path, tmp_path: Path) -> None:
    (remote / "linear.pth").write_bytes((remote / "linear.pth").read_bytes()[:-1] + b"?")
    with pytest.raises(MissingExtra, match=r"linear\.pth does not have the SHA-256"):
        Lpips()(noise(1), noise(2))
    assert list((tmp_path / "cache" / "geovp").iterdir()) == []
