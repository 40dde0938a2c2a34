"""A predictor made of a plain torch network: images in, images out, without numpy, geometry or the
harness.
"""

import functools
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from geovp_classic import files
from geovp_classic.errors import BadData
from geovp_classic.types import Context, Prediction, PrivilegedInput
from geovp_learned import checkpoints, devices
from geovp_learned.tensors import frames_from_images, images_from_frames


@dataclass(frozen=True)
class TorchPredictor(ABC):
    """Subclass it, with your own settings as fields, and return your network from `network`.

    The network maps images [B, P, 3, H, W] in [0, 1] to the images after them [B, N, 3, H, W], for
    any N. It is shown the last `num_past` images (0: all); when more than N are asked for, it goes
    on from its own. A sample depends on `seed` and its own number alone. `checkpoint` is a state
    dict, as safetensors or as `torch.save` writes it (nothing in it is executed), and `fingerprint`
    identifies it in results. `device` is as in `devices`.
    """

    checkpoint: Path | None = None
    fingerprint: str = ""
    num_past: int = 0
    seed: int = 0
    device: str = "cpu"
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.NONE

    def __post_init__(self) -> None:
        checkpoints.identify(self, self.checkpoint)

    @abstractmethod
    def network(self) -> nn.Module:
        """Build a new network; its weights are read from the checkpoint afterwards."""

    @torch.inference_mode()
    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Predict frames [S, F, H, W, 3]; raise BadData if the network returns images of another
        shape.
        """
        past = images_from_frames(context.frames[-self.num_past :])[None].to(self.device)
        samples = []
        for sample in range(num_samples):
            with torch.random.fork_rng(), devices.one_thread():
                devices.seed_torch(self.seed, sample)
                images = _rollout(_loaded(self), past, context.num_future)
            samples.append(frames_from_images(images[0]))
        return Prediction(np.stack(samples))


@functools.lru_cache(maxsize=4)
def _loaded(predictor: TorchPredictor) -> nn.Module:
    """Return the network of a predictor, ready to predict, once per process."""
    network = predictor.network()
    if (file := predictor.checkpoint) is not None:
        checkpoints.restore(file, network, _state_dict(file), "")
    return network.eval().to(predictor.device)


def _state_dict(file: Path) -> dict[str, Tensor]:
    if file.suffix == ".safetensors":
        return checkpoints.read_tensors(file)[1]
    advice = "save network.state_dict() with torch.save"
    with files.checked(f"{file} is not a state dict", advice):
        return dict(torch.load(file, map_location="cpu", weights_only=True))


def _rollout(network: nn.Module, past: Tensor, num_future: int) -> Tensor:
    """Predict the images [1, F, 3, H, W] after the past [1, P, 3, H, W]."""
    images, num_past = past, past.shape[1]
    while images.shape[1] < num_past + num_future:
        new = network(images[:, -num_past:])
        if new[:, :1].shape != past[:, :1].shape:
            raise BadData(
                f"{type(network).__name__} maps images {list(past.shape)} to {list(new.shape)}, "
                "expected the same size: fix its forward"
            )
        images = torch.cat([images, new.clamp(0, 1)], dim=1)
    return images[:, num_past : num_past + num_future]
