"""Learned perceptual distance LPIPS v0.1 (Zhang et al. 2018) in plain torch, on AlexNet or
SqueezeNet 1.1.

Weights are not part of the package. They come from the `weights` field, else from the environment
variable GEOVP_LPIPS_WEIGHTS (both: an npz file, or a folder with `lpips_alex_v0.1.npz` and
`lpips_squeeze_v0.1.npz`), else from the cache (GEOVP_CACHE, or the user's), which is downloaded
from torchvision and the LPIPS authors and checked by SHA-256. Weights from any source must first
give a known pair of images its known score.
"""

import functools
import hashlib
import http.client
import io
import logging
import math
import os
import urllib.request
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from geovp_classic import atomic, files
from geovp_classic.errors import BadData, MissingExtra
from geovp_classic.metrics.image import check_frames
from geovp_classic.types import BoolArray, ByteArray, FloatArray
from geovp_learned import devices
from geovp_learned.feature_networks import alexnet, squeezenet
from geovp_learned.tensors import images_from_frames

Net = Literal["alex", "squeeze"]

WEIGHTS_VARIABLE = "GEOVP_LPIPS_WEIGHTS"
TORCHVISION = "https://download.pytorch.org/models/"
AUTHORS = (
    "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/"
    "082bb24f84c091ea94de2867d34c4544f68e0963/lpips/weights/v0.1/"
)
REMOTES = {  # url and SHA-256 of the backbone, then of the linear layers
    "alex": (
        # 244 MB, most of it the classifier, which is not kept
        (
            TORCHVISION + "alexnet-owt-7be5be79.pth",
            "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02",
        ),
        (AUTHORS + "alex.pth", "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0"),
    ),
    "squeeze": (
        (
            TORCHVISION + "squeezenet1_1-b8a52dc0.pth",
            "b8a52dc049b60e4b6ab68ad0df457362afab8b6304b2febdc1650a5dab4d7e7b",
        ),
        (
            AUTHORS + "squeeze.pth",
            "4a5350f23600cb79923ce65bb07cbf57dca461329894153e05a1346bd531cf76",
        ),
    ),
}
CHECK_SCORES = {"alex": 0.389235, "squeeze": 0.443713}  # of `check_images`, under the weights above
CHECK_TOLERANCE = 1e-4
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet, RGB in [0, 1]
MIN_SIZE_PX = 32  # below it the deepest layers have no pixel left
BATCH = 5  # frames; limits memory
TIMEOUT_S = 20.0

logger = logging.getLogger(__name__)


class LpipsNetwork(nn.Module):
    """LPIPS v0.1 as a network (Zhang et al. 2018, eq. 1)."""

    def __init__(self, net: Net) -> None:
        super().__init__()
        self.backbone = alexnet() if net == "alex" else squeezenet()
        channels = self.backbone.channels.values()
        self.linear = nn.ModuleList(nn.Conv2d(size, 1, 1, bias=False) for size in channels)

    def forward(self, predicted: Tensor, target: Tensor) -> Tensor:
        """Return the distances [N] of images [N, 3, H, W] in [0, 1]."""
        maps = self.difference_maps(self.unit_features(predicted), self.unit_features(target))
        return torch.stack([each.mean(dim=(1, 2)) for each in maps]).sum(dim=0)

    def unit_features(self, images: Tensor) -> list[Tensor]:
        """Return the features of each layer [N, C, h, w], normalised over channels."""
        mean, std = (images.new_tensor(values)[:, None, None] for values in (MEAN, STD))
        features = self.backbone((images - mean) / std)
        return [
            maps / (torch.linalg.vector_norm(maps, dim=1, keepdim=True) + 1e-10)
            for maps in features
        ]

    def difference_maps(self, predicted: list[Tensor], target: list[Tensor]) -> list[Tensor]:
        """Return the weighted squared differences [N, h, w] of the unit features of each layer."""
        layers = zip(self.linear, predicted, target, strict=True)
        return [linear((ours - real) ** 2)[:, 0] for linear, ours, real in layers]


