"""SynSin's generator: features and inverse depths of one frame, splatted into other cameras and
refined to images (Wiles et al. 2020).

Lengths outside are metres; the networks know units of `Architecture.unit_m`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from geovp_learned.synsin import splatting
from geovp_learned.synsin.network import (
    ENCODER,
    NOISE_SIZE,
    REFINEMENT,
    RESAMPLED,
    SAME_SIZE,
    Architecture,
    Blocks,
    DepthNetwork,
    channels_of,
)
from geovp_learned.synsin.splatting import Splatter

DISC_RADIUS_RATIO = 4 / 256  # --radius: radius of a point in heights of the image
POINTS_PER_PIXEL = 128  # --pp_pixel
MIN_SQUARED_DISTANCE = 1e-3  # z_buffer_layers.py: opacities are .968 at most
MIN_OPACITY = 1e-6  # of a pixel whose inverse depth is averaged
NEAR = 0.01  # EPS of z_buffer_manipulator.py, in units


class FeatureCloud(NamedTuple):
    """Feature points of frames, one per pixel, in their own cameras' frames."""

    rays: Tensor  # [B, N, 3], z = 1
    inverse_depths: Tensor  # [B, N] 1/m
    features: Tensor  # [B, N, C]

    def repeated(self, times: int) -> FeatureCloud:
        """Repeat each cloud `times` times in a row."""
        return FeatureCloud(*(tensor.repeat_interleave(times, dim=0) for tensor in self))


class Images(NamedTuple):
    """Clouds rendered from new cameras."""

    frames: Tensor  # [B, 3, H, W] in [0, 1]; not clamped
    opacities: Tensor  # [B, 1, H, W]; 0 where there is no point
    inverse_depths: Tensor  # [B, 1, H, W] 1/m; 0 also where there is no point


class Generator(nn.Module):
    """SynSin without its discriminator."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        width, features = architecture.width, architecture.features
        self.near_m = NEAR * architecture.unit_m
        self.feature_network = Blocks([*channels_of(3, ENCODER, width), features], SAME_SIZE)
        self.depth_network = DepthNetwork(architecture)
        self.refinement_network = Blocks([*channels_of(features, REFINEMENT, width), 3], RESAMPLED)

    def forward(
        self,
        frames: Tensor,  # [B, 3, H, W] in [0, 1]
        intrinsics: Tensor,  # [B, 4]: fx, fy, cx, cy in pixels
        cam_from_last: Tensor,  # [B, V, 4, 4], metres
    ) -> Images:
        """Render the images of V views each [B * V, ...], under random noise."""
        views = cam_from_last.shape[1]
        noise = torch.randn(len(frames), NOISE_SIZE, device=frames.device)
        cloud = self.encode(frames, intrinsics, noise)
        noise = torch.randn(len(frames) * views, NOISE_SIZE, device=frames.device)
        return self.render(
            cloud.repeated(views),
            cam_from_last.flatten(0, 1),
            intrinsics.repeat_interleave(views, dim=0),
            frames.shape[2:],
            noise,
        )

    def encode(self, frames: Tensor, intrinsics: Tensor, noise: Tensor) -> FeatureCloud:
        """Encode frames [B, 3, H, W] of cameras [B, 4] as clouds, with noise [B, NOISE_SIZE]."""
        features = self.feature_network(2 * frames - 1, noise).float()
        return FeatureCloud(
            self.rays(intrinsics, frames.shape[2:]),
            self.depth_network(frames).flatten(1),
            features.flatten(2).transpose(1, 2),
        )

    def render(
        self,
        cloud: FeatureCloud,
        cam_from_last: Tensor,
        intrinsics: Tensor,
        size_px: Sequence[int],
        noise: Tensor,
    ) -> Images:
        """Render clouds from poses [B, 4, 4] of cameras [B, 4], in images of (height, width), with
        noise [B, NOISE_SIZE].
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
        """Return the directions of pixels on the authors' grid, which puts the centres of the
        outermost ones on the edges of the image.

        Under no motion, points are splatted up to half a pixel beside their pixels.
        """
        height, width = size_px
        stretch = intrinsics.new_tensor([width / max(width - 1, 1), height / max(height - 1, 1)])
        focal_px, centre_px = intrinsics.chunk(2, dim=1)
        grid = torch.cat([focal_px / stretch, (centre_px + 0.5) / stretch], dim=1)
        return splatting.rays(grid, size_px)

    def splatter(self, height_px: int) -> Splatter:
        """Return the paper's splatting of 256x256 images, at the same scale in others."""
        radius_px = DISC_RADIUS_RATIO * height_px
        return Splatter(radius_px, POINTS_PER_PIXEL, MIN_SQUARED_DISTANCE**0.5)

    def refine(self, blended: Tensor, opacities: Tensor, noise: Tensor) -> Images:
        """Refine splatted features with the inverse depth last [B, C + 1, H, W] to images; features
        of holes are 0.
        """
        height, width = blended.shape[2:]
        padding = (0, -width % 4, 0, -height % 4)  # the network halves the size twice
        features = functional.pad(blended[:, :-1], padding, mode="replicate")
        painted = torch.tanh(self.refinement_network(features, noise).float())
        frames = painted[:, :, :height, :width]
        inverse_depths = blended[:, -1:] / opacities.clamp(min=MIN_OPACITY)
        return Images((frames + 1) / 2, opacities, inverse_depths)
