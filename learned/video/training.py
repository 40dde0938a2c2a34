"""Training as SVG, SRVP and SLAMP share it; a method adds its networks' shape and its losses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from lightning.fabric import is_wrapped
from torch import Tensor, nn
from torch.optim import Adam, Optimizer

from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, Clip
from learned.methods import Batch, Losses, Networks
from learned.video import windows

VALIDATION_BATCH = 8
NEAR_STEPS = 5


@runtime_checkable
class VideoNetwork(Protocol):
    """What a video predictor's network can do besides learning."""

    @property
    def size_px(self) -> int:
        """The side of its square images."""
        ...

    @property
    def noise_size(self) -> int:
        """How many normal numbers decide over one step."""
        ...

    def predict(self, observed: Tensor, noise: Tensor) -> Tensor:
        """Futures [N, F, 3, H, W] of observed images [N, P, 3, H, W], or [1, P, 3, H, W] for all alike.

        `noise` [N, F, noise_size] is all that futures of one past differ by.
        """
        ...


@dataclass(frozen=True)
class VideoTraining(ABC):
    """Settings of training that have nothing to do with the method."""

    num_past: int = 10
    num_future: int = 10
    window_stride: int = 1
    validation_stride: int = 5
    grey_share: float = 0.3  # of windows shown without colours
    rate: float = 1e-3

    def __post_init__(self) -> None:
        """Raise BadData for windows that cannot be."""
        for name in ("num_future", "window_stride", "validation_stride"):
            if getattr(self, name) < 1:
                raise BadData(f"{name} is {getattr(self, name)}, expected 1 or more")
        if self.num_past < 2:
            raise BadData(f"num_past is {self.num_past}, expected 2 or more: one frame shows no motion")

    @property
    def kept(self) -> tuple[str, ...]:
        """All there is."""
        return ("video",)

    @property
    @abstractmethod
    def size_px(self) -> int:
        """The side of the network's square images."""

    @abstractmethod
    def build(self) -> dict[str, nn.Module]:
        """The fresh network, under the name "video"."""

    @abstractmethod
    def losses(self, network: nn.Module, images: Tensor) -> Losses:
        """Of images [B, T, 3, H, W] in [0, 1]; "total" among them."""

    def optimisers(self, networks: Networks) -> dict[str, Optimizer]:
        """Adam, as in all three papers."""
        return {"video": Adam(networks["video"].parameters(), self.rate)}

    def examples(self, clips: Iterable[Clip], *, training: bool) -> Sequence[ByteArray]:
        """Windows of num_past + num_future frames."""
        stride = self.window_stride if training else self.validation_stride
        return windows.windows(clips, self.size_px, self.num_past + self.num_future, stride)

    def batch(self, examples: Sequence[ByteArray], indices: Sequence[int], rng: np.random.Generator) -> Batch:
        """The chosen windows, half of them mirrored, some grey."""
        return windows.batch([examples[index] for index in indices], rng, self.grey_share)

    def training_step(self, networks: Networks, batch: Batch, step: int) -> Iterator[tuple[str, Losses]]:
        """The one network's one turn."""
        yield "video", self.losses(networks["video"], batch["images"].float() / 255.0)

    def validate(self, networks: Networks, examples: Sequence[ByteArray]) -> dict[str, float]:
        """PSNR in dB of one sample and of the last frame repeated, at the network's size; the score is minus the first.

        `near` is over the first steps, the other over all; `spread` is how much samples differ, in grey levels.
        """
        network = bare(networks["video"])
        random = torch.Generator().manual_seed(0)
        rows = []
        for start in range(0, len(examples), VALIDATION_BATCH):
            images = windows.stacked(examples[start : start + VALIDATION_BATCH]).float() / 255.0
            rows.append(self._measured(network, images.to(next(networks["video"].parameters()).device), random))
        psnr, copied, spread = (torch.cat(column) for column in zip(*rows, strict=True))
        return {
            "score": -float(psnr.mean()),
            "psnr": float(psnr.mean()),
            "psnr_near": float(psnr[:, :NEAR_STEPS].mean()),
            "copy_last": float(copied.mean()),
            "copy_last_near": float(copied[:, :NEAR_STEPS].mean()),
            "spread": float(spread.mean()),
        }

    def _measured(
        self, network: VideoNetwork, images: Tensor, random: torch.Generator
    ) -> tuple[Tensor, Tensor, Tensor]:
        """PSNR of a sample [B, F], of the last frame [B, F], and how much two samples differ [B, F]."""
        observed, future = images[:, : self.num_past], images[:, self.num_past :]
        shape = (len(images), future.shape[1], network.noise_size)
        made, other = (
            network.predict(observed, torch.randn(shape, generator=random).to(images.device)) for _ in range(2)
        )
        apart = (made - other).abs().mean((-3, -2, -1)) * 255
        return psnr_db(made, future), psnr_db(observed[:, -1:].expand_as(future), future), apart


def psnr_db(made: Tensor, real: Tensor) -> Tensor:
    """Of images [..., 3, H, W] in [0, 1]."""
    return -10 * torch.log10(((made - real) ** 2).mean((-3, -2, -1)).clamp(min=1e-8))


def bare(network: nn.Module) -> VideoNetwork:
    """The network itself, without a device's wrapping."""
    own = network.module if is_wrapped(network) else network
    assert isinstance(own, VideoNetwork)
    return own
