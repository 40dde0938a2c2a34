"""DeepVO as a pose source (past and future), and as an odometry (the past alone)."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from geovp_classic.errors import Incompatible
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    Trajectory,
)
from geovp_learned import checkpoints, devices
from geovp_learned.deepvo.network import chained, motions
from geovp_learned.tensors import images_from_frames, seen_by


@dataclass(frozen=True)
class _PretrainedDeepVo(checkpoints.Pretrained):
    method: ClassVar[str] = "deepvo"

    @property
    def input_note(self) -> str:
        """Describe the size of the network's camera, and the frames it looks at."""
        camera = self.load()[1].architecture.camera
        return f"works at {camera.width_px}x{camera.height_px} on all observed frames"

    @torch.inference_mode()
    def poses(
        self, frames: Iterable[ByteArray], camera: Intrinsics, times_s: FloatArray
    ) -> tuple[Trajectory, FloatArray]:
        """Estimate the past, in the first camera's frame, and the poses [F, 4, 4] at the later ones
        of the times [P + F].
        """
        network, settings = self.load()
        wanted, head = settings.architecture.camera, settings.architecture.head
        images = [images_from_frames(seen_by(frame, camera, wanted)) for frame in frames]
        num_past = len(images)
        if num_past < 2:
            raise Incompatible(
                "deepvo compares pairs of frames, the past has but one: give num_past of 2 or more"
            )
        with devices.one_thread():
            steps = network(
                torch.stack(images)[None].to(self.device), max(len(times_s) - num_past, 1)
            )
        past, future = (chained(motions(step[0].double().cpu(), head)).numpy() for step in steps)
        world_from_cam = np.concatenate([np.eye(4)[None], past])
        trajectory = Trajectory(world_from_cam, times_s[:num_past].copy(), is_metric=True)
        return trajectory, world_from_cam[-1] @ future


@dataclass(frozen=True)
class DeepVo(_PretrainedDeepVo):
    """Past and future poses from the observed frames, by a trained network; one sample, in metres.

    The world is the first observed camera. A network with a 2D head keeps height, pitch and roll of
    the first camera. Every step has the duration of the training data's (KITTI: 0.1 s); times are
    not used.
    """

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Estimate the motion; raise Incompatible for fewer than two frames."""
        past, futures = self.poses(context.frames, context.intrinsics, context.times_s)
        return Motion(past, futures[None], np.ones(len(past), dtype=bool))


class DeepVoSmall(DeepVo):
    """DeepVO with a quarter of the channels and short training; settings of `DeepVo`."""

    shipped = "deepvo-small"


@dataclass(frozen=True)
class DeepVoOdometry(_PretrainedDeepVo):
    """The past alone, for other forecasters than DeepVO's own decoder."""

    def track(self, context: Context) -> tuple[Trajectory, BoolArray]:
        """Estimate the past trajectory, with all steps tracked; errors as `DeepVo.estimate`."""
        times_s = context.times_s[: context.num_past]
        return self.track_sequence(context.frames, times_s, context.intrinsics, None)

    def track_sequence(
        self,
        frames: Iterable[ByteArray],
        times_s: FloatArray,
        intrinsics: Intrinsics,
        camera_height_m: float | None,
    ) -> tuple[Trajectory, BoolArray]:
        """Track a whole sequence, read frame by frame; the scale was learnt, so the camera's height
        is not used.
        """
        past, _ = self.poses(frames, intrinsics, times_s)
        return past, np.ones(len(past), dtype=bool)


class DeepVoSmallOdometry(DeepVoOdometry):
    """The past alone, by the small network; settings of `DeepVo`."""

    shipped = "deepvo-small"
