"""DeepVO as a component: the whole motion from the images alone, or the past of it as an odometry."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, ByteArray, Context, FloatArray, Grant, Intrinsics, Motion, Trajectory
from learned import checkpoints
from learned.deepvo.network import Architecture, PoseNetwork
from learned.deepvo.steps import motions
from learned.deepvo.train import DeepVoTraining
from learned.tensors import images_from_frames, retaken, shrunk


@dataclass(frozen=True)
class DeepVo:
    """Past and future poses from the observed frames, by a trained network; one sample, in metres.

    The world is the first observed camera. A network with a 2D head says nothing about height, pitch and roll: they
    stay those of the first camera. A step is what lay between two frames in training (KITTI: 0.1 s); times are not
    looked at. `checkpoint` is a weights file of `train deepvo`; without one, the weights that come with the package.
    `fingerprint` says which weights these are; given, others are refused.
    """

    checkpoint: Path | None = None
    fingerprint: str = ""

    def __post_init__(self) -> None:
        """Raise BadData unless the checkpoint is whole and the one that is asked for."""
        object.__setattr__(self, "fingerprint", _checked(self.checkpoint, self.fingerprint))

    @property
    def needs(self) -> Grant:
        """Nothing but the frames."""
        return Grant.NONE

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The motion; Incompatible for fewer than two frames, BadData for a checkpoint that cannot be used."""
        past_from_next, future_from_next = _steps(self, context, context.num_future)
        past = _trajectory(past_from_next, context.times_s[: context.num_past])
        futures = past.world_from_cam[-1] @ _chained(future_from_next)
        return Motion(past, futures[None], np.ones(len(past), dtype=bool))


@dataclass(frozen=True)
class DeepVoOdometry:
    """The past alone, for forecasters other than DeepVO's own decoder."""

    checkpoint: Path | None = None
    fingerprint: str = ""

    def __post_init__(self) -> None:
        """As DeepVo's."""
        object.__setattr__(self, "fingerprint", _checked(self.checkpoint, self.fingerprint))

    @property
    def needs(self) -> Grant:
        """Nothing but the frames."""
        return Grant.NONE

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The past trajectory, every step tracked; errors as `DeepVo.estimate`."""
        past_from_next, _ = _steps(self, context, 1)
        past = _trajectory(past_from_next, context.times_s[: context.num_past])
        return past, np.ones(len(past), dtype=bool)

    def track_sequence(
        self, frames: Iterable[ByteArray], times_s: FloatArray, intrinsics: Intrinsics, camera_height_m: float | None
    ) -> tuple[Trajectory, BoolArray]:
        """A whole sequence, frame by frame; its length comes from training alone, not from the camera's height."""
        network = load(self.checkpoint or shipped(), self.fingerprint)
        images = torch.cat([taken([frame], intrinsics, network.architecture) for frame in frames])
        past = _trajectory(_motions(network, images, 1)[0], times_s)
        return past, np.ones(len(past), dtype=bool)


def shipped() -> Path:
    """The weights file that comes with the package."""
    return Path(str(resources.files("learned").joinpath("weights", "deepvo.safetensors")))


@functools.lru_cache(maxsize=4)
def load(file: Path, fingerprint: str) -> PoseNetwork:
    """The network of a weights file, once per process; BadData when it cannot be used.

    The fingerprint is only there to tell another file of the same name.
    """
    checkpoint = checkpoints.read(file, "deepvo", DeepVoTraining)
    network = PoseNetwork(checkpoint.settings.architecture)
    checkpoints.restore(file, network, checkpoint, "poses")
    return network.eval()


def taken(frames: Sequence[ByteArray], camera: Intrinsics, architecture: Architecture) -> Tensor:
    """Frames [P, 3, H, W] as the network's own camera would have taken them."""
    smaller, camera = shrunk(frames, camera, architecture.camera)
    return images_from_frames(np.stack([retaken(frame, camera, architecture.camera) for frame in smaller]))


def _checked(checkpoint: Path | None, wanted: str) -> str:
    """The fingerprint of a weights file that can be loaded."""
    file = checkpoint or shipped()
    found = checkpoints.fingerprint(file, wanted)
    load(file, found)
    return found


def _steps(component: DeepVo | DeepVoOdometry, context: Context, num_future: int) -> tuple[FloatArray, FloatArray]:
    """Motions from each camera to the next, within the past [P - 1, 4, 4] and after it [F, 4, 4]."""
    network = load(component.checkpoint or shipped(), component.fingerprint)
    return _motions(network, taken(list(context.frames), context.intrinsics, network.architecture), num_future)


@torch.inference_mode()
def _motions(network: PoseNetwork, images: Tensor, num_future: int) -> tuple[FloatArray, FloatArray]:
    if len(images) < 2:
        raise Incompatible("deepvo compares pairs of frames, the past has but one: give num_past of 2 or more")
    past, future = network(images[None], num_future)
    head = network.architecture.head
    return motions(past[0].double(), head).numpy(), motions(future[0].double(), head).numpy()


def _trajectory(past_from_next: FloatArray, times_s: FloatArray) -> Trajectory:
    world_from_cam = np.concatenate([np.eye(4)[None], _chained(past_from_next)])
    return Trajectory(world_from_cam, times_s.copy(), is_metric=True)


def _chained(relative: FloatArray) -> FloatArray:
    """Poses [N, 4, 4] in the first camera's frame, kept orthonormal over long videos (eq. 3.4)."""
    poses: list[FloatArray] = []
    now: FloatArray = np.eye(4)
    for motion in relative:
        now = se3.orthonormalised(now @ motion)
        poses.append(now)
    return np.stack(poses)
