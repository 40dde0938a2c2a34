"""SynSin's content loss on VGG-19's features, with torchvision's weights from a file that the user
names.
"""

import functools
import hashlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from geovp_classic.errors import MissingExtra

WEIGHTS_VARIABLE = "GEOVP_VGG19_WEIGHTS"
FILE_NAME = "vgg19-dcbb9e9d.pth"  # 575 MB, from download.pytorch.org/models
SHA256 = "dcbb9e9dad569fff7a846263a77324fc34978fea2bfb039c012d710e1776ae44"
STAGES = (
    (0, 2),
    (5, 7),
    (10, 12, 14, 16),
    (19, 21, 23, 25),
    (28,),
)  # torchvision's numbers; pooling between stages
SHARES = (
    1 / 32,
    1 / 16,
    1 / 8,
    1 / 4,
    1.0,
)  # of the first layer of each stage (Wang et al. 2018; SynSin's repository)


def content_loss(predicted: Tensor, target: Tensor) -> Tensor:
    """Return weighted mean absolute differences of five layers for frames [B, 3, H, W] in [0, 1],
    shown in [-1, 1].

    MissingExtra when there are no weights.
    """
    weights = {name: tensor.to(predicted.device) for name, tensor in load_weights(_named()).items()}
    with torch.no_grad():
        wanted = list(features(weights, 2 * target.float() - 1))
    given = features(weights, 2 * predicted.float() - 1)
    losses = [functional.l1_loss(ours, real) for ours, real in zip(given, wanted, strict=True)]
    return torch.stack([share * loss for share, loss in zip(SHARES, losses, strict=True)]).sum()


def features(weights: Mapping[str, Tensor], pixels: Tensor) -> Iterator[Tensor]:
    """Return the first rectified convolution of each of VGG-19's five stages (Simonyan and
    Zisserman 2015, E).
    """
    for stage, layers in enumerate(STAGES):
        pixels = functional.max_pool2d(pixels, 2) if stage else pixels
        for layer in layers:
            name = f"features.{layer}"
            pixels = functional.conv2d(
                pixels, weights[f"{name}.weight"], weights[f"{name}.bias"], padding=1
            ).relu()
            if layer == layers[0]:
                yield pixels


@functools.cache
def load_weights(file: Path) -> dict[str, Tensor]:
    """Load the tensors of the convolutions, once per process; the file is opened only if its hash
    is right.
    """
    try:
        with file.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
    except OSError as error:
        raise MissingExtra(
            f"VGG-19's weights {file} cannot be read ({error.strerror}): name {FILE_NAME}"
        ) from error
    if digest != SHA256:
        raise MissingExtra(
            f"{file} has SHA-256 {digest[:8]}..., expected {SHA256[:8]}...: name torchvision's "
            f"{FILE_NAME}"
        )
    stored = torch.load(file, map_location="cpu", weights_only=True)
    return {name: tensor for name, tensor in stored.items() if name.startswith("features.")}


def _named() -> Path:
    if not (named := os.environ.get(WEIGHTS_VARIABLE)):
        raise MissingExtra(
            f"the content loss on VGG-19 needs weights: set {WEIGHTS_VARIABLE} to torchvision's "
            f"{FILE_NAME}"
        )
    return Path(named).expanduser()
