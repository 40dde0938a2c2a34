"""DeepVO as a pose source (past and future), and as an odometry (the past alone)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, ByteArray, Context, FloatArray, Intrinsics, Motion, Trajectory
from learned import checkpoints
from learned.deepvo.network import Architecture, PoseNetwork
from learned.deepvo.steps import motions
from learned.tensors import images_from_frames, reproject, shrink


@dataclass(frozen=True)
class _PretrainedDeepVo(checkpoints.Pretrained):
    method: ClassVar[str] = "deepvo"

    @property
    def network(self) -> PoseNetwork:
        """The trained network."""
        network, _ = self.load()
        assert isinstance(network, PoseNetwork)
        return network

    def relative_motions(self, context: Context, num_future: int) -> tuple[FloatArray, FloatArray]:
        """Motions from each camera to the next, within the past [P - 1, 4, 4] and after it [F, 4, 4]."""
        images = network_images(list(context.frames), context.intrinsics, self.network.architecture)
        return self.motions_of_images(images, num_future)

    @torch.inference_mode()
    def motions_of_images(self, images: Tensor, num_future: int) -> tuple[FloatArray, FloatArray]:
        """The same of images [P, 3, H, W]."""
        if len(images) < 2:
            raise Incompatible("deepvo compares pairs of frames, the past has but one: give num_past of 2 or more")
        network = self.network
        past, future = network(images[None].to(self.device), num_future)
        head = network.architecture.head
        return motions(past[0].double().cpu(), head).numpy(), motions(future[0].double().cpu(), head).numpy()


@dataclass(frozen=True)
class DeepVo(_PretrainedDeepVo):
    """Past and future poses from the observed frames, by a trained network; one sample, in metres.

    The world is the first observed camera. A network with a 2D head keeps height, pitch and roll of the first camera.
    Every step has the duration of the training data's (KITTI: 0.1 s); times are not used.
    """

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The motion; Incompatible for fewer than two frames."""
        past_from_next, future_from_next = self.relative_motions(context, context.num_future)
        past = _trajectory(past_from_next, context.times_s[: context.num_past])
        futures = past.world_from_cam[-1] @ _chained(future_from_next)
        return Motion(past, futures[None], np.ones(len(past), dtype=bool))


@dataclass(frozen=True)
class DeepVoOdometry(_PretrainedDeepVo):
    """The past alone, for other forecasters than DeepVO's own decoder."""

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """The past trajectory, every step tracked; errors as `DeepVo.estimate`."""
        past = _trajectory(self.relative_motions(context, 1)[0], context.times_s[: context.num_past])
        return past, np.ones(len(past), dtype=bool)

    def track_sequence(
        self, frames: Iterable[ByteArray], times_s: FloatArray, intrinsics: Intrinsics, camera_height_m: float | None
    ) -> tuple[Trajectory, BoolArray]:
        """A whole sequence, read frame by frame; the scale was learnt, so the camera's height is not used."""
        architecture = self.network.architecture
        images = torch.cat([network_images([frame], intrinsics, architecture) for frame in frames])
        past = _trajectory(self.motions_of_images(images, 1)[0], times_s)
        return past, np.ones(len(past), dtype=bool)


def network_images(frames: Sequence[ByteArray], camera: Intrinsics, architecture: Architecture) -> Tensor:
    """Images [P, 3, H, W] in [0, 1] of frames [H, W, 3] as the network's own camera would have taken them."""
    resized, camera = shrink(frames, camera, architecture.camera)
    return images_from_frames(np.stack([reproject(frame, camera, architecture.camera) for frame in resized]))


def _trajectory(past_from_next: FloatArray, times_s: FloatArray) -> Trajectory:
    world_from_cam = np.concatenate([np.eye(4)[None], _chained(past_from_next)])
    return Trajectory(world_from_cam, times_s.copy(), is_metric=True)


def _chained(relative: FloatArray) -> FloatArray:
    """Poses [N, 4, 4] in the first camera's frame, kept orthonormal over long videos (eq. 3.4)."""
    poses: list[FloatArray] = [np.eye(4)]
    for motion in relative:
        poses.append(se3.orthonormalised(poses[-1] @ motion))
    return np.stack(poses[1:])
