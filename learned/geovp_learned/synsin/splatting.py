"""Differentiable splatting of feature points: soft discs, the nearest K of a pixel blended (Wiles
et al. 2020).

A point is a ray and an inverse depth q, so that the sky needs no special case: under cam_from_last
= (R, t) it lies at R ray + q t, up to scale, and its new inverse depth is q over that vector's z.
Nothing divides by q. Features and positions have gradients; the choice of the nearest K and their
order are treated as constant.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

NEAR_M = 0.5  # points nearer than this to the new camera are not splatted
MIN_Z = 1e-3  # nor are infinitely far ones this close to its image plane (z of a ray that was 1)
EMPTY = -1
EPS = 1e-6  # keeps the square root of a distance differentiable at 0
SOLID_FACTOR = 4.0  # pull_push treats pixels of a quarter of full opacity as solid
MIN_PULL_OPACITY = 1e-4  # thinner pixels count as empty in pull_push


@dataclass(frozen=True)
class Splatter:
    """The splatting of points into images.

    A point covers the pixels whose centre lies less than `radius_px` from it, with the opacity 1 -
    distance / radius. Of a pixel's points, the nearest `points_per_pixel` are composited from front
    to back.
    """

    radius_px: float = 1.0
    points_per_pixel: int = 8

    def __call__(
        self,
        positions_px: Tensor,  # [B, N, 2]
        inverse_depths: Tensor,  # [B, N] 1/m
        visible: Tensor,  # [B, N] bool
        features: Tensor,  # [B, N, C]
        size_px: tuple[int, int],  # height, width
    ) -> tuple[Tensor, Tensor]:
        """Return blended features [B, C, H, W], 0 where there is no point, and the sum of their
        weights [B, 1, H, W].
        """
        batch, (height, width) = len(features), size_px
        slots = self._slots(positions_px, inverse_depths, visible, size_px)  # [B * H * W, K]
        weights = compositing_weights(self._opacities(positions_px, slots, size_px))
        blended = functional.embedding_bag(
            _filled(slots, visible.numel()),
            features.flatten(0, 1),
            mode="sum",
            per_sample_weights=weights,
        )
        shape = (batch, height, width, -1)
        return blended.view(shape).permute(0, 3, 1, 2), weights.sum(dim=1).view(shape).permute(
            0, 3, 1, 2
        )

    @torch.no_grad()
    def _slots(
        self,
        positions_px: Tensor,
        inverse_depths: Tensor,
        visible: Tensor,
        size_px: tuple[int, int],
    ) -> Tensor:
        """Return the nearest points of each pixel [B * H * W, K], in the order of depth; EMPTY
        where there are fewer.
        """
        height, width = size_px
        pixels, points = self._pairs(positions_px, inverse_depths, visible, size_px)
        pixels, order = pixels.sort(
            stable=True
        )  # within a pixel, points stay in the order of depth
        counts = torch.bincount(pixels, minlength=len(positions_px) * height * width)
        ranks = (
            torch.arange(len(pixels), device=pixels.device) - (counts.cumsum(0) - counts)[pixels]
        )
        is_nearest = ranks < self.points_per_pixel
        slots = pixels.new_full((len(counts), self.points_per_pixel), EMPTY)
        slots[pixels[is_nearest], ranks[is_nearest]] = points[order][is_nearest]
        return slots

    def _pairs(
        self,
        positions_px: Tensor,
        inverse_depths: Tensor,
        visible: Tensor,
        size_px: tuple[int, int],
    ) -> tuple[Tensor, Tensor]:
        """Return all pairs of a pixel [M] and a point [M] that covers it, nearest points first;
        indices over the batch.
        """
        (batch, num_points), (height, width) = visible.shape, size_px
        numbers = inverse_depths.argsort(dim=1, descending=True, stable=True)
        numbers = numbers + num_points * torch.arange(batch, device=visible.device)[:, None]
        numbers = numbers.flatten()
        numbers = numbers[visible.flatten()[numbers]]
        positions = positions_px.flatten(0, 1)[numbers]  # [M, 2]
        reach = (
            math.ceil(self.radius_px + 0.5) - 1
        )  # a centre within the radius is at most so far from the nearest one
        steps = torch.arange(-reach, reach + 1, device=visible.device)
        offsets = torch.cartesian_prod(steps, steps)
        centres = positions.round().long()[:, None] + offsets  # [M, offsets, 2]
        squares = (centres - positions[:, None]).square().sum(dim=2)
        inside = (centres >= 0).all(dim=2) & (centres[..., 0] < width) & (centres[..., 1] < height)
        rows, columns = torch.nonzero(inside & (squares < self.radius_px**2), as_tuple=True)
        covered = centres[rows, columns]
        points = numbers[rows]
        return (points // num_points * height + covered[:, 1]) * width + covered[:, 0], points

    def _opacities(self, positions_px: Tensor, slots: Tensor, size_px: tuple[int, int]) -> Tensor:
        """Return the opacities of the points in the slots [B * H * W, K]; 0 in empty ones."""
        height, width = size_px
        pixels = torch.arange(len(slots), device=slots.device)
        centres = torch.stack([pixels % width, pixels // width % height], dim=1)  # [B * H * W, 2]
        positions = positions_px.flatten(0, 1)
        positions = positions[_filled(slots, len(positions))]
        squares = (positions - centres[:, None]).square().sum(dim=2) / self.radius_px**2
        opacities = (1 - (squares + EPS).sqrt()).clamp(min=0)
        return torch.where(slots == EMPTY, 0.0, opacities)


def compositing_weights(opacities: Tensor) -> Tensor:
    """Return the weights [P, K] of points with these opacities, composited from front to back."""
    transmittance = torch.cumprod(1 - opacities, dim=1)
    before = torch.cat([torch.ones_like(transmittance[:, :1]), transmittance[:, :-1]], dim=1)
    return opacities * before


def _filled(slots: Tensor, num_points: int) -> Tensor:
    """Return the slots [P, K] with some point in empty ones, where it has no weight.

    Each pixel takes another point: a GPU adds the gradients of one point one after the other.
    """
    others = torch.arange(len(slots), device=slots.device)[:, None] % num_points
    return torch.where(slots == EMPTY, others, slots)


def rays(intrinsics: Tensor, size_px: tuple[int, int]) -> Tensor:
    """Return the directions [B, H * W, 3], z = 1, of all pixels of cameras fx, fy, cx, cy [B, 4],
    row by row.
    """
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
    """Return positions in pixels [B, N, 2], inverse depths there [B, N], and whether they are in
    front of the camera [B, N].

    Points at the image plane or nearer than NEAR_M do not count as in front.
    """
    rotation, translation = cam_from_last[:, :3, :3], cam_from_last[:, :3, 3]
    points = rays_last @ rotation.transpose(1, 2) + inverse_depths[..., None] * translation[:, None]
    z = points[..., 2]
    in_front = (z > MIN_Z) & (z > NEAR_M * inverse_depths)
    z = torch.where(in_front, z, 1.0)
    fx, fy, cx, cy = intrinsics[:, :, None].unbind(dim=1)
    positions = torch.stack([fx * points[..., 0] / z + cx, fy * points[..., 1] / z + cy], dim=2)
    on_image = (
        positions.detach().abs().amax(dim=2) < 1e5
    )  # beyond, float32 pixel indices are not exact
    return positions, inverse_depths / z, in_front & on_image


def pull_push(blended: Tensor, opacities: Tensor) -> Tensor:
    """Fill holes: where the opacity [B, 1, H, W] is low, blended values [B, C, H, W] of coarser
    images show through.

    Pull-push over an image pyramid (Gortler et al. 1996, section 3.4), so that the refinement
    network starts with the surrounding colours in gaps between points and in disoccluded regions.
    """
    solid = SOLID_FACTOR * opacities
    coverage = solid.clamp(max=1)
    blended = blended * (coverage / opacities.clamp(min=MIN_PULL_OPACITY))
    height, width = blended.shape[2:]
    if max(height, width) == 1:
        return blended / coverage.clamp(min=MIN_PULL_OPACITY)
    padding = (0, width % 2, 0, height % 2)
    coarse, thin = (
        functional.avg_pool2d(functional.pad(maps, padding), 2) for maps in (blended, coverage)
    )
    behind = functional.interpolate(pull_push(coarse, thin), scale_factor=2, mode="bilinear")[
        :, :, :height, :width
    ]
    return blended + (1 - coverage) * behind
