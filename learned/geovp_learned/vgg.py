"""SynSin's content loss on VGG-19's features, with torchvision's weights."""

import functools
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from geovp_classic import files
from geovp_learned.feature_networks import FeatureNetwork, vgg19

URL = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth"  # 575 MB; its name has its hash
LAYER_WEIGHTS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1.0)  # Wang et al. 2018; SynSin's repository


def content_loss(predicted: Tensor, target: Tensor) -> Tensor:
    """Return weighted mean absolute differences of five layers for frames [B, 3, H, W] in [0, 1].

    BadData when there are no weights.
    """
    network = load(predicted.device)
    features = zip(*(network(2 * frames - 1) for frames in (predicted, target)), strict=True)
    losses = torch.stack([functional.l1_loss(ours, real) for ours, real in features])
    return losses @ losses.new_tensor(LAYER_WEIGHTS)


@functools.cache
def load(device: torch.device) -> FeatureNetwork:
    """Load the network, once per process; the weights are read from torch's cache, or downloaded
    into it.
    """
    network, place = vgg19(), f"hub/checkpoints/{Path(URL).name} in the folder $TORCH_HOME"
    with files.checked("VGG-19's weights cannot be downloaded", f"put {URL} into {place}"):
        weights = torch.hub.load_state_dict_from_url(URL, check_hash=True, weights_only=True)
    network.load_state_dict(weights, strict=False)
    return network.requires_grad_(False).to(device)