@dataclass(frozen=True)
class Target:
    """Target frames [F, H, W, 3] and the unit features of their batches."""

    frames: ByteArray
    features: list[list[Tensor]]  # 52 MB for 20 frames of 256x256, AlexNet


@dataclass(frozen=True)
class Lpips:
    """LPIPS v0.1 with its linear layers, on RGB in [-1, 1] at the frames' own size.

    `channels = "bgr"` hands the network the channels in the wrong order, as evaluation code does
    that reads with OpenCV and forgets to swap them (DMVFN's, for one): for comparison with such
    published numbers alone. With a mask, each layer's map of differences is averaged with the
    fraction of masked pixels as the weight. Receptive fields cross the mask's border, so pixels
    outside still have some influence. `device` is as in `devices`; the CPU, where nothing is given.
    """

    net: Net = "alex"
    weights: Path | None = None
    channels: Literal["rgb", "bgr"] = "rgb"
    device: str | None = None

    def __post_init__(self) -> None:
        device = devices.resolved(self.device or "cpu")
        object.__setattr__(
            self, "device", None if device == "cpu" else device
        )  # as in results without the field

    unit: ClassVar[str] = ""
    higher_is_better: ClassVar[bool] = False
    bounds: ClassVar[tuple[float, float]] = (0.0, math.inf)

    @property
    def protocol(self) -> str:
        """Return the definition in words."""
        return f"LPIPS v0.1, {self.net}, {self.channels.upper()} in [-1, 1]"

    def __call__(
        self, predicted: ByteArray, target: ByteArray, mask: BoolArray | None = None
    ) -> FloatArray:
        """Return the distance per frame [F], at least 0.

        Raise BadData when the arrays do not fit together or are below 32 pixels, and MissingExtra
        without weights.
        """
        return self.over(predicted, self.prepare(target), [mask])[0]

    def prepare(self, target: ByteArray) -> Target:
        """Return target frames [F, H, W, 3] with their features, to be compared with many
        predictions.
        """
        check_frames(target, target, None)
        if min(target.shape[1:3]) < MIN_SIZE_PX:
            raise BadData(
                f"LPIPS of frames of shape {target.shape[1:]}, expected at least 32x32 pixels: "
                "use larger"
            )
        unit_features = self._network().unit_features
        return Target(target, devices.on_one_thread_each(unit_features, self._batches(target)))

    def over(
        self, predicted: ByteArray, target: Target, masks: Sequence[BoolArray | None]
    ) -> list[FloatArray]:
        """Return the distances [F] under each mask; the features are computed once for all."""
        for mask in masks:
            check_frames(predicted, target.frames, mask)
        everywhere = np.ones(predicted.shape[:3], dtype=bool)
        all_masks = np.stack([everywhere if mask is None else mask for mask in masks])
        weights = torch.tensor(all_masks).float().split(BATCH, dim=1)
        network = self._network()

        def distances(batch: tuple[Tensor, list[Tensor], Tensor]) -> Tensor:
            images, features, weights = batch
            maps = network.difference_maps(network.unit_features(images), features)
            return torch.stack(
                [masked_means(each, weights.to(images.device)) for each in maps]
            ).sum(0)

        batches = zip(self._batches(predicted), target.features, weights, strict=True)
        rows = torch.cat(devices.on_one_thread_each(distances, batches), dim=1)
        return [*rows.double().cpu().numpy()]

    def _network(self) -> LpipsNetwork:
        return load_network(self.net, find_weights(self.net, self.weights), self.device or "cpu")

    def _batches(self, frames: ByteArray) -> Sequence[Tensor]:
        """Convert frames [F, H, W, 3] to batches of images [N, 3, H, W] in [0, 1]."""
        if self.channels == "bgr":
            frames = frames[..., ::-1]
        return images_from_frames(frames).to(self.device or "cpu").split(BATCH)


