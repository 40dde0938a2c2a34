"""Differentiable splatting of feature points in plain torch: soft discs, the nearest K of a pixel blended (Wiles 2020).

A point is a ray and an inverse depth q, so that the sky needs no special case: under cam_from_last = (R, t) it lies at
R ray + q t, up to scale, and its new inverse depth is q over that vector's z. Nothing ever divides by q. Gradients flow
to the features through the blending weights' products and to the positions through the discs; which points are the
nearest K of a pixel, and whether one is in front of another, is not differentiable and taken as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor
from torch.nn import functional

Blending = Literal["alpha", "sum", "mean"]

NEAR_M = 0.5  # points nearer than this to the new camera are not drawn
LEAST_Z = 1e-3  # nor are infinitely far ones this close to its image plane (z of a ray that was 1)
NOTHING = -1
ROUNDING = 1e-6  # keeps the square root of a distance differentiable at 0
LEAST_OPACITY = 1e-3  # of a pixel whose mean is taken


@dataclass(frozen=True)
class Splatter:
    """How points become images.

    A point covers the pixels whose centre lies less than `radius_px` from it, with opacity (1 - distance / radius) to
    the power of `sharpness`. Of a pixel's points the nearest `points_per_pixel` are blended: "alpha" composites them
    from front to back, "sum" adds them weighted by opacity, "mean" divides that by the opacities' sum.
    """

    radius_px: float = 1.0
    points_per_pixel: int = 8
    sharpness: float = 1.0
    blending: Blending = "alpha"

    def __call__(
        self,
        positions_px: Tensor,  # [B, N, 2]
        inverse_depths: Tensor,  # [B, N] 1/m
        visible: Tensor,  # [B, N] bool
        features: Tensor,  # [B, N, C]
        size_px: tuple[int, int],  # height, width
    ) -> tuple[Tensor, Tensor]:
        """Blended features [B, C, H, W], 0 where there is nothing, and their weights' sum [B, 1, H, W]."""
        batch, (height, width) = len(features), size_px
        slots = self._slots(positions_px, inverse_depths, visible, size_px)  # [B * H * W, K]
        weights = self._weights(self._opacities(positions_px, slots, size_px), slots)
        blended = functional.embedding_bag(
            slots.clamp(min=0), features.flatten(0, 1), mode="sum", per_sample_weights=weights
        )
        shape = (batch, height, width, -1)
        return blended.view(shape).permute(0, 3, 1, 2), weights.sum(dim=1).view(shape).permute(0, 3, 1, 2)

    @torch.no_grad()
    def _slots(self, positions_px: Tensor, inverse_depths: Tensor, visible: Tensor, size_px: tuple[int, int]) -> Tensor:
        """Which points are a pixel's nearest [B * H * W, K], in the order of depth; NOTHING where there are fewer."""
        height, width = size_px
        pixels, points = self._pairs(positions_px, inverse_depths, visible, size_px)
        pixels, order = pixels.sort(stable=True)  # within a pixel, points stay in the order of depth
        counts = torch.bincount(pixels, minlength=len(positions_px) * height * width)
        ranks = torch.arange(len(pixels), device=pixels.device) - (counts.cumsum(0) - counts)[pixels]
        kept = ranks < self.points_per_pixel
        slots = pixels.new_full((len(counts), self.points_per_pixel), NOTHING)
        slots[pixels[kept], ranks[kept]] = points[order][kept]
        return slots

    def _pairs(
        self, positions_px: Tensor, inverse_depths: Tensor, visible: Tensor, size_px: tuple[int, int]
    ) -> tuple[Tensor, Tensor]:
        """All pixels [M] and the points [M] that cover them, nearest points first; both numbered over the batch."""
        (batch, num_points), (height, width) = visible.shape, size_px
        numbers = inverse_depths.argsort(dim=1, descending=True, stable=True)
        numbers = numbers + num_points * torch.arange(batch, device=visible.device)[:, None]
        numbers = numbers.flatten()
        numbers = numbers[visible.flatten()[numbers]]
        positions = positions_px.flatten(0, 1)[numbers]  # [M, 2]
        reach = math.ceil(self.radius_px + 0.5) - 1  # a centre within the radius is at most so far from the nearest one
        steps = torch.arange(-reach, reach + 1, device=visible.device)
        offsets = torch.cartesian_prod(steps, steps)
        centres = positions.round().long()[:, None] + offsets  # [M, offsets, 2]
        squares = (centres - positions[:, None]).square().sum(dim=2)
        inside = (centres >= 0).all(dim=2) & (centres[..., 0] < width) & (centres[..., 1] < height)
        rows, columns = torch.nonzero(inside & (squares < self.radius_px**2), as_tuple=True)
        chosen = centres[rows, columns]
        points = numbers[rows]
        return (points // num_points * height + chosen[:, 1]) * width + chosen[:, 0], points

    def _opacities(self, positions_px: Tensor, slots: Tensor, size_px: tuple[int, int]) -> Tensor:
        """Of the points in the slots [B * H * W, K]; 0 in empty ones."""
        height, width = size_px
        pixels = torch.arange(len(slots), device=slots.device)
        centres = torch.stack([pixels % width, pixels // width % height], dim=1)  # [B * H * W, 2]
        positions = positions_px.flatten(0, 1)[slots.clamp(min=0)]
        squares = (positions - centres[:, None]).square().sum(dim=2) / self.radius_px**2
        opacities = (1 - (squares + ROUNDING).sqrt()).clamp(min=0)
        return torch.where(slots == NOTHING, 0.0, opacities**self.sharpness)

    def _weights(self, opacities: Tensor, slots: Tensor) -> Tensor:
        """What each slot adds to its pixel [B * H * W, K]."""
        if self.blending == "sum":
            return opacities
        if self.blending == "mean":
            return opacities / opacities.sum(dim=1, keepdim=True).clamp(min=LEAST_OPACITY)
        through = torch.cumprod(1 - opacities, dim=1)  # what is left of the light behind each
        before = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)
        return opacities * before


def rays(intrinsics: Tensor, size_px: tuple[int, int]) -> Tensor:
    """The directions [B, H * W, 3], z = 1, of all pixels of cameras fx, fy, cx, cy [B, 4], row by row."""
    height, width = size_px
    v, u = torch.meshgrid(
        torch.arange(height, dtype=intrinsics.dtype, device=intrinsics.device),
        torch.arange(width, dtype=intrinsics.dtype, device=intrinsics.device),
        indexing="ij",
    )
    fx, fy, cx, cy = intrinsics[:, :, None].unbind(dim=1)  # [B, 1] each
    x, y = (u.flatten() - cx) / fx, (v.flatten() - cy) / fy
    return torch.stack([x, y, torch.ones_like(x)], dim=2)


def project(
    rays_last: Tensor,  # [B, N, 3]
    inverse_depths: Tensor,  # [B, N] 1/m
    cam_from_last: Tensor,  # [B, 4, 4]
    intrinsics: Tensor,  # [B, 4]: fx, fy, cx, cy of the new camera
) -> tuple[Tensor, Tensor, Tensor]:
    """Positions in pixels [B, N, 2], inverse depths there [B, N], and whether they are in front of the camera [B, N].

    The last says False for points behind the new camera, at its image plane or nearer than NEAR_M.
    """
    rotation, translation = cam_from_last[:, :3, :3], cam_from_last[:, :3, 3]
    points = rays_last @ rotation.transpose(1, 2) + inverse_depths[..., None] * translation[:, None]
    z = points[..., 2]
    in_front = (z > LEAST_Z) & (z > NEAR_M * inverse_depths)
    z = torch.where(in_front, z, 1.0)
    fx, fy, cx, cy = intrinsics[:, :, None].unbind(dim=1)
    positions = torch.stack([fx * points[..., 0] / z + cx, fy * points[..., 1] / z + cy], dim=2)
    on_image = positions.detach().abs().amax(dim=2) < 1e5  # beyond, whole numbers are no longer exact
    return positions, inverse_depths / z, in_front & on_image
