"""Gaps between splatted points shade into the colours around them before the refinement network sees them."""

from __future__ import annotations

from torch import Tensor
from torch.nn import functional

SOLIDITY = 4.0  # where points blend to a quarter of full opacity, nothing behind them shows through
LEAST_OPACITY = 1e-4  # thinner pixels count as empty


def pull_push(blended: Tensor, opacities: Tensor) -> Tensor:
    """Blended values [B, C, H, W] where their opacity [B, 1, H, W] is full, shading into coarser ones where it is thin.

    Of images of half the size, a quarter, and so on (Gortler et al. 1996, section 3.4), so that the gaps that open
    between points as these come nearer, and what they uncover, begin with the colours around them.
    """
    solid = SOLIDITY * opacities
    share = solid.clamp(max=1)
    blended = blended * (share / opacities.clamp(min=LEAST_OPACITY))
    height, width = blended.shape[2:]
    if max(height, width) == 1:
        return blended / share.clamp(min=LEAST_OPACITY)
    padding = (0, width % 2, 0, height % 2)
    coarse, thin = (functional.avg_pool2d(functional.pad(maps, padding), 2) for maps in (blended, share))
    behind = functional.interpolate(pull_push(coarse, thin), scale_factor=2, mode="bilinear")[:, :, :height, :width]
    return blended + (1 - share) * behind
