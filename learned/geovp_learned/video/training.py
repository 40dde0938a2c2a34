"""What training SVG, SRVP and SLAMP has in common; a method adds its network and its losses."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim import Adam, Optimizer

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.types import ByteArray, Clip
from geovp_learned.methods import Batch, Losses, Networks
from geovp_learned.stored_clips import Arrays, Window, windows
from geovp_learned.tensors import bytes_from_frames, grey, psnr_db
from geovp_learned.video.autoencoder import AutoencoderConfig


class VideoNetwork(nn.Module):
    """A stochastic video predictor; its images are [..., C, H, W] in [0, 1].

    `predict` gives futures [N, F, C, H, W] of images [N, P, C, H, W]; futures of the same past
    differ by the noise [N, P + F, noise_size] alone.
    """

    def __init__(self, noise_size: int) -> None:
        """Build the network; `noise_size` normal numbers decide on one frame, observed or not."""
        super().__init__()
        self.noise_size = noise_size


@dataclass(frozen=True)
class VideoArchitecture:
    """Sizes of the networks of a method; a subclass adds its own."""

    coding: AutoencoderConfig = field(default_factory=AutoencoderConfig)

    @property
    def size_px(self) -> tuple[int, int]:
        """Return height and width of the images."""
        return self.coding.size_px, self.coding.size_px


@dataclass(frozen=True)
class VideoTraining(ABC):
    """The training settings that all three methods have."""

    architecture: VideoArchitecture
    num_past: int = 10
    num_future: int = 10
    window_stride: int = 1
    validation_stride: int = 5
    mirror_probability: float = 0.5
    grey_probability: float = 0.0  # probability that a window is shown without colours
    rate: float = 3e-4

    network: ClassVar[Any]  # the class of the network, built from the architecture

    def __post_init__(self) -> None:
        if self.num_past < 2:
            raise BadData(
                f"num_past is {self.num_past}, expected 2 or more: one frame shows no motion"
            )

    @abstractmethod
    def losses(self, network: nn.Module, images: Tensor, step: int = 0) -> Losses:
        """Return loss terms of images [B, T, C, H, W] in [0, 1]; "total" is minimised."""

    def build(self) -> dict[str, nn.Module]:
        """Build a new network under the name "video"."""
        return {"video": self.network(self.architecture)}

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        """Build Adam, as in all three papers."""
        return {"video": Adam(networks["video"].parameters(), self.rate)}

    def prepare(self, clip: Clip) -> Arrays:
        """Return the frames, resized; the uncropped ones where there are any."""
        height_px, width_px = self.architecture.size_px
        shown = clip if clip.full is None else clip.full
        return {"frames": resize(shown.frames, width_px, height_px)}

    def examples(self, clips: Sequence[Arrays], *, training: bool) -> Sequence[Window]:
        """Cut windows of num_past + num_future frames."""
        stride = self.window_stride if training else self.validation_stride
        return windows(clips, self.num_past + self.num_future, stride)

    def example(self, item: Window, rng: np.random.Generator) -> Batch:
        """Return a window as "images" [T, 3, H, W] of bytes: some mirrored, some grey."""
        frames = self._frames(item)
        if rng.random() < self.mirror_probability:
            frames = frames[:, :, ::-1]
        if rng.random() < self.grey_probability:
            frames = grey(frames)
        return {"images": bytes_from_frames(frames)}

    def training_step(self, networks: Networks, batch: Batch, step: int) -> dict[str, Losses]:
        """Return the losses of the only network."""
        images = self._images(batch)
        return {"video": self.losses(networks["video"], images, step)}

    def validation_example(self, item: Window) -> Batch:
        """Return a window as it is."""
        return {"images": bytes_from_frames(self._frames(item))}

    def _frames(self, item: Window) -> ByteArray:
        """Return the frames [T, H, W, 3] of a window."""
        return item.clip["frames"][item.first :][: self.num_past + self.num_future]

    def validation_step(self, networks: Networks, batch: Batch) -> Losses:
        """Return the mean PSNR (dB) of one sample and of the last frame repeated, at the network's
        size; the score is -psnr.
        """
        network: Any = networks["video"]
        images = self._images(batch)
        observed, future = images[:, : self.num_past], images[:, self.num_past :]
        noise = torch.randn(*images.shape[:2], network.noise_size).to(images.device)
        psnr = psnr_db(network.predict(observed, noise), future).mean()
        copied = psnr_db(observed[:, -1:].expand_as(future), future)
        return {"score": -psnr, "psnr": psnr, "copy_last": copied.mean()}

    def _images(self, batch: Batch) -> Tensor:
        """Return images [B, T, C, H, W] in [0, 1], with as many colours as the network's."""
        images = batch["images"].float() / 255.0
        is_grey = self.architecture.coding.colours == 1
        return images.mean(dim=2, keepdim=True) if is_grey else images


def resize(frames: ByteArray, width_px: int, height_px: int) -> ByteArray:
    """Resize frames [T, H, W, 3]."""
    return np.stack([pinhole.resize(frame, (width_px, height_px)) for frame in frames])
