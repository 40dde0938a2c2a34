"""Sampled video prediction as a component: the clip at the network's size, samples a few at a time, and back."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.types import ByteArray, Context, Grant, Prediction
from learned import checkpoints, methods
from learned.video import windows
from learned.video.training import VideoNetwork, VideoTraining, bare

PIXELS_AT_ONCE = 10 * 64 * 64  # of frames that are made side by side


@dataclass(frozen=True)
class Trained:
    """A network ready to predict."""

    network: VideoNetwork
    num_past: int  # frames that it was shown in training


@dataclass(frozen=True)
class VideoPredictor:
    """Samples of a trained network's future frames, each drawn from the learned prior.

    `checkpoint` is a weights file of `python -m learned train`; without one, the weights that come with the package.
    Frames of any size are brought to the network's own square and back. It looks at the last of the observed ones, as
    many as it learned from: shown more it would count on from there (SVG, shown ten and not five, lost 1.3 dB).
    Chance depends on `seed`, the frames looked at and the sample's number alone: the first of a hundred samples are
    those of fewer, and no clip shares its chance with another. Samples are made `samples_at_once`, which only says
    how much memory is taken; when not given, ten by a network of 64x64 pixels and fewer by larger ones.
    `fingerprint` says which weights these are; given, others are refused.
    """

    checkpoint: Path | None = None
    device: str = "cpu"
    seed: int = 0
    samples_at_once: int | None = None
    fingerprint: str = ""

    method: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Raise BadData unless the checkpoint is there, the one that is asked for, and the device exists."""
        if self.samples_at_once is not None and self.samples_at_once < 1:
            raise BadData(f"samples_at_once is {self.samples_at_once}, expected 1 or more")
        found = checkpoints.fingerprint(self.file, self.fingerprint)
        object.__setattr__(self, "fingerprint", found)
        load(self.method, self.file, found, self.device)

    @property
    def needs(self) -> Grant:
        """Nothing but the frames."""
        return Grant.NONE

    @property
    def file(self) -> Path:
        """The weights file."""
        return self.checkpoint or shipped(self.method)

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Frames [S, F, H, W, 3]; Incompatible for fewer than two observed frames."""
        if context.num_past < 2:
            raise Incompatible(f"{self.method} goes by motion, the past has one frame: give num_past of 2 or more")
        trained = load(self.method, self.file, self.fingerprint, self.device)
        network, recent = trained.network, context.recent(trained.num_past)
        height_px, width_px = context.frames.shape[1:3]
        observed = windows.stacked([windows.resized(recent.frames, network.size_px, network.size_px)])
        observed = observed.to(self.device).float() / 255.0
        frames = np.empty((num_samples, context.num_future, height_px, width_px, 3), np.uint8)
        at_once = self.samples_at_once or max(1, PIXELS_AT_ONCE // network.size_px**2)
        for first in range(0, num_samples, at_once):
            samples = range(first, min(first + at_once, num_samples))
            noise = noise_of(recent, self.seed, samples, network.noise_size).to(self.device)
            with torch.inference_mode():
                made = network.predict(observed, noise)
            for sample, images in zip(samples, _bytes(made), strict=True):
                frames[sample] = windows.resized(images, width_px, height_px)
        return Prediction(frames)


def noise_of(context: Context, seed: int, samples: range, size: int) -> Tensor:
    """Normal numbers [len(samples), F, size], each sample's by itself."""
    clip = int.from_bytes(hashlib.sha256(context.frames.tobytes()).digest()[:8], "big")
    shape = (context.num_future, size)
    rows = [np.random.default_rng([seed, clip, sample]).standard_normal(shape, np.float32) for sample in samples]
    return torch.from_numpy(np.stack(rows))


def shipped(method: str) -> Path:
    """The weights file that comes with the package."""
    return Path(str(resources.files("learned").joinpath("weights", f"{method}.safetensors")))


@functools.lru_cache(maxsize=3)
def load(method: str, file: Path, fingerprint: str, device: str) -> Trained:
    """The network of a weights file, once per process; BadData when the file or the device cannot be used.

    The fingerprint is only there to tell another file of the same name.
    """
    kind = methods.load(method)
    checkpoint = checkpoints.read(file, method, kind)
    assert isinstance(checkpoint.settings, VideoTraining)
    network = checkpoint.settings.build()["video"]
    checkpoints.restore(file, network, checkpoint, "video")
    try:
        return Trained(bare(network.eval().to(device)), checkpoint.settings.num_past)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise BadData(
            f"device {device!r} cannot be used ({reason}): give 'cpu', or 'cuda' where there is a GPU"
        ) from error


def _bytes(images: Tensor) -> ByteArray:
    """Images [N, F, 3, H, W] in [0, 1] as frames [N, F, H, W, 3]."""
    frames: ByteArray = (images.clamp(0, 1) * 255).round().byte().movedim(-3, -1).cpu().numpy()
    return frames
