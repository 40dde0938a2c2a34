"""SynSin's content loss.

The paper's compares features of VGG-19, whose weights are downloaded. The small network learns with
LPIPS's on SqueezeNet in their place; tables report LPIPS on AlexNet.
"""

import functools
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor
from torch.nn import functional

from geovp_classic import files
from geovp_learned import lpips
from geovp_learned.feature_networks import FeatureNetwork, vgg19

ContentNet = Literal["alex", "squeeze", "vgg19"]

VGG19 = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth"  # 575 MB; its name has its hash
LAYER_WEIGHTS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1.0)  # Wang et al. 2018; SynSin's repository


def content_loss(predicted: Tensor, target: Tensor, net: ContentNet) -> Tensor:
    """Return the mean LPIPS or VGG-19 distance of frames [B, 3, H, W] in [0, 1], differentiable in
    `predicted`.

    BadData or MissingExtra when there are no weights.
    """
    predicted, target = predicted.float(), target.float()
    if net != "vgg19":
        file = lpips.find_weights(net, None)
        return lpips.load_network(net, file, str(predicted.device))(predicted, target).mean()
    network = vgg19_network(predicted.device)
    features = zip(*(network(2 * frames - 1) for frames in (predicted, target)), strict=True)
    losses = torch.stack([functional.l1_loss(ours, real) for ours, real in features])
    return losses @ losses.new_tensor(LAYER_WEIGHTS)


@functools.cache
def vgg19_network(device: torch.device) -> FeatureNetwork:
    """Load VGG-19, once per process; torchvision's weights are read from torch's cache, or
    downloaded into it.
    """
    network, place = vgg19(), f"hub/checkpoints/{Path(VGG19).name} in the folder $TORCH_HOME"
    with files.checked("VGG-19's weights cannot be downloaded", f"put {VGG19} into {place}"):
        weights = torch.hub.load_state_dict_from_url(VGG19, check_hash=True, weights_only=True)
    network.load_state_dict(weights, strict=False)
    return network.requires_grad_(False).to(device)
