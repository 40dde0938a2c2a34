"""What SynSin is trained to lower, but for the discriminator: colours, content, and depth where it is known.

The paper's content loss compares features of VGG-19, whose weights are not to be had here. LPIPS's own features take
their place: SqueezeNet's unless told otherwise, so that a table's LPIPS, which is on AlexNet, is not what was learnt.
"""

from __future__ import annotations

import functools
from pathlib import Path

import torch
from torch import Tensor

from learned import lpips
from learned.lpips_networks import Weights, alex_features, squeeze_features


def colour_loss(made: Tensor, real: Tensor) -> Tensor:
    """Mean absolute difference of colours [B, 3, H, W] in [0, 1]."""
    return (made - real).abs().mean()


def content_loss(made: Tensor, real: Tensor, net: lpips.Net) -> Tensor:
    """Mean LPIPS distance of frames [B, 3, H, W] in [0, 1], with gradients to `made`.

    MissingExtra when LPIPS's weights are not to be had.
    """
    weights = _weights(net, lpips.find_weights(net, None), made.device)
    features = {"alex": alex_features, "squeeze": squeeze_features}[net]
    total = made.new_zeros(())
    with torch.no_grad():
        wanted = list(features(weights, _normalised(real)))
    for index, (ours, theirs) in enumerate(zip(features(weights, _normalised(made)), wanted, strict=True)):
        squares = (lpips.unit_length(ours) - lpips.unit_length(theirs)) ** 2
        total = total + torch.einsum("bchw,c->bhw", squares, weights[f"lin{index}.weight"]).mean()
    return total


def depth_loss(
    inverse_depths: Tensor,  # [B, H, W] 1/m
    known: Tensor,  # [B, H, W] 1/m, NaN where nothing is known
) -> Tensor:
    """Mean absolute difference, per typical inverse depth (1/20 m), of what is known; 0 when nothing is."""
    is_known = torch.isfinite(known)
    difference = torch.where(is_known, inverse_depths - torch.nan_to_num(known), 0.0)
    return 20 * difference.abs().sum() / is_known.sum().clamp(min=1)


def psnr_db(made: Tensor, real: Tensor) -> Tensor:
    """Of every pair of frames [B, 3, H, W]: [B]."""
    return -10 * (made - real).square().mean(dim=(1, 2, 3)).clamp(min=1e-10).log10()


def _normalised(frames: Tensor) -> Tensor:
    shift, scale = torch.tensor(lpips.SHIFT), torch.tensor(lpips.SCALE)
    return (2 * frames.float() - 1 - shift.to(frames)[:, None, None]) / scale.to(frames)[:, None, None]


@functools.cache
def _weights(net: lpips.Net, file: Path, device: torch.device) -> Weights:
    return {name: tensor.to(device) for name, tensor in lpips.load_weights(net, file).items()}
