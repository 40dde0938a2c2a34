"""Training examples for SynSin: a frame of a clip, later frames, and the camera motion between
them.
"""

from collections.abc import Sequence

import torch

from geovp_classic.geometry import se3
from geovp_classic.types import Clip, Intrinsics
from geovp_learned import tensors
from geovp_learned.methods import Batch
from geovp_learned.stored_clips import Arrays, Window, camera_array
from geovp_learned.tensors import MIRROR, images_from_frames


def prepare(clip: Clip) -> Arrays:
    """Return what pairs need of a clip; raise BadData if it has no metric poses."""
    return {
        "frames": clip.frames,
        "world_from_cam": tensors.metric_trajectory(clip).world_from_cam,
        "camera": camera_array(clip.intrinsics),
    }


def frame_pairs(
    example: Window, horizons: Sequence[int], *, mirrored: bool = False, in_grey: bool = False
) -> Batch:
    """Return tensors of the first frame of a window and of the frames `horizons` steps later."""
    clip, last = example.clip, example.first
    steps = [last, *(last + horizon for horizon in horizons)]
    poses = clip["world_from_cam"][steps]
    motions = se3.inverse(poses[1:]) @ poses[0]
    fx_px, fy_px, cx_px, cy_px, width_px, _ = clip["camera"]
    frames = tensors.grey(clip["frames"][steps]) if in_grey else clip["frames"][steps]
    if mirrored:
        frames = frames[:, :, ::-1]
        motions = MIRROR @ motions @ MIRROR
        cx_px = width_px - 1 - cx_px
    images = images_from_frames(frames)
    return {
        "frames": images[0],  # [3, H, W] in [0, 1]
        "targets": images[1:],  # [V, 3, H, W]
        "cam_from_last": torch.from_numpy(motions).float(),  # [V, 4, 4], metres
        "intrinsics": torch.tensor([fx_px, fy_px, cx_px, cy_px]).float(),
    }


def intrinsics_tensor(camera: Intrinsics) -> torch.Tensor:
    """Return fx, fy, cx, cy in pixels [1, 4]."""
    return torch.from_numpy(camera_array(camera)[None, :4]).float()