def masked_means(maps: Tensor, masks: Tensor) -> Tensor:
    """Return the means [M, N] of maps [N, h, w], weighted by resized masks [M, N, H, W].

    An empty mask gives NaN.
    """
    weights = functional.adaptive_avg_pool2d(masks, (maps.shape[1], maps.shape[2]))
    return (maps * weights).sum(dim=(2, 3)) / weights.sum(dim=(2, 3))


def find_weights(net: Net, named: Path | None) -> Path:
    """Return the npz file to read, downloaded into the cache if necessary; raise MissingExtra if
    there is none.
    """
    file_name = f"lpips_{net}_v0.1.npz"
    if given := named or os.environ.get(WEIGHTS_VARIABLE):
        place = Path(given).expanduser()
        return place / file_name if place.is_dir() else place
    users_cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"), "geovp")
    cached = Path(os.environ.get("GEOVP_CACHE", users_cache), file_name)
    if not cached.is_file():
        try:
            _download(net, cached)
        except (OSError, http.client.HTTPException) as error:
            raise MissingExtra(
                f"LPIPS weights for {net!r} are not on this machine and cannot be downloaded "
                f"({error}): set {WEIGHTS_VARIABLE} to {file_name} or its folder"
            ) from error
    return cached


@functools.cache
def load_network(net: Net, file: Path, device: str) -> LpipsNetwork:
    """Load the network from an npz file, once per process; raise MissingExtra unless it gives the
    check images the score of LPIPS v0.1.
    """
    try:
        arrays = files.read_npz(file)
        advice = "get them again"
        with files.checked(f"{file} does not hold LPIPS v0.1's weights for {net!r}", advice):
            network = _network_of(net, arrays)
            score = float(network(*map(images_from_frames, check_images())))
            expected = CHECK_SCORES[net]
            if not abs(score - expected) < CHECK_TOLERANCE:
                raise ValueError(f"the check images score {score:.6f}, expected {expected:.6f}")
    except BadData as error:
        raise MissingExtra(str(error)) from error
    # Channels last are twice as fast on a CPU
    return network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]


def _network_of(net: Net, arrays: Mapping[str, Any]) -> LpipsNetwork:
    network = LpipsNetwork(net)
    state = {}
    for key, parameter in network.state_dict().items():
        array = arrays[key.removeprefix("backbone.").replace("linear.", "lin")]
        state[key] = torch.from_numpy(array).view_as(parameter)
    network.load_state_dict(state)
    return network.requires_grad_(False)


def check_images() -> tuple[ByteArray, ByteArray]:
    """Return a pair of images [1, 64, 64, 3] of integers, the same with all library versions."""
    v, u, channel = np.mgrid[:64, :64, :3]
    waves = (u * (3 + channel) + v * v // 5) % 256
    return waves[None].astype(np.uint8), (255 - waves[None, ::-1] // 2).astype(np.uint8)


def _download(net: Net, cached: Path) -> None:
    """Fill the cache; a file is opened only if its hash is right, and nothing in it is executed."""
    arrays: dict[str, Any] = {}
    cached.parent.mkdir(parents=True, exist_ok=True)
    for url, sha256 in REMOTES[net]:
        logger.info("downloading %s", url)
        with urllib.request.urlopen(url, timeout=TIMEOUT_S) as response:
            content = response.read()
        if hashlib.sha256(content).hexdigest() != sha256:
            raise OSError(f"{url} does not have the SHA-256 {sha256[:8]}...")
        for name, tensor in torch.load(io.BytesIO(content), weights_only=True).items():
            if not name.startswith("classifier."):
                arrays[name.replace(".model.1", "")] = tensor.numpy()
    with atomic.atomic_write(cached) as scratch, scratch.open("wb") as file:
        np.savez(file, **arrays)
