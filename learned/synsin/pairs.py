"""What SynSin learns from: a frame of a clip, and frames up to some steps later, with the motion between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, Clip, FloatArray, Intrinsics
from learned.methods import Batch
from learned.tensors import images_from_frames

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Example:
    """A frame of a clip from which later ones are to be predicted."""

    clip: Clip
    last: int


@dataclass(frozen=True)
class Scene:
    """One frame and some later ones, as arrays."""

    frame: ByteArray  # [H, W, 3]
    targets: ByteArray  # [V, H, W, 3]
    cam_from_last: FloatArray  # [V, 4, 4], metres
    intrinsics: Intrinsics
    inverse_depth: FloatArray  # [H, W] 1/m of the frame; NaN where it is not known

    def mirrored(self) -> Scene:
        """Left and right exchanged, motion included."""
        camera = self.intrinsics
        flipped = Intrinsics(
            camera.fx_px,
            camera.fy_px,
            camera.width_px - 1 - camera.cx_px,
            camera.cy_px,
            camera.width_px,
            camera.height_px,
        )
        motion = MIRROR @ self.cam_from_last @ MIRROR
        return Scene(self.frame[:, ::-1], self.targets[:, :, ::-1], motion, flipped, self.inverse_depth[:, ::-1])

    def grey(self) -> Scene:
        """Without colours."""
        frame, *targets = (_without_colour(image) for image in (self.frame, *self.targets))
        return Scene(frame, np.stack(targets), self.cam_from_last, self.intrinsics, self.inverse_depth)


def check(clip: Clip) -> None:
    """BadData unless SynSin can learn from the clip."""
    if clip.trajectory is None or not clip.trajectory.is_metric:
        raise BadData(f"{clip.name} has no metric poses, which synsin learns from: leave its sequence out")


def examples(clips: Iterable[Clip], max_horizon: int) -> list[Example]:
    """Every frame that has `max_horizon` frames after it; BadData when a clip is too short or has no metric poses."""
    found = []
    for clip in clips:
        check(clip)
        if len(clip) <= max_horizon:
            raise BadData(
                f"{clip.name} has {len(clip)} frames, but horizons up to {max_horizon} need more: raise num_frames"
            )
        found += [Example(clip, last) for last in range(len(clip) - max_horizon)]
    return found


def scene(example: Example, horizons: Iterable[int]) -> Scene:
    """The frame of an example and those `horizons` steps later."""
    clip, last = example.clip, example.last
    steps = [last + horizon for horizon in horizons]
    assert clip.trajectory is not None
    poses = clip.trajectory.world_from_cam
    inverse_depth = np.full(clip.frames.shape[1:3], np.nan)
    if clip.depths is not None:
        depth = clip.depths[last]
        inverse_depth = np.where(depth > 0, 1 / np.where(depth > 0, depth, 1), np.nan)
    return Scene(
        clip.frames[last], clip.frames[steps], se3.inverse(poses[steps]) @ poses[last], clip.intrinsics, inverse_depth
    )


def augmented(one: Scene, rng: np.random.Generator, grey_share: float) -> Scene:
    """Mirrored half of the time, grey in a share of all."""
    if rng.random() < 0.5:
        one = one.mirrored()
    return one.grey() if rng.random() < grey_share else one


def batch(scenes: Sequence[Scene]) -> Batch:
    """Tensors of scenes of one size."""
    return {
        "frames": images_from_frames(np.stack([one.frame for one in scenes])),  # [B, 3, H, W]
        "targets": images_from_frames(np.concatenate([one.targets for one in scenes])),  # [B * V, 3, H, W]
        "cam_from_last": torch.from_numpy(np.stack([one.cam_from_last for one in scenes])).float(),  # [B, V, 4, 4]
        "intrinsics": torch.cat([intrinsics_tensor(one.intrinsics) for one in scenes]),  # [B, 4]
        "inverse_depths": torch.from_numpy(np.stack([one.inverse_depth for one in scenes])).float(),  # [B, H, W]
    }


def intrinsics_tensor(camera: Intrinsics) -> torch.Tensor:
    """fx, fy, cx, cy in pixels [1, 4]."""
    return torch.tensor([[camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]], dtype=torch.float32)


def _without_colour(image: ByteArray) -> ByteArray:
    grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    return np.repeat(np.asarray(grey, dtype=np.uint8)[..., None], 3, axis=2)
