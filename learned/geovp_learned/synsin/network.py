"""SynSin's generator: features and inverse depths of one frame, splatted into other cameras and
refined to images.

One setting, `variant`, chooses between the networks of Wiles et al. 2020 (`published`) and ours
(`residual`), which differ from them in this:

- The first three features of a point are its colours, and the refinement network corrects the
  splatted colours instead
  of painting new ones: an untrained network already shows the frame, and with little training
  images are sharp that
  would be blurred otherwise. Holes are filled by pull-push before it, and it sees the opacity.
- The depth network also gets every pixel's ray and always sees `depth_px` rows, so that focal
  length and frame size do
  not matter; it has six levels, not eight, and no spectral normalisation.
- Points have a radius of 1 pixel and 8 of them count, instead of 4 of 256 and 128: about 16 times
  fewer pairs.
- The feature network has no noise; blocks have BigGAN's order, resampling before or after the
  convolutions.
- With `patch_px` = 2 the residual blocks work on 2x2 pixels, four times cheaper.
- The content loss compares SqueezeNet's features by LPIPS (3 MB), not VGG-19's (575 MB); `losses`
  has more of depth.

Trained alike for 2400 steps, they halve LPIPS together. Undone one at a time (`as_published`, and
other settings; 800 steps at 64x64, one seed, scored on `val`: see
docs/results/synsin-published.md), LPIPS of .191 rises by .099 [.028, .192] without the colour
shortcut, by .062 [.031, .093] without hole filling and by .085 [.026, .164] with points of 4 pixels
in 64; 2x2 pixels cost .016 [.004, .028]. Rays, opacity, 6 points for 32 and features without noise
make no sure difference. Eight levels of depth, spectral normalisation there, the order in blocks
and VGG-19 have not been measured apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Literal, NamedTuple, get_args

import torch
from torch import Tensor, nn
from torch.nn import functional

from geovp_classic.errors import BadData
from geovp_learned import methods
from geovp_learned.blocks import NoisyNorm, ResidualBlock, UNet, gather, spread
from geovp_learned.synsin import splatting
from geovp_learned.synsin.splatting import SOLID_FACTOR, Splatter, pull_push

Part = Literal["colours", "holes", "opacity", "rays", "noise"]

COLOURS = 3
NEAREST_M = 2.0  # the depth network's range is from here to infinity
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
    as_published: tuple[
        Part, ...
    ] = ()  # single parts as in the paper, to measure what each departure gains

    def __post_init__(self) -> None:
        fixed = [each.name for each in fields(self)][3:] if self.variant == "published" else []
        if others := [
            name for name in fixed if getattr(self, name) != getattr(Architecture, name, Splatter())
        ]:
            raise BadData(
                f"variant 'published' has its own {others[0]}: leave it out, or choose 'residual'"
            )
        if self.features <= COLOURS:
            raise BadData(f"features is {self.features}, expected more than the {COLOURS} colours")
        if not self.depth_channels or self.depth_px % 2 ** len(self.depth_channels):
            given = f"depth_px is {self.depth_px} with {len(self.depth_channels)} levels"
            raise BadData(f"{given}, expected a multiple of {2 ** len(self.depth_channels)}")
        if unknown := set(self.as_published) - set(get_args(Part)):
            raise BadData(
                f"as_published has {min(unknown)!r}, expected some of {', '.join(get_args(Part))}"
            )
        methods.check_counts(
            self, "width", "feature_blocks", "inner_blocks", "patch_px", "noise_size"
        )


class FeatureCloud(NamedTuple):
    """Feature points of frames, one per pixel, in their own cameras' frames."""

    rays: Tensor  # [B, N, 3], z = 1
    inverse_depths: Tensor  # [B, N] 1/m
    features: Tensor  # [B, N, C], the colours in [0, 1] first where there is a colour shortcut

    def repeated(self, times: int) -> FeatureCloud:
        """Repeat each cloud `times` times in a row."""
        return FeatureCloud(*(part.repeat_interleave(times, dim=0) for part in self))


class Images(NamedTuple):
    """Clouds rendered from new cameras."""

    frames: Tensor  # [B, 3, H, W] in [0, 1]; not clamped
    opacities: Tensor  # [B, 1, H, W]; 0 where there is no point
    inverse_depths: Tensor  # [B, 1, H, W] 1/m; 0 also where there is no point


