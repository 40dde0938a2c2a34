"""SynSin's content loss on VGG-19's features, with torchvision's weights from a file that the user
names.
"""

import functools
import os
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from geovp_classic import files
from geovp_classic.errors import MissingExtra
from geovp_learned import lpips
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
    features = zip(*(network(2 * frames - 1) for frames in (predicted, target)), strict=True)
    losses = torch.stack([functional.l1_loss(ours, real) for ours, real in features])
    return losses @ losses.new_tensor(LAYER_WEIGHTS)


@functools.cache
def load(file: str | None, device: torch.device) -> FeatureNetwork:
    """Load the network, once per process; the file is opened only if its hash is right."""
    if not file:
        raise MissingExtra(
            f"the content loss on VGG-19 needs weights: set {WEIGHTS_VARIABLE} to torchvision's "
            f"{FILE_NAME}"
        )
    content = files.read_bytes(Path(file).expanduser(), lpips.MAX_BYTES)
    network = vgg19()
    network.load_state_dict(lpips.tensors_of_pth(content, file, SHA256), strict=False)
    return network.requires_grad_(False).to(device)
