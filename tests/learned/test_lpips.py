"""LPIPS: published values with the real weights; everything else with small random networks of the
same build.
"""

import hashlib
import http.server
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from geovp_benchmarks.scoring import ManyMasks
from geovp_classic import registry
from geovp_classic.errors import BadData, MissingExtra
from geovp_classic.interfaces import FrameMetric
from geovp_classic.types import ByteArray, FloatArray
from geovp_learned import lpips, lpips_networks
from geovp_learned.lpips import Lpips, Net

NETS = get_args(Net)
ALEX_WIDTHS = {
    0: (3, 6, 11),
    3: (6, 5, 5),
    6: (5, 7, 3),
    8: (7, 4, 3),
    10: (4, 4, 3),
}  # in, out, kernel
ALEX_LINEAR, SQUEEZE_LINEAR = (6, 5, 7, 4, 4), (6, 4, 4, 4, 4, 4, 4)


def random_weights(net: Net, seed: int = 0) -> dict[str, Tensor]:
    """A network with the layers of the real one, but a few channels wide."""
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator) / np.sqrt(np.prod(shape[1:]) + 1)

    weights: dict[str, Tensor] = {}

    def convolution(name: str, into: int, out: int, kernel: int) -> None:
        weights[f"{name}.weight"], weights[f"{name}.bias"] = (
            draw(out, into, kernel, kernel),
            draw(out),
        )

    if net == "alex":
        for layer, (into, out, kernel) in ALEX_WIDTHS.items():
            convolution(f"features.{layer}", into, out, kernel)
    else:
        convolution("features.0", 3, 6, 3)
        for fire in (3, 4, 6, 7, 9, 10, 11, 12):
            convolution(f"features.{fire}.squeeze", 6 if fire == 3 else 4, 3, 1)
            convolution(f"features.{fire}.expand1x1", 3, 2, 1)
            convolution(f"features.{fire}.expand3x3", 3, 2, 3)
    for index, width in enumerate(ALEX_LINEAR if net == "alex" else SQUEEZE_LINEAR):
        weights[f"lin{index}.weight"] = draw(width).abs()
    return weights