class Generator(nn.Module):
    """SynSin without its discriminator."""

    def __init__(self, architecture: Architecture) -> None:
        """Build the model with new weights; untrained, it renders a cloud at INITIAL_M in its own
        colours.
        """
        super().__init__()
        self.architecture = architecture
        self.noise_size = architecture.noise_size  # how many numbers of noise a rendering takes
        self.feature_network: nn.Module = FeatureNetwork(architecture)
        self.depth_network: nn.Module = DepthNetwork(architecture)
        self.refinement_network: nn.Module = RefinementNetwork(architecture)

    def forward(
        self,
        frames: Tensor,  # [B, 3, H, W] in [0, 1]
        intrinsics: Tensor,  # [B, 4]: fx, fy, cx, cy in pixels
        cam_from_last: Tensor | None = None,  # [B, V, 4, 4], metres
        depth_share: float = 1.0,
    ) -> tuple[Images | None, Tensor]:
        """Render the images of V views each [B * V, ...], under random noise; return the frames'
        inverse depths [B, H, W], too.

        Without motion only the depths are computed. `depth_share` scales the images' gradient in
        the depth network.
        """
        size_px = (frames.shape[2], frames.shape[3])
        if cam_from_last is None:
            return None, self.depths(frames, splatting.rays(intrinsics, size_px))
        cloud = self.encode(frames, intrinsics)
        inverse_depths, views = cloud.inverse_depths, cam_from_last.shape[1]
        cloud = cloud._replace(
            inverse_depths=depth_share * inverse_depths
            + (1 - depth_share) * inverse_depths.detach()
        )
        noise = torch.randn(len(frames) * views, self.noise_size, device=frames.device)
        cameras = intrinsics.repeat_interleave(views, dim=0)
        images = self.render(
            cloud.repeated(views), cam_from_last.flatten(0, 1), cameras, size_px, noise
        )
        return images, inverse_depths.unflatten(1, size_px)

    def depths(self, frames: Tensor, rays: Tensor) -> Tensor:
        """Estimate inverse depths [B, H, W] of frames [B, 3, H, W] with rays [B, H * W, 3]."""
        return self.depth_network(frames, rays)

    def encode(
        self, frames: Tensor, intrinsics: Tensor, noise: Tensor | None = None
    ) -> FeatureCloud:
        """Encode frames [B, 3, H, W] of cameras [B, 4] as clouds; noise [B, noise_size] is used
        where the paper has it.
        """
        rays = splatting.rays(intrinsics, (frames.shape[2], frames.shape[3]))
        features = self.feature_network(frames, noise).float()
        if "colours" not in self.architecture.as_published:
            features = torch.cat([frames, features], dim=1)
        return FeatureCloud(
            rays, self.depths(frames, rays).flatten(1), features.flatten(2).transpose(1, 2)
        )

    def render(
        self,
        cloud: FeatureCloud,
        cam_from_last: Tensor,
        intrinsics: Tensor,
        size_px: tuple[int, int],
        noise: Tensor,
    ) -> Images:
        """Render clouds from poses [B, 4, 4] of cameras [B, 4], in images of (height, width)."""
        blended, opacities = self.splat(
            cloud, cam_from_last, intrinsics, size_px, self.architecture.splatter
        )
        with torch.autocast(cloud.rays.device.type, enabled=False):
            filled = pull_push(blended, opacities)
        features = (blended if "holes" in self.architecture.as_published else filled)[:, :-1]
        solid = (
            torch.zeros_like(opacities)
            if "opacity" in self.architecture.as_published
            else SOLID_FACTOR * opacities
        )
        maps = torch.cat([features, solid.clamp(max=1)], dim=1)
        return Images(self.refinement_network(maps, noise).float(), opacities, filled[:, -1:])

    @staticmethod
    def splat(
        cloud: FeatureCloud,
        cam_from_last: Tensor,
        intrinsics: Tensor,
        size_px: tuple[int, int],
        splatter: Splatter,
    ) -> tuple[Tensor, Tensor]:
        """Return blended features with the inverse depth last [B, C + 1, H, W], and opacities [B,
        1, H, W].
        """
        with torch.autocast(cloud.rays.device.type, enabled=False):
            positions, inverse_depths, visible = splatting.project(
                cloud.rays, cloud.inverse_depths, cam_from_last, intrinsics
            )
            points = torch.cat([cloud.features, inverse_depths[..., None]], dim=2)
            return splatter(positions, inverse_depths, visible, points, size_px)


