"""SynSin's content loss on VGG-19's features, with torchvision's weights from a file that the user
names.
"""

import functools
import hashlib
import os
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from geovp_classic import files
from geovp_classic.errors import BadData, MissingExtra
from geovp_learned.feature_networks import FeatureNetwork, vgg19

WEIGHTS_VARIABLE = "GEOVP_VGG19_WEIGHTS"
FILE_NAME = "vgg19-dcbb9e9d.pth"  # 575 MB, from download.pytorch.org/models
SHA256 = "dcbb9e9dad569fff7a846263a77324fc34978fea2bfb039c012d710e1776ae44"
LAYER_WEIGHTS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1.0)  # Wang et al. 2018; SynSin's repository


def content_loss(predicted: Tensor, target: Tensor) -> Tensor:
    """Return weighted mean absolute differences of five layers for frames [B, 3, H, W] in [0, 1].

    MissingExtra when there are no weights.
    """
    network = load(os.environ.get(WEIGHTS_VARIABLE), predicted.device)
    total = predicted.new_zeros(())
    features = (network(2 * frames - 1) for frames in (predicted, target))
    for weight, ours, real in zip(LAYER_WEIGHTS, *features, strict=True):
        total = total + weight * functional.l1_loss(ours, real)
    return total


@functools.cache
def load(file: str | None, device: torch.device) -> FeatureNetwork:
    """Load the network, once per process; the file is opened only if its hash is right."""
    advice = f"set {WEIGHTS_VARIABLE} to torchvision's {FILE_NAME}"
    if not file:
        raise MissingExtra(f"the content loss on VGG-19 needs weights: {advice}")
    try:
        with files.opened(Path(file).expanduser()) as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
    except BadData as error:
        raise MissingExtra(str(error)) from error
    if digest != SHA256:
        raise MissingExtra(
            f"{file} has SHA-256 {digest[:8]}..., expected {SHA256[:8]}...: {advice}"
        )
    with torch.device("meta"):
        network = vgg19()
    stored = torch.load(Path(file).expanduser(), map_location=device, weights_only=True)
    network.load_state_dict(stored, strict=False, assign=True)
    return network.requires_grad_(False)
