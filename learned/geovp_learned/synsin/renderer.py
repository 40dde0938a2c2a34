"""SynSin as a renderer: the last frame becomes a cloud of feature points, which every view splats
and refines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    Trajectory,
    Views,
)
from geovp_learned import checkpoints, devices
from geovp_learned.synsin.generator import FeatureCloud, Generator, Images
from geovp_learned.synsin.network import NOISE_SIZE
from geovp_learned.synsin.pairs import intrinsics_tensor
from geovp_learned.tensors import frames_from_images, images_from_frames

MIN_OPACITY = 0.1  # of covered pixels
VIEWS_AT_ONCE = 20  # on a GPU; on a CPU each thread renders one


@dataclass(frozen=True)
class SynSin(checkpoints.Pretrained):
    """New views of one frame by learned depth, splatted features and a refinement network (Wiles et
    al. 2020).

    Frames may have any size. `seed` draws the noise of the networks, the same for all views.
    """

    seed: int = 0

    method: ClassVar[str] = "synsin"

    @property
    def input_note(self) -> str:
        """Describe the size of the frame that the network sees."""
        focal_px = self.load()[1].architecture.focal_px
        size = f"resized to a focal length of {focal_px} px" if focal_px else "at its own size"
        return f"works on the last frame, {size}"

    def reconstruct(self, context: Context, past: Trajectory) -> FeatureScene:
        """Build the cloud of the last frame; raise Incompatible if the poses are not metric, as
        those in training were.
        """
        if not past.is_metric:
            raise Incompatible(
                "synsin's depth is in metres, the poses are not: give the odometry a scale"
            )
        generator, settings = self.load()
        focal_px = settings.architecture.focal_px
        camera = network_camera(context.intrinsics, focal_px)
        frame = pinhole.resize(context.frames[-1], (camera.width_px, camera.height_px))
        inputs = (
            images_from_frames(frame[None]),
            intrinsics_tensor(camera),
            self._noise(),
        )
        with torch.inference_mode(), devices.one_thread():
            cloud = generator.encode(*(tensor.to(self.device) for tensor in inputs))
        noise = self._noise().to(self.device)
        return FeatureScene(generator, cloud, noise, past.world_from_cam[-1], focal_px)

    def _noise(self) -> Tensor:
        return torch.randn(1, NOISE_SIZE, generator=torch.Generator().manual_seed(self.seed))


class SynSinSmall(SynSin):
    """SynSin with a quarter of the channels and short training; settings of `SynSin`."""

    shipped = "synsin-small"


@dataclass(frozen=True)
class FeatureScene:
    """A cloud of features in the last camera's frame."""

    generator: Generator
    cloud: FeatureCloud  # of one frame
    noise: Tensor  # [1, N], the same for all views
    world_from_last: FloatArray  # [4, 4]
    focal_px: float  # of the network's images; 0 = any

    def view(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> Views:
        """Render the cloud from the poses [F, 4, 4]; pixels are covered where points project, and
        inpainted by the network elsewhere.
        """
        cam_from_last = torch.from_numpy(se3.inverse(world_from_cam) @ self.world_from_last).float()
        size = 1 if self.noise.device.type == "cpu" else VIEWS_AT_ONCE
        views = devices.on_one_thread_each(
            lambda poses: self.rendered(poses, intrinsics), cam_from_last.split(size)
        )
        return Views(*(np.concatenate(arrays) for arrays in zip(*views, strict=True)))

    @torch.inference_mode()
    def rendered(
        self, cam_from_last: Tensor, intrinsics: Intrinsics
    ) -> tuple[ByteArray, BoolArray, FloatArray]:
        """Render frames [B, H, W, 3], coverage and depths [B, H, W] from poses [B, 4, 4]."""
        count = len(cam_from_last)
        camera = network_camera(intrinsics, self.focal_px)
        images = self.generator.render(
            self.cloud.repeated(count),
            cam_from_last.to(self.noise.device),
            intrinsics_tensor(camera).to(self.noise.device).expand(count, -1),
            (camera.height_px, camera.width_px),
            self.noise.expand(count, -1),
        )
        if camera != intrinsics:
            size_px = (intrinsics.height_px, intrinsics.width_px)
            images = Images(
                *(functional.interpolate(maps, size_px, mode="area") for maps in images)
            )
        covered = images.opacities[:, 0] > MIN_OPACITY
        depths = torch.where(covered, 1 / images.inverse_depths[:, 0], 0.0)  # 1 / 0 is the sky
        return frames_from_images(images.frames), covered.cpu().numpy(), depths.cpu().numpy()


def network_camera(intrinsics: Intrinsics, focal_px: float) -> Intrinsics:
    """Return the camera whose images have the focal length that a network knows; 0 = any."""
    if not focal_px:
        return intrinsics
    scale = focal_px / intrinsics.fx_px
    width_px, height_px = (
        max(round(side * scale), 1) for side in (intrinsics.width_px, intrinsics.height_px)
    )
    return intrinsics.resized(width_px, height_px)
