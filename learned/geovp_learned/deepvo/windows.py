"""Training windows for DeepVO: clips resized for the network's camera, and their augmentation."""

from dataclasses import dataclass

import numpy as np
import torch

from geovp_classic.geometry import se3
from geovp_classic.types import Clip, Intrinsics
from geovp_learned import tensors
from geovp_learned.methods import Batch
from geovp_learned.stored_clips import Arrays, Window, camera_array, camera_of
from geovp_learned.tensors import MIRROR


@dataclass(frozen=True)
class Augmentation:
    """Random changes of a window; shares are probabilities.

    A turn rotates the camera itself at a constant rate, which needs no depth. Since cars do not
    look sideways while driving straight, the future of such windows is not learnt from.
    """

    mirror_probability: float = 0.5
    fast_probability: float = 0.25  # every other frame: twice the speed
    turn_probability: float = 0.5
    turn_deg: float = 3.0  # per step, at most
    grey_probability: float = 0.5
    gamma: float = 0.3  # exponent of brightness, e^(-gamma) to e^gamma


NO_AUGMENTATION = Augmentation(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def prepare(clip: Clip, camera: Intrinsics) -> Arrays:
    """Return the clip for a network with this camera, with the uncropped frames where it has them.

    Raises BadData if there are no metric poses.
    """
    trajectory = tensors.metric_trajectory(clip)
    source = clip if clip.full is None else clip.full
    pairs = [tensors.shrink(frame, source.intrinsics, camera) for frame in source.frames]
    frames, cameras = zip(*pairs, strict=True)
    return {
        "frames": np.stack(frames),
        "world_from_cam": trajectory.world_from_cam,
        "camera": camera_array(cameras[0]),
    }


def sample(
    window: Window,
    camera: Intrinsics,
    num_past: int,
    num_future: int,
    augmentation: Augmentation,
    rng: np.random.Generator,
) -> Batch:
    """Draw an augmented window: "images" [P, 3, H, W] bytes, "motions" [P + F - 1, 4, 4], and
    "is_known" [P + F - 1], 1 where a motion is learnt from and 0 elsewhere.
    """
    probabilities = (
        augmentation.mirror_probability,
        augmentation.fast_probability,
        augmentation.turn_probability,
        augmentation.grey_probability,
    )
    mirrored, fast, turning, grey = rng.random(4) < probabilities
    rate_rad = np.deg2rad(rng.uniform(-1, 1) * augmentation.turn_deg) * turning
    gamma = np.exp(rng.uniform(-1, 1) * augmentation.gamma)
    clip, source = window.clip, camera_of(window.clip["camera"])
    frames, last = clip["frames"], len(clip["frames"]) - 1
    stride = 2 if fast and window.first + 2 * (num_past - 1) <= last else 1
    steps = window.first + stride * np.arange(num_past + num_future)
    is_known = steps[1:] <= last
    if turning:
        is_known[num_past - 1 :] = False
    # no rotation at the middle of the window, so that its images stay within the wide frame
    yaws_rad = rate_rad * (np.arange(len(steps)) - (num_past - 1) / 2)
    cam_from_turned = se3.exp(np.outer(yaws_rad, [0, 0, 0, 0, 1, 0]))
    mirror = MIRROR if mirrored else np.eye(4)
    images = []
    for step, rotation in zip(steps[:num_past], cam_from_turned @ mirror, strict=False):
        image = tensors.reproject(frames[step], source, camera, rotation[:3, :3])
        images.append(tensors.grey(image) if grey else image)
    gamma_table = np.round(255 * (np.arange(256) / 255) ** gamma).astype(np.uint8)
    world_from_cam = clip["world_from_cam"][np.minimum(steps, last)] @ cam_from_turned
    relative = se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:]
    return {
        "images": tensors.bytes_from_frames(gamma_table[np.stack(images)]),
        "motions": torch.from_numpy(mirror @ relative @ mirror).float(),
        "is_known": torch.from_numpy(is_known).float(),
    }
