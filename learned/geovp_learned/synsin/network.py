"""SynSin's generator: features and inverse depths of one frame, splatted into other cameras and
refined to images.

Its networks are those of a variant: of Wiles et al. 2020 (`published`) or ours (`residual`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn

from geovp_classic.errors import BadData
from geovp_learned.synsin import splatting
from geovp_learned.synsin.splatting import Splatter

COLOURS = 3
INITIAL_M = 20.0  # the untrained network's depth


@dataclass(frozen=True)
class Architecture:
    """Sizes of the three networks, and the splatter; stored with the weights."""

    variant: Literal["residual", "published"] = "residual"
    features: int = 64  # of a point, its three colours included in `residual`
    width: int = 64  # channels of a residual block at the finest level
    feature_blocks: int = 8  # from here on of `residual` alone
    inner_blocks: int = 4  # of the refinement network at its coarsest level
    noise_size: int = 16
    patch_px: int = 1
    depth_px: int = 256
    depth_channels: tuple[int, ...] = (32, 64, 128, 256, 256, 256)
    splatter: Splatter = field(default_factory=Splatter)
    # from here on of `published` alone
    unit_m: float = 50.0  # length of the network's unit: data/kitti.py divides translations by 50
    # Depths in units; (0, 0) = inverse depths from .01 to 10.01, that is depths from 5 m to 5 km
    depth_range: tuple[float, float] = (0.0, 0.0)
    focal_px: float = 0.0  # focal length of the images it was trained on; 0 = any

    def __post_init__(self) -> None:
        multiple = 2 ** len(self.depth_channels)
        if self.depth_px % multiple:
            raise BadData(f"depth_px is {self.depth_px}, expected a multiple of {multiple}")


class FeatureCloud(NamedTuple):
    """Feature points of frames, one per pixel, in their own cameras' frames."""

    rays: Tensor  # [B, N, 3], z = 1
    inverse_depths: Tensor  # [B, N] 1/m
    features: Tensor  # [B, N, C], the colours in [0, 1] first where there is a colour shortcut

    def repeated(self, times: int) -> FeatureCloud:
        """Repeat each cloud `times` times in a row."""
        return FeatureCloud(*(tensor.repeat_interleave(times, dim=0) for tensor in self))


class Images(NamedTuple):
    """Clouds rendered from new cameras."""

    frames: Tensor  # [B, 3, H, W] in [0, 1]; not clamped
    opacities: Tensor  # [B, 1, H, W]; 0 where there is no point
    inverse_depths: Tensor  # [B, 1, H, W] 1/m; 0 also where there is no point


class Generator(nn.Module, ABC):
    """SynSin without its discriminator; subclasses add the networks of a variant.

    The depth network estimates inverse depths [B, H, W] of frames [B, 3, H, W] in [0, 1] with rays
    [B, H * W, 3].
    """

    depth_network: nn.Module
    near_m = splatting.NEAR_M
    feature_noise: int  # how many numbers of noise the networks take
    refinement_noise: int

    def forward(
        self,
        frames: Tensor,  # [B, 3, H, W] in [0, 1]
        intrinsics: Tensor,  # [B, 4]: fx, fy, cx, cy in pixels
        cam_from_last: Tensor | None = None,  # [B, V, 4, 4], metres
        depth_gradient_scale: float = 1.0,
    ) -> tuple[Images | None, Tensor]:
        """Render the images of V views each [B * V, ...], under random noise; return the frames'
        inverse depths [B, H, W], too.

        Without motion only the depths are computed. `depth_gradient_scale` scales the images'
        gradient in the depth network.
        """
        size_px = frames.shape[2:]
        if cam_from_last is None:
            return None, self.depth_network(frames, splatting.rays(intrinsics, size_px))
        noise = torch.randn(len(frames), self.feature_noise, device=frames.device)
        cloud = self.encode(frames, intrinsics, noise)
        inverse_depths, views = cloud.inverse_depths, cam_from_last.shape[1]
        scaled = inverse_depths.detach().lerp(inverse_depths, depth_gradient_scale)
        cloud = cloud._replace(inverse_depths=scaled)
        noise = torch.randn(len(frames) * views, self.refinement_noise, device=frames.device)
        cameras = intrinsics.repeat_interleave(views, dim=0)
        images = self.render(
            cloud.repeated(views), cam_from_last.flatten(0, 1), cameras, size_px, noise
        )
        return images, inverse_depths.unflatten(1, size_px)

    def encode(self, frames: Tensor, intrinsics: Tensor, noise: Tensor) -> FeatureCloud:
        """Encode frames [B, 3, H, W] of cameras [B, 4] as clouds, with noise [B, feature_noise]."""
        rays = self.rays(intrinsics, frames.shape[2:])
        features = self.features(frames, noise).flatten(2).transpose(1, 2)
        return FeatureCloud(rays, self.depth_network(frames, rays).flatten(1), features)

    def render(
        self,
        cloud: FeatureCloud,
        cam_from_last: Tensor,
        intrinsics: Tensor,
        size_px: Sequence[int],
        noise: Tensor,
    ) -> Images:
        """Render clouds from poses [B, 4, 4] of cameras [B, 4], in images of (height, width), with
        noise [B, refinement_noise].
        """
        with torch.autocast(cloud.rays.device.type, enabled=False):
            positions, inverse_depths, visible = splatting.project(
                cloud.rays, cloud.inverse_depths, cam_from_last, intrinsics, self.near_m
            )
            points = torch.cat([cloud.features, inverse_depths[..., None]], dim=2)
            splatter = self.splatter(size_px[0])
            blended, opacities = splatter(positions, inverse_depths, visible, points, size_px)
        return self.refine(blended, opacities, noise)

    def rays(self, intrinsics: Tensor, size_px: Sequence[int]) -> Tensor:
        """Return the directions [B, H * W, 3], z = 1, of the pixels of frames."""
        return splatting.rays(intrinsics, size_px)

    @abstractmethod
    def features(self, frames: Tensor, noise: Tensor) -> Tensor:
        """Return features [B, C, H, W] of frames [B, 3, H, W]."""

    @abstractmethod
    def splatter(self, height_px: int) -> Splatter:
        """Return the splatter for images of this height."""

    @abstractmethod
    def refine(self, blended: Tensor, opacities: Tensor, noise: Tensor) -> Images:
        """Refine splatted features with the inverse depth last [B, C + 1, H, W] to images."""
