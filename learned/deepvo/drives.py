"""What DeepVO learns from: windows of drives, as the network's own camera sees them, and the motion in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch

from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, ByteArray, Clip, FloatArray, Intrinsics
from learned.methods import Batch
from learned.tensors import retaken, shrunk

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Drive:
    """A clip at the network's resolution; the whole width of the image where the clip has it."""

    frames: tuple[ByteArray, ...]  # T of [h, w, 3]
    camera: Intrinsics
    world_from_cam: FloatArray  # [T, 4, 4], metres


@dataclass(frozen=True)
class Window:
    """Frames from `first` on."""

    drive: Drive
    first: int


@dataclass(frozen=True)
class Augmentation:
    """How drives are varied; shares are probabilities, each drawn once a window.

    A turn swings the camera itself at a constant rate, which needs no depth. It would teach the decoder that cars drive
    one way and look another, so the future of such windows is not learnt from.
    """

    mirror_share: float = 0.5
    fast_share: float = 0.25  # every other frame: twice the speed
    turn_share: float = 0.5
    turn_deg: float = 3.0  # per step, at most
    grey_share: float = 0.5
    gamma: float = 0.3  # exponent of brightness, e^(-gamma) to e^gamma

    def __post_init__(self) -> None:
        """Raise BadData for shares that are none."""
        for name in ("mirror_share", "fast_share", "turn_share", "grey_share"):
            if not 0 <= getattr(self, name) <= 1:
                raise BadData(f"augmentation.{name} is {getattr(self, name)}, expected 0 to 1")


NOTHING = Augmentation(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def read(clip: Clip, camera: Intrinsics) -> Drive:
    """The clip for a network that has this camera; BadData when there are no metric poses."""
    if clip.trajectory is None or not clip.trajectory.is_metric:
        raise BadData(f"{clip.name} has no metric poses, which deepvo learns from: leave its sequence out")
    source, intrinsics = (clip.frames, clip.intrinsics)
    if clip.wide is not None:
        source, intrinsics = clip.wide.frames, clip.wide.intrinsics
    frames, taken_by = shrunk(list(source), intrinsics, camera)
    return Drive(tuple(frames), taken_by, clip.trajectory.world_from_cam)


def windows(drives: Iterable[Drive], num_frames: int, stride: int = 1) -> list[Window]:
    """Every `stride`-th run of `num_frames` frames."""
    return [Window(drive, first) for drive in drives for first in range(0, len(drive.frames) - num_frames + 1, stride)]


def batch(
    chosen: Sequence[Window],
    camera: Intrinsics,
    num_past: int,
    num_future: int,
    augmentation: Augmentation,
    rng: np.random.Generator,
) -> Batch:
    """Tensors of windows: "images" [B, P, 3, H, W] bytes, "motions" [B, P + F - 1, 4, 4], and "known", 1 where a
    motion is to be learnt from and 0 elsewhere [B, P + F - 1].
    """
    rows = [sample(window, camera, num_past, num_future, augmentation, rng) for window in chosen]
    images, relative, known = (np.stack(column) for column in zip(*rows, strict=True))
    return {
        "images": torch.from_numpy(np.ascontiguousarray(np.moveaxis(images, -1, -3))),
        "motions": torch.from_numpy(relative.astype(np.float32)),
        "known": torch.from_numpy(known.astype(np.float32)),
    }


def sample(
    window: Window,
    camera: Intrinsics,
    num_past: int,
    num_future: int,
    augmentation: Augmentation,
    rng: np.random.Generator,
) -> tuple[ByteArray, FloatArray, BoolArray]:
    """Images [P, H, W, 3], motions [P + F - 1, 4, 4] and which of them are known [P + F - 1], augmented by draws."""
    mirrored, fast, turning, grey = rng.random(4) < (
        augmentation.mirror_share,
        augmentation.fast_share,
        augmentation.turn_share,
        augmentation.grey_share,
    )
    rate_rad = np.deg2rad(rng.uniform(-1, 1) * augmentation.turn_deg) * turning
    gamma = np.exp(rng.uniform(-1, 1) * augmentation.gamma)
    drive, last = window.drive, len(window.drive.frames) - 1
    pace = 2 if fast and window.first + 2 * (num_past - 1) <= last else 1
    steps = window.first + pace * np.arange(num_past + num_future)
    known = steps[1:] <= last
    if turning:
        known[num_past - 1 :] = False
    # the swing is centred on the window, so that its images stay within the wide frame
    cam_from_swung = turned(rate_rad * (np.arange(len(steps)) - (num_past - 1) / 2))
    table = np.round(255 * (np.arange(256) / 255) ** gamma).astype(np.uint8)
    images = []
    for index, step in enumerate(steps[:num_past]):
        image = retaken(
            drive.frames[step], drive.camera, camera, cam_from_swung[index, :3, :3], mirrored=bool(mirrored)
        )
        images.append(_shown(image, table, bool(grey)))
    world_from_cam = drive.world_from_cam[np.minimum(steps, last)] @ cam_from_swung
    relative = se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:]
    return np.stack(images), MIRROR @ relative @ MIRROR if mirrored else relative, known


def turned(yaw_rad: FloatArray) -> FloatArray:
    """Rotations [..., 4, 4] about y, to the right."""
    zero = np.zeros_like(yaw_rad)
    return se3.exp(np.stack([zero, zero, zero, zero, yaw_rad, zero], axis=-1))


def _shown(image: ByteArray, table: ByteArray, grey: bool) -> ByteArray:
    if grey:
        image = np.repeat(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    return np.asarray(cv2.LUT(image, table), dtype=np.uint8)