class DepthNetwork(nn.Module):
    """A U-Net from colours and rays to inverse depths in (0, 1 / NEAREST_M]; computed in full
    precision.
    """

    def __init__(self, architecture: Architecture) -> None:
        """Build the network with new weights; untrained, it predicts about INITIAL_M everywhere."""
        super().__init__()
        self.rows = architecture.depth_px
        self.multiple = 2 ** len(architecture.depth_channels)
        self.sees_rays = "rays" not in architecture.as_published
        self.unet = UNet(COLOURS + 2, architecture.depth_channels, 1)
        share = NEAREST_M / INITIAL_M
        nn.init.normal_(self.unet.head.weight, std=1e-3)
        self.unet.head.bias = nn.Parameter(torch.logit(torch.tensor([share])))

    def forward(self, frames: Tensor, rays: Tensor) -> Tensor:
        """Estimate inverse depths [B, H, W] of frames [B, 3, H, W] with rays [B, H * W, 3]."""
        height, width = frames.shape[2:]
        with torch.autocast(frames.device.type, enabled=False):
            directions = self.sees_rays * rays[..., :2].transpose(1, 2).unflatten(
                2, (height, width)
            )
            columns = max(round(width / height * self.rows / self.multiple), 1) * self.multiple
            seen = functional.interpolate(
                torch.cat([frames - 0.5, directions], dim=1),
                (self.rows, columns),
                mode="bilinear",
                antialias=True,
            )
            raw = functional.interpolate(self.unet(seen), (height, width), mode="bilinear")
        return torch.sigmoid(raw[:, 0]) / NEAREST_M


class FeatureNetwork(nn.Module):
    """Residual blocks from colours to the other features of a point."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.patch_px, width = architecture.patch_px, architecture.width
        self.noise_size = architecture.noise_size if "noise" in architecture.as_published else 0
        self.stem = nn.Conv2d(COLOURS * architecture.patch_px**2, width, 3, padding=1)
        blocks = (
            ResidualBlock(width, width, self.noise_size) for _ in range(architecture.feature_blocks)
        )
        self.blocks = nn.ModuleList(blocks)
        self.norm = NoisyNorm(width, self.noise_size)
        given = 0 if "colours" in architecture.as_published else COLOURS
        self.head = nn.Conv2d(width, architecture.features - given, 1)

    def forward(self, frames: Tensor, noise: Tensor | None = None) -> Tensor:
        """Return features [B, C, H, W], without the colours, of frames [B, 3, H, W]; noise is drawn
        if none is given.
        """
        if noise is None or not self.noise_size:
            noise = torch.randn(len(frames), self.noise_size, device=frames.device)
        maps = self.stem(gather(frames - 0.5, self.patch_px, 1))
        for block in self.blocks:
            maps = block(maps, noise)
        return spread(
            self.head(functional.relu(self.norm(maps, noise))), self.patch_px, frames.shape[2:]
        )


class RefinementNetwork(nn.Module):
    """Residual blocks with noise, down two levels and up again, that correct splatted colours and
    inpaint holes.
    """

    def __init__(self, architecture: Architecture) -> None:
        """Build the network with new weights; untrained, it leaves the colours unchanged, or paints
        all grey.
        """
        super().__init__()
        self.patch_px, self.corrects = (
            architecture.patch_px,
            "colours" not in architecture.as_published,
        )
        width, noise, seen = architecture.width, architecture.noise_size, architecture.features + 1
        self.stem = nn.Conv2d(seen * architecture.patch_px**2, width, 3, padding=1)
        down = (
            ResidualBlock(width, width, noise, "down"),
            ResidualBlock(width, 2 * width, noise, "down"),
        )
        inner = [
            ResidualBlock(2 * width, 2 * width, noise) for _ in range(architecture.inner_blocks)
        ]
        up = (
            ResidualBlock(2 * width, width, noise, "up"),
            ResidualBlock(width, width, noise, "up"),
        )
        self.blocks = nn.ModuleList([*down, *inner, *up])
        self.norm = NoisyNorm(width, noise)
        self.detail = nn.Conv2d(width + seen, width // 2, 3, padding=1)
        self.head = nn.Conv2d(width // 2, COLOURS, 3, padding=1)
        for parameter in self.head.parameters():
            nn.init.zeros_(parameter)

    def forward(self, maps: Tensor, noise: Tensor) -> Tensor:
        """Decode splatted features and their opacity [B, C + 1, H, W] to frames [B, 3, H, W]."""
        finest = inner = self.stem(gather(maps, self.patch_px, 4))
        for block in self.blocks:
            inner = block(inner, noise)
        painted = spread(
            functional.relu(self.norm(inner + finest, noise)), self.patch_px, maps.shape[2:]
        )
        detail = self.detail(torch.cat([maps, painted], dim=1))
        change = self.head(
            functional.leaky_relu(detail, 0.2)
        )  # a ReLU without a norm before it can die
        return maps[:, :COLOURS] + change if self.corrects else (torch.tanh(change) + 1) / 2