@pytest.fixture(autouse=True)
def no_weights_by_accident(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither the machine's own weights nor the network are touched."""
    for variable in (lpips.WEIGHTS_VARIABLE, "GEOVP_CACHE"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(
        lpips, "REMOTES", dict.fromkeys(NETS, (("file:///nowhere.pth", "0" * 64),) * 2)
    )


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder with both npz files, of random networks that pass for the real ones."""
    scores = {}
    for net in NETS:
        weights = random_weights(net)
        np.savez(
            tmp_path / f"lpips_{net}_v0.1.npz",
            **{name: tensor.numpy() for name, tensor in weights.items()},
        )
        scores[net] = float(distances(net, weights, *map(images, lpips.check_images()))[0])
    monkeypatch.setattr(lpips, "CHECK_SCORES", scores)
    return tmp_path


def images(frames: ByteArray) -> Tensor:
    """Frames [N, H, W, 3] as [N, 3, H, W] in [-1, 1]."""
    return torch.tensor(frames).permute(0, 3, 1, 2).float() / 127.5 - 1.0


def distances(
    net: Net, weights: dict[str, Tensor], predicted: Tensor, target: Tensor
) -> FloatArray:
    features = [lpips.unit_features(net, weights, each) for each in (predicted, target)]
    return lpips._distances(weights, *features, [None])[0]


def noise(seed: int, shape: tuple[int, ...] = (3, 48, 64, 3)) -> ByteArray:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


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


def test_squeeze_scores_as_torchmetrics_documents_it() -> None:
    """Its inputs are fractions, not bytes."""
    weights = lpips.load_weights("squeeze", real_weights("squeeze"))
    generator = torch.Generator().manual_seed(42)
    first, second = (torch.rand(2, 3, 100, 100, generator=generator) * 2 - 1 for _ in range(2))
    np.testing.assert_allclose(
        distances("squeeze", weights, first, second), [0.1024, 0.0938], atol=5e-5
    )
    generator = torch.Generator().manual_seed(42)
    first, second = (torch.rand(10, 3, 100, 100, generator=generator) * 2 - 1 for _ in range(2))
    assert distances("squeeze", weights, first, second).mean() == pytest.approx(0.1005, abs=5e-5)


@pytest.mark.parametrize("net", NETS)
def test_real_weights_pass_the_check_and_altered_ones_do_not(net: Net, tmp_path: Path) -> None:
    file = real_weights(net)
    assert lpips.load_weights(net, file)
    arrays = dict(np.load(file))
    arrays["lin2.weight"] = arrays["lin2.weight"] * 1.05
    np.savez(tmp_path / "altered.npz", **arrays)
    with pytest.raises(
        MissingExtra, match=r"check images score 0\.\d+, expected 0\.\d+: get them anew"
    ):
        lpips.load_weights(net, tmp_path / "altered.npz")


def module_by_module(weights: dict[str, Tensor], pixels: Tensor) -> list[Tensor]:
    """AlexNet as torchvision builds it, out of modules; the outputs of its five rectifiers."""
    strides, paddings = {0: 4}, {0: 2, 3: 2}
    features = nn.Sequential(*(nn.Identity() for _ in range(12)))
    for layer, (into, out, kernel) in ALEX_WIDTHS.items():
        features[layer] = nn.Conv2d(
            into, out, kernel, strides.get(layer, 1), paddings.get(layer, 1)
        )
        features[layer + 1] = nn.ReLU()
    features[2] = features[5] = nn.MaxPool2d(3, 2)  # the last one comes after what LPIPS looks at
    wanted = {
        name.removeprefix("features."): w
        for name, w in weights.items()
        if name.startswith("features.")
    }
    features.load_state_dict(wanted)
    outputs = []
    for index, module in enumerate(features):
        pixels = module(pixels)
        if index - 1 in ALEX_WIDTHS:
            outputs.append(pixels)
    return outputs


@torch.no_grad()
def test_alex_agrees_with_a_slow_twin(folder: Path) -> None:
    """Frame by frame and cell by cell, as the paper's equation 1 reads."""
    predicted, target, weights = noise(1), noise(2), random_weights("alex")
    mean, deviation = torch.tensor([-0.030, -0.088, -0.188]), torch.tensor([0.458, 0.448, 0.450])
    expected = []
    for ours, real in zip(predicted, target, strict=True):
        pair = torch.stack(
            [(torch.tensor(frame) / 255.0 * 2 - 1 - mean) / deviation for frame in (ours, real)]
        )
        total = 0.0
        for index, (a, b) in enumerate(module_by_module(weights, pair.permute(0, 3, 1, 2))):
            places = [(y, x) for y in range(a.shape[1]) for x in range(a.shape[2])]
            linear = weights[f"lin{index}.weight"]
            total += sum(
                float(linear @ (unit(a[:, y, x]) - unit(b[:, y, x])) ** 2) for y, x in places
            ) / len(places)
        expected.append(total)
    np.testing.assert_allclose(Lpips("alex", folder)(predicted, target, None), expected, rtol=1e-4)


def unit(vector: Tensor) -> Tensor:
    return nn.functional.normalize(vector, dim=0)


@pytest.mark.parametrize("net", NETS)
def test_equal_frames_are_at_no_distance_and_others_symmetric(net: Net, folder: Path) -> None:
    metric, first, second = Lpips(net, folder), noise(1), noise(2)
    np.testing.assert_array_equal(metric(first, first, None), 0.0)
    there, back = metric(first, second, None), metric(second, first, None)
    np.testing.assert_allclose(there, back, rtol=1e-5)
    assert there.shape == (3,)
    assert there.dtype == np.float64
    assert (there > 0).all()


@pytest.mark.parametrize("net", NETS)
def test_frames_score_alike_alone_and_in_a_long_batch(net: Net, folder: Path) -> None:
    predicted, target = noise(1, (13, 32, 40, 3)), noise(2, (13, 32, 40, 3))
    metric = Lpips(net, folder)
    alone = [float(metric(predicted[k : k + 1], target[k : k + 1], None)[0]) for k in range(13)]
    np.testing.assert_allclose(metric(predicted, target, None), alone, rtol=1e-4)


def test_the_same_call_twice_gives_the_same_bytes_and_threads_do_not_mix(folder: Path) -> None:
    metric, first, second = Lpips("alex", folder), noise(1), noise(2)
    once = metric(first, second, None)
    answers: list[object] = []
    threads = [
        threading.Thread(target=lambda: answers.append(metric(first, second, None).tobytes()))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_allclose([np.frombuffer(a) for a in answers], [once] * 3, rtol=1e-5)
    assert metric(first, second, None).tobytes() == once.tobytes()


@pytest.mark.parametrize("net", NETS)
def test_masks_weigh_the_maps_of_differences(net: Net, folder: Path) -> None:
    metric, target = Lpips(net, folder), noise(1, (3, 32, 320, 3))
    predicted = target.copy()
    predicted[:, :, 288:] = (
        255 - predicted[:, :, 288:]
    )  # changed on the right alone, out of reach of the left
    left, right = np.zeros((2, 3, 32, 320), dtype=bool)
    left[:, :, :80], right[:, :, 240:] = True, True
    everywhere = metric(predicted, target, None)
    np.testing.assert_allclose(metric(predicted, target, np.ones_like(left)), everywhere, rtol=1e-6)
    np.testing.assert_array_equal(metric(predicted, target, left), 0.0)
    assert (metric(predicted, target, right) > 2 * everywhere).all()
    right[1] = False
    assert np.isnan(metric(predicted, target, right)).tolist() == [False, True, False]


@pytest.mark.parametrize("net", NETS)
def test_many_masks_at_once_score_as_one_by_one(net: Net, folder: Path) -> None:
    metric, predicted, target = (
        Lpips(net, folder),
        noise(1, (11, 40, 48, 3)),
        noise(2, (11, 40, 48, 3)),
    )
    masks = [None, *(np.random.default_rng(0).random((3, 11, 40, 48)) < 0.3)]
    masks[2][5] = False
    assert isinstance(metric, ManyMasks)
    one_by_one = [metric(predicted, target, mask) for mask in masks]
    np.testing.assert_allclose(metric.over(predicted, target, masks), one_by_one, atol=1e-6)
    assert np.isnan(one_by_one[2][5])
    assert np.ptp([scores[0] for scores in one_by_one]) > 1e-3  # the masks do matter


def test_features_are_computed_once_for_all_masks_and_the_targets_once_for_all_predictions(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    features, calls = lpips.alex_features, []
    metric, target = Lpips("alex", folder), noise(1)
    metric(noise(2), noise(2), None)  # reads and checks the weights
    monkeypatch.setattr(lpips, "alex_features", lambda *given: calls.append(1) or features(*given))
    scores = metric.over(noise(3), target, [None, np.ones(target.shape[:3], dtype=bool)] * 3)
    assert len(calls) == 2  # predicted and target
    np.testing.assert_array_equal(metric.over(noise(3), target, [None])[0], scores[0])
    assert metric(noise(4), target).tolist() != scores[0].tolist()
    assert len(calls) == 4  # the predictions alone
    target = target.copy()
    target[0, 0, 0, 0] ^= 255
    assert (
        metric(noise(3), target)[0] != scores[0][0]
    )  # another target is not mistaken for the one before


def test_on_two_threads_the_same_values_come_out(folder: Path) -> None:
    predicted, target = noise(1, (13, 32, 40, 3)), noise(2, (13, 32, 40, 3))
    masks = [None, np.random.default_rng(0).random((13, 32, 40)) < 0.3]
    expected = Lpips("alex", folder).over(predicted, target, masks)
    torch.set_num_threads(2)
    np.testing.assert_allclose(
        Lpips("alex", folder).over(predicted, target, masks), expected, rtol=1e-6
    )
    assert torch.get_num_threads() == 2
    torch.set_num_threads(1)


@pytest.mark.parametrize(("size", "cells"), [(256, 63), (37, 5), (8, 8)])
def test_masks_are_shared_out_to_cells_as_torch_pools(size: int, cells: int) -> None:
    rows = torch.rand(1, 4, size)
    pooled = rows @ lpips_networks._pooling(size, cells).T
    torch.testing.assert_close(pooled, nn.functional.adaptive_avg_pool1d(rows, cells))


def test_frames_that_do_not_fit_are_refused(folder: Path) -> None:
    with pytest.raises(BadData, match="expected uint8"):
        Lpips("alex", folder)(noise(1)[:2], noise(1), None)
    with pytest.raises(BadData, match=r"\(31, 64, 3\), expected at least 32x32"):
        Lpips("alex", folder)(noise(1, (1, 31, 64, 3)), noise(2, (1, 31, 64, 3)), None)


def test_it_comes_and_goes_through_the_registry_without_weights() -> None:
    metric = registry.build(
        "frame_metrics", {"name": "lpips", "net": "squeeze", "weights": "some/where.npz"}
    )
    assert metric == Lpips("squeeze", Path("some/where.npz"))
    assert isinstance(metric, FrameMetric)
    settings = {"net": "squeeze", "weights": "some/where.npz", "channels": "rgb"}
    assert registry.describe(metric) == {"name": "lpips", **settings}
    assert registry.build("frame_metrics", "lpips") == Lpips()
    with pytest.raises(BadData, match="net is 'vgg'"):
        registry.build("frame_metrics", {"name": "lpips", "net": "vgg"})


def test_the_field_wins_over_the_variable_and_the_variable_over_the_cache(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cached = tmp_path / "cache" / "geovp" / "lpips_alex_v0.1.npz"
    cached.parent.mkdir(parents=True)
    cached.touch()
    assert lpips.find_weights("alex", None) == cached
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "elsewhere"))
    monkeypatch.setenv("GEOVP_CACHE", str(cached.parent))
    assert lpips.find_weights("alex", None) == cached
    monkeypatch.setenv(lpips.WEIGHTS_VARIABLE, str(folder))
    assert lpips.find_weights("alex", None) == folder / "lpips_alex_v0.1.npz"
    monkeypatch.setenv(lpips.WEIGHTS_VARIABLE, str(folder / "lpips_squeeze_v0.1.npz"))
    assert lpips.find_weights("squeeze", None) == folder / "lpips_squeeze_v0.1.npz"
    assert lpips.find_weights("alex", cached) == cached


@pytest.mark.parametrize("content", [b"", b"no npz at all", b"PK\x03\x04 cut short"])
def test_unreadable_weights_are_said_in_one_sentence(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "bad.npz").write_bytes(content)
    with pytest.raises(MissingExtra, match=r"bad\.npz .* get them anew"):
        Lpips("alex", tmp_path / "bad.npz")(noise(1), noise(2), None)


def test_missing_or_other_weights_are_said_in_one_sentence(folder: Path) -> None:
    with pytest.raises(
        MissingExtra, match=r"nowhere do not exist: name lpips_alex_v0\.1\.npz or its folder"
    ):
        Lpips("alex", folder / "nowhere")(noise(1), noise(2), None)
    with pytest.raises(MissingExtra, match=r"does not hold LPIPS weights for 'squeeze'"):
        Lpips("squeeze", folder / "lpips_alex_v0.1.npz")(noise(1), noise(2), None)


class Shelf(http.server.SimpleHTTPRequestHandler):
    """Serves a folder and counts what was asked for."""

    asked: list[str]

    def do_GET(self) -> None:
        """Note the path, then answer as usual."""
        self.asked.append(self.path)
        super().do_GET()

    def log_message(self, format: str, *args: object) -> None:
        """Be quiet."""


@pytest.fixture
def shelf(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """A server on this machine with a backbone and linear layers as published; gives the paths
    asked for.
    """
    asked: list[str] = []
    root = folder / "shelf"
    root.mkdir()
    weights = random_weights("alex")
    backbone = {name: tensor for name, tensor in weights.items() if name.startswith("features.")}
    linear = {
        f"lin{k}.model.1.weight": weights[f"lin{k}.weight"][None, :, None, None] for k in range(5)
    }
    torch.save({**backbone, "classifier.1.weight": torch.zeros(4)}, root / "backbone.pth")
    torch.save(linear, root / "linear.pth")
    handler = type("Handler", (Shelf,), {"asked": asked})
    server = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), lambda *arguments: handler(*arguments, directory=str(root))
    )
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    here = f"http://127.0.0.1:{server.server_port}"
    remotes = [
        (f"{here}/{name}.pth", sha256_of(root / f"{name}.pth")) for name in ("backbone", "linear")
    ]
    monkeypatch.setattr(lpips, "REMOTES", {"alex": tuple(remotes)})
    yield asked
    server.shutdown()
    thread.join()
    server.server_close()


def sha256_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_weights_are_downloaded_once_and_score_as_the_npz_does(
    shelf: list[str], folder: Path, tmp_path: Path
) -> None:
    predicted, target = noise(1), noise(2)
    scores = Lpips()(predicted, target, None)
    np.testing.assert_array_equal(scores, Lpips("alex", folder)(predicted, target, None))
    Lpips()(predicted, target, None)
    assert shelf == ["/backbone.pth", "/linear.pth"]
    cached = list((tmp_path / "cache" / "geovp").iterdir())
    assert [file.name for file in cached] == ["lpips_alex_v0.1.npz"]
    assert "classifier.1.weight" not in np.load(cached[0]).files


def test_a_download_with_another_hash_is_never_opened(
    shelf: list[str], folder: Path, tmp_path: Path
) -> None:
    right = (folder / "shelf" / "linear.pth").read_bytes()
    (folder / "shelf" / "linear.pth").write_bytes(right[:-1] + b"?")
    with pytest.raises(
        MissingExtra,
        match=r"linear\.pth has SHA-256 [0-9a-f]{8}\.\.\., expected [0-9a-f]{8}\.\.\.\): set",
    ):
        Lpips()(noise(1), noise(2), None)
    assert list((tmp_path / "cache" / "geovp").iterdir()) == []


def test_a_failed_download_is_not_tried_again(shelf: list[str], folder: Path) -> None:
    (folder / "shelf" / "backbone.pth").unlink()
    for _ in range(2):
        with pytest.raises(
            MissingExtra,
            match=r"cannot be downloaded \(HTTP Error 404.*\): set GEOVP_LPIPS_WEIGHTS to",
        ):
            Lpips()(noise(1), noise(2), None)
    assert shelf == ["/backbone.pth"]


def test_without_a_network_the_sentence_says_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as unheard:
        unheard.bind(("127.0.0.1", 0))  # bound but not listening: connections are refused
        here = f"http://127.0.0.1:{unheard.getsockname()[1]}/x.pth"
        monkeypatch.setattr(lpips, "REMOTES", {"alex": ((here, "0" * 64),) * 2})
        with pytest.raises(MissingExtra) as caught:
            Lpips()(noise(1), noise(2), None)
    assert str(caught.value).startswith(
        "LPIPS weights for 'alex' are not on this machine and cannot be downloaded ("
    )
    assert str(caught.value).endswith(
        "set GEOVP_LPIPS_WEIGHTS to lpips_alex_v0.1.npz or its folder"
    )
    assert "\n" not in str(caught.value)


def test_a_cache_that_cannot_be_written_is_a_reason_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(MissingExtra, match=r"cannot be downloaded \(.*Not a directory"):
        Lpips()(noise(1), noise(2), None)


def test_channels_in_the_wrong_order_are_a_setting_that_the_protocol_names(folder: Path) -> None:
    predicted, target = noise(1), noise(2)
    swapped = Lpips("alex", folder, channels="bgr")
    expected = Lpips("alex", folder)(predicted[..., [2, 1, 0]], target[..., [2, 1, 0]], None)
    np.testing.assert_allclose(swapped(predicted, target, None), expected)
    assert np.abs(expected - Lpips("alex", folder)(predicted, target, None)).min() > 1e-4
    assert swapped.protocol == "LPIPS v0.1, alex, BGR in [-1, 1]"
    assert Lpips().protocol == "LPIPS v0.1, alex, RGB in [-1, 1]"
