"""Training examples for SynSin: a frame of a clip, later frames, and the camera motion between
them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from geovp_classic.geometry import se3
from geovp_classic.types import Clip, Intrinsics
from geovp_learned import tensors
from geovp_learned.methods import Batch
from geovp_learned.tensors import MIRROR, images_from_frames


@dataclass(frozen=True)
class Example:
    """A frame of a clip from which later ones are to be predicted."""

    clip: Clip
    last: int


def examples(clips: Iterable[Clip], max_horizon: int) -> list[Example]:
    """Return all frames that have `max_horizon` frames after them; raise BadData if a clip has no
    metric poses.
    """
    frames = []
    for clip in clips:
        tensors.metric_trajectory(clip)
        frames += [Example(clip, last) for last in range(len(clip) - max_horizon)]
    return frames


def frame_pairs(
    example: Example, horizons: Sequence[int], *, mirrored: bool = False, in_grey: bool = False
) -> Batch:
    """Return tensors of the frame of an example and of the frames `horizons` steps later."""
    clip, last = example.clip, example.last
    steps = [last, *(last + horizon for horizon in horizons)]
    poses = tensors.metric_trajectory(clip).world_from_cam[steps]
    motions, camera = se3.inverse(poses[1:]) @ poses[0], clip.intrinsics
    frames = tensors.grey(clip.frames[steps]) if in_grey else clip.frames[steps]
    depth = np.zeros(frames.shape[1:3]) if clip.depths is None else clip.depths[last]
    with np.errstate(divide="ignore"):
        inverse_depth = np.where(depth > 0, 1 / depth, np.nan)
    if mirrored:
        frames, inverse_depth = frames[:, :, ::-1], inverse_depth[:, ::-1]
        motions = MIRROR @ motions @ MIRROR
        camera = replace(camera, cx_px=camera.width_px - 1 - camera.cx_px)
    images = images_from_frames(frames)
    return {
        "frames": images[0],  # [3, H, W] in [0, 1]
        "targets": images[1:],  # [V, 3, H, W]
        "cam_from_last": torch.from_numpy(motions).float(),  # [V, 4, 4], metres
        "intrinsics": intrinsics_tensor(camera)[0],
        # [H, W] 1/m of the frame; NaN where it is not known
        "inverse_depths": torch.from_numpy(inverse_depth.copy()).float(),
    }


def intrinsics_tensor(camera: Intrinsics) -> torch.Tensor:
    """Return fx, fy, cx, cy in pixels [1, 4]."""
    return torch.tensor(
        [[camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]], dtype=torch.float32
    )
