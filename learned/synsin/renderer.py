"""SynSin as a renderer: the last frame becomes a cloud of features once, and is seen from anywhere by splatting."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, ByteArray, Context, FloatArray, Grant, Intrinsics, Trajectory, Views
from learned import checkpoints
from learned.synsin import pairs
from learned.synsin.network import Cloud, Generator
from learned.synsin.train import SynSinTraining
from learned.tensors import images_from_frames

OPAQUE = 0.1  # a pixel that points cover less than this was invented


@dataclass(frozen=True)
class SynSin:
    """One frame to new views by learned depth, splatted features and a refinement network (Wiles et al. 2020).

    `checkpoint` is a weights file of `python -m learned train synsin`; without one, the weights that come with the
    package. Frames may have any size. `seed` draws the refinement network's noise, the same for all views.
    `fingerprint` says which weights these are; given, others are refused.
    """

    checkpoint: Path | None = None
    device: str = "cpu"
    seed: int = 0
    fingerprint: str = ""

    def __post_init__(self) -> None:
        """Raise BadData unless the checkpoint is there, the one that is asked for, and the device exists."""
        found = checkpoints.fingerprint(self.checkpoint or shipped(), self.fingerprint)
        object.__setattr__(self, "fingerprint", found)
        load(self.checkpoint or shipped(), found, self.device)

    @property
    def needs(self) -> Grant:
        """Nothing but the last frame."""
        return Grant.NONE

    def reconstruct(self, context: Context, past: Trajectory) -> FeatureScene:
        """The last frame as a cloud; Incompatible when the poses are not metric, as those that it learned from were."""
        if not past.is_metric:
            raise Incompatible("synsin's depth is in metres, the poses are not: give the odometry a scale")
        generator = load(self.checkpoint or shipped(), self.fingerprint, self.device)
        with torch.inference_mode():
            frame = images_from_frames(context.frames[-1:]).to(self.device)
            cloud = generator.encode(frame, pairs.intrinsics_tensor(context.intrinsics).to(self.device))
        return FeatureScene(generator, cloud, past.world_from_cam[-1], self.seed)


@dataclass(frozen=True)
class FeatureScene:
    """A cloud of features in the last camera's frame."""

    generator: Generator
    cloud: Cloud  # of one frame
    world_from_last: FloatArray  # [4, 4]
    seed: int

    def view(self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """The cloud from the poses [F, 4, 4]; covered where points fell, elsewhere the network's invention."""
        cam_from_last = torch.from_numpy(se3.inverse(world_from_cam) @ self.world_from_last).float()
        parts = [self._view(one, intrinsics) for one in cam_from_last.split(1)]  # more at once change the last bits
        return Views(*(np.concatenate(maps) for maps in zip(*parts, strict=True)))

    @torch.inference_mode()
    def _view(self, cam_from_last: Tensor, intrinsics: Intrinsics) -> tuple[ByteArray, BoolArray, FloatArray]:
        """Frames [F, H, W, 3], coverage [F, H, W] and depths [F, H, W] of a few views."""
        device, views = self.cloud.rays.device, len(cam_from_last)
        noise = torch.randn(
            1, self.generator.architecture.noise_size, generator=torch.Generator().manual_seed(self.seed)
        )
        cameras = pairs.intrinsics_tensor(intrinsics).to(device).expand(views, -1)
        size_px = (intrinsics.height_px, intrinsics.width_px)
        images = self.generator.render(
            self.cloud.repeated(views), cam_from_last.to(device), cameras, size_px, noise.to(device).expand(views, -1)
        )
        frames = (images.frames.clamp(0, 1) * 255).round().byte().permute(0, 2, 3, 1)
        covered = images.opacities[:, 0] > OPAQUE
        depths = torch.where(covered, 1 / images.inverse_depths[:, 0], 0.0)  # 1 / 0 is the sky
        return frames.cpu().numpy(), covered.cpu().numpy(), depths.cpu().numpy()


def shipped() -> Path:
    """The weights file that comes with the package."""
    return Path(str(resources.files("learned").joinpath("weights", "synsin.safetensors")))


@functools.lru_cache(maxsize=2)
def load(file: Path, fingerprint: str, device: str) -> Generator:
    """The generator of a weights file, once per process; BadData when the file or the device cannot be used.

    The fingerprint is only there to tell another file of the same name.
    """
    checkpoint = checkpoints.read(file, "synsin", SynSinTraining)
    generator = Generator(checkpoint.settings.architecture)
    checkpoints.restore(file, generator, checkpoint, "generator")
    try:
        return generator.eval().to(device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise BadData(
            f"device {device!r} cannot be used ({reason}): give 'cpu', or 'cuda' where there is a GPU"
        ) from error
