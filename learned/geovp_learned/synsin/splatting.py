"""Differentiable splatting of feature points: soft discs, the nearest K of a pixel blended (Wiles
et al. 2020).

A point is a ray and an inverse depth q, so that the sky needs no special case: under cam_from_last
= (R, t) it lies at R ray + q t, up to scale, and its new inverse depth is q over that vector's z.
Nothing divides by q. Features and positions have gradients; the choice of the nearest K and their
order are treated as constant.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from geovp_learned.tensors import pixel_grid

MIN_Z = 1e-3  # infinitely far points this close to the image plane are not splatted
EMPTY = -1


@dataclass(frozen=True)
class Splatter:
    """The splatting of points into images.

    A point covers the pixels whose centre lies less than `radius_px` from it, with the opacity 1 -
    distance / radius, where a distance counts as at least `min_distance` radii. Of a pixel's
    points, the nearest `points_per_pixel` are composited from front to back.
    """

    radius_px: float
    points_per_pixel: int
    min_distance: float  # also keeps the square root differentiable at 0

    def __call__(
        self,
        positions_px: Tensor,  # [B, N, 2]
        inverse_depths: Tensor,  # [B, N] 1/m
        visible: Tensor,  # [B, N] bool
        features: Tensor,  # [B, N, C]
        size_px: Sequence[int],  # height, width
    ) -> tuple[Tensor, Tensor]:
        """Return blended features [B, C, H, W], 0 where there is no point, and the sum of their
        weights [B, 1, H, W].
        """
        batch, (height, width) = len(features), size_px
        slots = self._slots(positions_px, inverse_depths, visible, size_px)  # [B * H * W, K]
        pixels = torch.arange(len(slots), device=slots.device)[:, None]
        # Each empty slot has another point, at opacity 0: a GPU adds the gradients of one point
        # one after the other
        points = torch.where(slots == EMPTY, pixels % visible.numel(), slots)
        centres = torch.cat([pixels % width, pixels // width % height], dim=1)
        offsets = positions_px.flatten(0, 1)[points] - centres[:, None]
        squares = offsets.square().sum(dim=2) / self.radius_px**2
        opacities = (1 - squares.clamp(min=self.min_distance**2).sqrt()).clamp(min=0)
        weights = compositing_weights(torch.where(slots == EMPTY, 0.0, opacities))
        blended = functional.embedding_bag(
            points, features.flatten(0, 1), mode="sum", per_sample_weights=weights
        )
        maps = torch.cat([blended, weights.sum(dim=1, keepdim=True)], dim=1)
        maps = maps.view(batch, height, width, -1).permute(0, 3, 1, 2)
        return maps[:, :-1], maps[:, -1:]

    @torch.no_grad()
    def _slots(
        self,
        positions_px: Tensor,
        inverse_depths: Tensor,
        visible: Tensor,
        size_px: Sequence[int],
    ) -> Tensor:
        """Return the nearest points of each pixel [B * H * W, K], in the order of depth; EMPTY
        where there are fewer.
        """
        (batch, num_points), (height, width) = visible.shape, size_px
        numbers = inverse_depths.flatten().argsort(descending=True, stable=True)
        numbers = numbers[visible.flatten()[numbers]]
        positions = positions_px.flatten(0, 1)[numbers]  # [M, 2]
        # A centre within the radius is at most so far from the nearest one
        reach = math.ceil(self.radius_px + 0.5) - 1
        steps = torch.arange(-reach, reach + 1, device=visible.device)
        centres = positions.round().long()[:, None] + torch.cartesian_prod(steps, steps)
        squares = (centres - positions[:, None]).square().sum(dim=2)
        inside = (centres >= 0).all(dim=2) & (centres[..., 0] < width) & (centres[..., 1] < height)
        rows, columns = torch.nonzero(inside & (squares < self.radius_px**2), as_tuple=True)
        u, v = centres[rows, columns].unbind(dim=1)
        points = numbers[rows]
        pixels = (points // num_points * height + v) * width + u
        pixels, order = pixels.sort(stable=True)  # within a pixel, points stay in order of depth
        counts = torch.bincount(pixels, minlength=batch * height * width)
        starts = counts.cumsum(0) - counts
        ranks = torch.arange(len(pixels), device=pixels.device) - starts[pixels]
        num_slots = min(self.points_per_pixel, max(int(counts.max()), 1))  # no slot stays empty
        is_nearest = ranks < num_slots
        slots = pixels.new_full((len(counts), num_slots), EMPTY)
        slots[pixels[is_nearest], ranks[is_nearest]] = points[order][is_nearest]
        return slots


def compositing_weights(opacities: Tensor) -> Tensor:
    """Return the weights [P, K] of points with these opacities, composited from front to back."""
    transmittance = torch.cumprod(1 - opacities, dim=1)
    return opacities * functional.pad(transmittance[:, :-1], (1, 0), value=1.0)


def rays(intrinsics: Tensor, size_px: Sequence[int]) -> Tensor:
    """Return the directions [B, H * W, 3], z = 1, of all pixels of cameras fx, fy, cx, cy [B, 4],
    row by row.
    """
    positions_px = pixel_grid(size_px, intrinsics).flatten(0, 1)
    focal_px, centre_px = intrinsics[:, None].chunk(2, dim=2)  # [B, 1, 2] each
    return functional.pad((positions_px - centre_px) / focal_px, (0, 1), value=1.0)


def project(
    rays_last: Tensor,  # [B, N, 3]
    inverse_depths: Tensor,  # [B, N] 1/m
    cam_from_last: Tensor,  # [B, 4, 4]
    intrinsics: Tensor,  # [B, 4]: fx, fy, cx, cy of the new camera
    near_m: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return positions in pixels [B, N, 2], inverse depths there [B, N], and whether they are in
    front of the camera [B, N].

    Points at the image plane or nearer than `near_m` do not count as in front.
    """
    rotation, translation = cam_from_last[:, :3, :3], cam_from_last[:, :3, 3]
    points = rays_last @ rotation.transpose(1, 2) + inverse_depths[..., None] * translation[:, None]
    z = points[..., 2]
    in_front = (z > MIN_Z) & (z > near_m * inverse_depths)
    z = torch.where(in_front, z, 1.0)
    focal_px, centre_px = intrinsics[:, None].chunk(2, dim=2)
    positions = focal_px * points[..., :2] / z[..., None] + centre_px
    on_image = (
        positions.detach().abs().amax(dim=2) < 1e5
    )  # beyond, float32 pixel indices are not exact
    return positions, inverse_depths / z, in_front & on_image
