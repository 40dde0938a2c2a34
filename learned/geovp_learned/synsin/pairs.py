"""Training examples for SynSin: a frame of a clip, later frames, and the camera motion between
them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, Clip, FloatArray, Intrinsics
from geovp_learned import tensors
from geovp_learned.methods import Batch
from geovp_learned.tensors import MIRROR, images_from_frames


@dataclass(frozen=True)
class Example:
    """A frame of a clip from which later ones are to be predicted."""

    clip: Clip
    last: int


@dataclass(frozen=True)
class FramePairs:
    """One frame and some later ones."""

    frames: ByteArray  # [1 + V, H, W, 3]
    cam_from_last: FloatArray  # [V, 4, 4], metres
    intrinsics: Intrinsics
    inverse_depth: FloatArray  # [H, W] 1/m of the frame; NaN where it is not known

    def mirrored(self) -> FramePairs:
        """Exchange left and right, of the motion, too."""
        camera = self.intrinsics
        return FramePairs(
            self.frames[:, :, ::-1],
            MIRROR @ self.cam_from_last @ MIRROR,
            replace(camera, cx_px=camera.width_px - 1 - camera.cx_px),
            self.inverse_depth[:, ::-1],
        )

    def tensors(self) -> Batch:
        """Return the parts as tensors, images [..., 3, H, W] in [0, 1]."""
        images = images_from_frames(self.frames)
        return {
            "frames": images[0],
            "targets": images[1:],  # [V, 3, H, W]
            "cam_from_last": torch.from_numpy(self.cam_from_last).float(),
            "intrinsics": intrinsics_tensor(self.intrinsics)[0],
            "inverse_depths": torch.from_numpy(self.inverse_depth.copy()).float(),
        }


def examples(clips: Iterable[Clip], max_horizon: int) -> list[Example]:
    """Return all frames that have `max_horizon` frames after them; raise BadData if a clip is too
    short or has no metric poses.
    """
    frames = []
    for clip in clips:
        tensors.metric_trajectory(clip, "synsin")
        if len(clip) <= max_horizon:
            raise BadData(
                f"{clip.name} has {len(clip)} frames, but horizons up to {max_horizon} need "
                "more: raise num_frames"
            )
        frames += [Example(clip, last) for last in range(len(clip) - max_horizon)]
    return frames


def frame_pairs(example: Example, horizons: Iterable[int]) -> FramePairs:
    """Return the frame of an example and the frames `horizons` steps later."""
    clip, last = example.clip, example.last
    steps = [last + horizon for horizon in horizons]
    poses = tensors.metric_trajectory(clip, "synsin").world_from_cam
    inverse_depth = np.full(clip.frames.shape[1:3], np.nan)
    if clip.depths is not None:
        depth = clip.depths[last]
        with np.errstate(divide="ignore"):
            inverse_depth = np.where(depth > 0, 1 / depth, np.nan)
    return FramePairs(
        clip.frames[[last, *steps]],
        se3.inverse(poses[steps]) @ poses[last],
        clip.intrinsics,
        inverse_depth,
    )


def augmented(pairs: FramePairs, rng: np.random.Generator, grey_probability: float) -> FramePairs:
    """Mirror with probability 1/2, and remove the colours with probability `grey_probability`."""
    if rng.random() < 0.5:
        pairs = pairs.mirrored()
    if rng.random() < grey_probability:
        pairs = replace(pairs, frames=tensors.grey(pairs.frames))
    return pairs


def intrinsics_tensor(camera: Intrinsics) -> torch.Tensor:
    """Return fx, fy, cx, cy in pixels [1, 4]."""
    return torch.tensor(
        [[camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]], dtype=torch.float32
    )
