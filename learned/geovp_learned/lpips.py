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
import tempfile
import urllib.request
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from torch import Tensor

from geovp_classic.errors import BadData, MissingExtra
from geovp_classic.metrics.image import check_frames
from geovp_classic.types import BoolArray, ByteArray, FloatArray
from geovp_learned import devices
from geovp_learned.lpips_networks import Weights, alex_features, masked_mean, squeeze_features

Net = Literal["alex", "squeeze"]

WEIGHTS_VARIABLE = "GEOVP_LPIPS_WEIGHTS"
TORCHVISION = "https://download.pytorch.org/models/"
AUTHORS = (
    "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/"
    "082bb24f84c091ea94de2867d34c4544f68e0963/lpips/weights/v0.1/"
)
ALEXNET = "alexnet-owt-7be5be79.pth"  # 244 MB, most of it the classifier, which is not kept
SQUEEZENET = "squeezenet1_1-b8a52dc0.pth"  # 5 MB
REMOTES = {  # url and SHA-256 of the backbone, then of the linear layers
    "alex": (
        (TORCHVISION + ALEXNET, "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02"),
        (AUTHORS + "alex.pth", "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0"),
    ),
    "squeeze": (
        (
            TORCHVISION + SQUEEZENET,
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
SHIFT, SCALE = (
    (-0.030, -0.088, -0.188),
    (0.458, 0.448, 0.450),
)  # of RGB in [-1, 1]: ImageNet's mean and deviation
MIN_SIZE_PX = 32  # below it the deepest layers have no pixel left
# frames, on one thread of the CPU: threads share frames, since sharing a layer's work costs them
# more
BATCH = 5
TIMEOUT_S = 20.0

MAX_BYTES = 2**30  # VGG-16 has 528 MiB
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Target:
    """Target frames [F, H, W, 3] and their unit features, of each batch and layer."""

    frames: ByteArray
    features: list[list[Tensor]]  # 52 MB for 20 frames of 256x256, AlexNet


@dataclass(frozen=True)
class Lpips:
    """LPIPS v0.1 with its linear layers, on RGB in [-1, 1] at the frames' own size.

    `channels = "bgr"` hands the network the channels in the wrong order, as evaluation code does
    that reads with OpenCV and forgets to swap them (DMVFN's, for one): for comparison with such
    published numbers alone. With a mask, each layer's map of differences is averaged with the share
    of masked pixels in each cell as the weight. Receptive fields cross the mask's border, so pixels
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
        without weights. A failed download is not repeated in the same process.
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
        batches = [target[start : start + BATCH] for start in range(0, len(target), BATCH)]
        return Target(target, devices.on_one_thread_each(self._features, batches))

    def over(
        self, predicted: ByteArray, target: Target, masks: Sequence[BoolArray | None]
    ) -> list[FloatArray]:
        """Return the distances [F] under each mask; the features are computed once for all."""
        for mask in masks:
            check_frames(predicted, target.frames, mask)

        def distances(batch: int) -> FloatArray:
            frames = slice(batch * BATCH, (batch + 1) * BATCH)
            batch_masks = [None if mask is None else mask[frames] for mask in masks]
            features = self._features(predicted[frames])
            return _distances(self._weights(), features, target.features[batch], batch_masks)

        per_batch = devices.on_one_thread_each(distances, range(len(target.features)))
        return [*np.concatenate(per_batch, axis=1)]

    def _weights(self) -> Weights:
        return _weights_on(self.net, find_weights(self.net, self.weights), self.device or "cpu")

    def _features(self, frames: ByteArray) -> list[Tensor]:
        """Return the unit features of each layer of frames [N, H, W, 3]."""
        if self.channels == "bgr":
            frames = frames[..., ::-1]
        return _features(self.net, self._weights(), frames)


def unit_features(net: Net, weights: Weights, images: Tensor) -> list[Tensor]:
    """Return features [N, C, h, w] of each layer, normalised over channels, of images [N, 3, H, W]
    in [-1, 1].
    """
    shift, scale = (images.new_tensor(values)[:, None, None] for values in (SHIFT, SCALE))
    layers = {"alex": alex_features, "squeeze": squeeze_features}[net](
        weights, (images - shift) / scale
    )
    return [
        layer / (torch.linalg.vector_norm(layer, dim=1, keepdim=True) + 1e-10) for layer in layers
    ]


@torch.inference_mode()
def _features(net: Net, weights: Weights, frames: ByteArray) -> list[Tensor]:
    """Return the unit features of frames [N, H, W, 3], channels last in memory."""
    pixels = torch.tensor(np.ascontiguousarray(frames)).to(weights["lin0.weight"].device)
    return unit_features(net, weights, pixels.permute(0, 3, 1, 2).float() / 127.5 - 1.0)


@torch.inference_mode()
def _distances(
    weights: Weights,
    predicted: Sequence[Tensor],  # unit features of each layer
    target: Sequence[Tensor],
    masks: Sequence[BoolArray | None],  # of [N, H, W]
) -> FloatArray:
    """Return the distance of each pair under each mask [M, N] (Zhang et al. 2018, eq. 1); NaN where
    a mask is empty.
    """
    device = predicted[0].device
    shares = [
        None if mask is None else torch.tensor(mask, dtype=torch.float32, device=device)
        for mask in masks
    ]
    total = torch.zeros(len(masks), len(predicted[0]), dtype=torch.float64, device=device)
    for index, (ours, real) in enumerate(zip(predicted, target, strict=True)):
        squares = (ours - real).square_().movedim(1, -1)  # [N, h, w, C]
        difference = (squares @ weights[f"lin{index}.weight"]).double()
        for number, share in enumerate(shares):
            total[number] += masked_mean(difference, share)
    return np.asarray(total.cpu().numpy())


def find_weights(net: Net, named: Path | None) -> Path:
    """Return the npz file to read, downloaded into the cache if necessary; raise MissingExtra if
    there is none.
    """
    file_name = f"lpips_{net}_v0.1.npz"
    if given := named or os.environ.get(WEIGHTS_VARIABLE):
        place = Path(given).expanduser()
        file = place / file_name if place.is_dir() else place
        if not file.is_file():
            raise MissingExtra(f"LPIPS weights {file} do not exist: name {file_name} or its folder")
        return file
    own_cache = os.environ.get("GEOVP_CACHE")
    users_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "geovp"
    cached = (Path(own_cache) if own_cache else users_cache) / file_name
    if not cached.is_file() and (reason := _why_not_downloaded(net, cached)):
        raise MissingExtra(
            f"LPIPS weights for {net!r} are not on this machine and cannot be downloaded "
            f"({reason}): "
            f"set {WEIGHTS_VARIABLE} to {file_name} or its folder"
        )
    return cached


@functools.cache
def load_weights(net: Net, file: Path) -> Weights:
    """Load the tensors of an npz file, once per process; raise MissingExtra unless they are LPIPS
    v0.1's for this network.
    """
    try:
        with np.load(file) as arrays:
            weights = {
                name: torch.from_numpy(arrays[name].astype(np.float32)) for name in arrays.files
            }
        ours, real = (_features(net, weights, frames) for frames in check_images())
        score = float(_distances(weights, ours, real, [None])[0, 0])
    except (OSError, EOFError, zipfile.BadZipFile, AttributeError, TypeError) as error:
        raise MissingExtra(
            f"LPIPS weights {file} are not a readable npz file ({error}): get them again"
        ) from error
    except (KeyError, ValueError, RuntimeError) as error:
        raise MissingExtra(
            f"{file} does not hold LPIPS weights for {net!r} ({error}): get them again"
        ) from error
    if not abs(score - CHECK_SCORES[net]) < CHECK_TOLERANCE:
        raise MissingExtra(
            f"{file} does not hold LPIPS v0.1's weights for {net!r}: the check images score "
            f"{score:.6f}, "
            f"expected {CHECK_SCORES[net]:.6f}: get them again"
        )
    return weights


@functools.cache
def _weights_on(net: Net, file: Path, device: str) -> Weights:
    """Copy the tensors to a device, those of convolutions with channels last, which is faster."""
    weights = load_weights(net, file)
    ordered = {
        name: w.contiguous(memory_format=torch.channels_last) if w.ndim == 4 else w
        for name, w in weights.items()
    }
    return {name: tensor.to(device) for name, tensor in ordered.items()}


def check_images() -> tuple[ByteArray, ByteArray]:
    """Return a pair of images [1, 64, 64, 3] of integers, the same with all library versions."""
    v, u, channel = np.mgrid[:64, :64, :3]
    waves = (u * (3 + channel) + v * v // 5) % 256
    return waves[None].astype(np.uint8), (255 - waves[None, ::-1] // 2).astype(np.uint8)


@functools.cache
def _why_not_downloaded(net: Net, cached: Path) -> str:
    """Fill the cache; return "" if it worked, else the reason why not. It is tried once per
    process.
    """
    try:
        cached.parent.mkdir(parents=True, exist_ok=True)
        backbone, linear = (_downloaded(url, sha256) for url, sha256 in REMOTES[net])
        arrays: dict[str, Any] = {
            name: value.numpy() for name, value in backbone.items() if "features." in name
        }
        arrays |= {
            f"{name.partition('.')[0]}.weight": value.numpy().ravel()
            for name, value in linear.items()
        }
        with tempfile.TemporaryDirectory(dir=cached.parent) as folder:
            np.savez(Path(folder) / "weights.npz", **arrays)
            (Path(folder) / "weights.npz").replace(cached)
    except (OSError, http.client.HTTPException, BadData) as error:
        return str(error)
    return ""


def _downloaded(url: str, sha256: str) -> Mapping[str, Tensor]:
    """Return the tensors of a .pth file; it is opened only if its hash is right, and nothing in it
    is executed.
    """
    logger.info("downloading %s", url)
    with urllib.request.urlopen(url, timeout=TIMEOUT_S) as response:
        content = response.read(MAX_BYTES)
    digest = hashlib.sha256(content).hexdigest()
    if digest != sha256:
        raise BadData(f"{url} has SHA-256 {digest[:8]}..., expected {sha256[:8]}...")
    return torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
