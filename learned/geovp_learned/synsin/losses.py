"""SynSin's losses: colour, content, depth where it is known, and two self-supervised losses of
depth.

The paper's content loss compares features of VGG-19; by default LPIPS's on SqueezeNet
replace them, since tables report LPIPS on AlexNet. The reprojection loss and the smoothness loss
(Garg et al. 2016; Godard et al. 2019) are not in SynSin, whose depth network learns from the
splatter's gradient alone. That gradient reaches about a pixel and is drowned by the content loss:
on the synthetic street it is a hundred times as long as the true depth's gradient and points
another way (cosine -0.1).
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
from geovp_learned.synsin import splatting
from geovp_learned.tensors import sample_images

ContentNet = Literal["alex", "squeeze", "vgg19"]

VGG19 = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth"  # 575 MB; its name has its hash
LAYER_WEIGHTS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1.0)  # Wang et al. 2018; SynSin's repository
SSIM_WEIGHT = 0.85  # Godard et al. 2019, eq. 2
C1, C2 = 0.01**2, 0.03**2  # SSIM's constants for values in [0, 1]


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


def depth_loss(inverse_depths: Tensor, target: Tensor) -> Tensor:
    """Return the mean absolute difference of inverse depths [B, H, W] 1/m, times 20 m, a typical
    depth; NaN is unknown.
    """
    is_known = torch.isfinite(target)
    difference = torch.where(is_known, inverse_depths - torch.nan_to_num(target), 0.0)
    return 20 * difference.abs().sum() / is_known.sum().clamp(min=1)


def reprojection_loss(
    inverse_depths: Tensor,  # [B, H, W] 1/m
    frames: Tensor,  # [B, 3, H, W] in [0, 1]
    targets: Tensor,  # [B, V, 3, H, W]
    cam_from_last: Tensor,  # [B, V, 4, 4]
    intrinsics: Tensor,  # [B, 4]
) -> Tensor:
    """Return the photometric error of later frames sampled at the reprojected pixels: minimum over
    views, averaged over pixels.

    Pixels that project into no view do not count.
    """
    batch, views = cam_from_last.shape[:2]
    size_px = frames.shape[2:]
    parts = (splatting.rays(intrinsics, size_px), inverse_depths.flatten(1), intrinsics, frames)
    rays, depths, cameras, wanted = (tensor.repeat_interleave(views, dim=0) for tensor in parts)
    positions, _, in_front = splatting.project(rays, depths, cam_from_last.flatten(0, 1), cameras)
    positions = positions.unflatten(1, size_px)  # [B * V, H, W, 2]
    sampled = sample_images(targets.flatten(0, 1), positions)
    difference = (sampled - wanted).abs().mean(dim=1)
    error = (1 - SSIM_WEIGHT) * difference + SSIM_WEIGHT * _dssim(sampled, wanted)
    last_px = positions.new_tensor([size_px[1], size_px[0]]) - 1
    inside = ((positions >= 0) & (positions <= last_px)).all(dim=3)
    shown = inside & in_front.unflatten(1, size_px)
    best = torch.where(shown, error, torch.inf).unflatten(0, (batch, views)).amin(dim=1)
    counted = torch.isfinite(best)
    return torch.where(counted, best, 0.0).sum() / counted.sum().clamp(min=1)


def smoothness_loss(inverse_depths: Tensor, frames: Tensor) -> Tensor:
    """Return the edge-aware smoothness of mean-normalised inverse depths [B, H, W] (Godard et al.
    2019, eq. 3).
    """
    relative = inverse_depths[:, None] / inverse_depths.mean(dim=(1, 2), keepdim=True)[
        :, None
    ].clamp(min=1e-4)
    total = relative.new_zeros(())
    for axis in (2, 3):
        edges = frames.diff(dim=axis).abs().mean(dim=1, keepdim=True)
        total = total + (relative.diff(dim=axis).abs() * torch.exp(-10 * edges)).mean()
    return total


def _dssim(predicted: Tensor, target: Tensor) -> Tensor:
    """Return (1 - SSIM) / 2 over windows of 3x3 pixels [B, H, W]."""
    products = torch.cat([predicted, target, predicted**2 + target**2, predicted * target], dim=1)
    padded = functional.pad(products, (1, 1, 1, 1), mode="reflect")
    a, b, squares, product = functional.avg_pool2d(padded, 3, stride=1).chunk(4, dim=1)
    variances, covariance = squares - a**2 - b**2, product - a * b
    ssim = (2 * a * b + C1) * (2 * covariance + C2) / ((a**2 + b**2 + C1) * (variances + C2))
    return ((1 - ssim) / 2).clamp(0, 1).mean(dim=1)
