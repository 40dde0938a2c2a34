"""Predictions that were made elsewhere."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from geovp_classic import files
from geovp_classic.data import frames, pose_files
from geovp_classic.errors import BadData
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    Motion,
    Prediction,
    PrivilegedInput,
    Trajectory,
)

VIDEO_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".webm")


@dataclass(frozen=True)
class Recorded:
    """Predictions made elsewhere, found by the clip's name.

    For a clip "03/000180", `path` holds one of: 03/000180.npz with `frames` (uint8 [F, H, W, 3], or
    [S, F, H, W, 3]) and optionally `covered` (bool, without the 3); a video 03/000180.mp4 (avi,
    mkv, mov, webm) of F frames; a folder 03/000180 of F images in the order of their names, or of S
    such folders. `poses` may hold 03/000180.txt, KITTI or TUM, with a pose for every past and
    future frame, in any world frame; whether in metres, `poses_are_metric` says.
    """

    path: Path
    poses: Path | None = None
    poses_are_metric: bool = True
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.NONE

    def __post_init__(self) -> None:
        for folder in filter(None, (self.path, self.poses)):
            if not folder.is_dir():
                raise BadData(
                    f"{folder} is not a folder: give the one that holds a prediction for every clip"
                )

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """The recorded frames; BadData names a file that is missing or has other sizes than the
        clip.
        """
        path = self._find(context.name)
        images, covered = _read_npz(path) if path.suffix == ".npz" else (_read_images(path), None)
        if images.ndim == 4:
            images, covered = images[None], None if covered is None else covered[None]
        samples = num_samples if len(images) > 1 else 1
        expected = (samples, context.num_future, *context.frames.shape[1:])
        if len(images) < samples or images.shape[1:] != expected[1:] or images.dtype != np.uint8:
            raise BadData(
                f"{path}: {images.dtype} frames of shape {images.shape}, expected uint8 of "
                f"{expected}"
            )
        if covered is not None and (covered.shape != images.shape[:4] or covered.dtype != bool):
            raise BadData(
                f"{path}: {covered.dtype} covered of {covered.shape}, expected bool of "
                f"{images.shape[:4]}"
            )
        motion = (
            None
            if self.poses is None
            else self._motion(self.poses / f"{context.name}.txt", context)
        )
        return Prediction(images[:samples], None if covered is None else covered[:samples], motion)

    def _find(self, name: str) -> Path:
        if not name:
            raise BadData(
                "a recorded prediction is found by the clip's name, and this clip has none"
            )
        candidates = [self.path / f"{name}{suffix}" for suffix in (".npz", *VIDEO_SUFFIXES, "")]
        found = [path for path in candidates if path.exists()]
        if not found:
            raise BadData(
                f"{self.path / name} is missing, as .npz, video or folder of images: predict "
                "this clip as well"
            )
        if len(found) > 1:
            raise BadData(
                f"{found[0]} and {found[1]} both hold predictions of clip {name}: keep one"
            )
        return found[0]

    def _motion(self, path: Path, context: Context) -> Motion:
        if not path.is_file():
            raise BadData(
                f"{path} is missing: give the poses of this clip as well, or leave poses out"
            )
        whole = pose_files.read_trajectory(path, context.times_s, is_metric=self.poses_are_metric)
        if len(whole) != len(context.times_s):
            raise BadData(
                f"{path}: {len(whole)} poses, expected {len(context.times_s)}, one per past and "
                "future frame"
            )
        num_past, poses = context.num_past, whole.world_from_cam
        past = Trajectory(poses[:num_past], context.times_s[:num_past], self.poses_are_metric)
        return Motion(past, poses[None, num_past:], np.ones(num_past, dtype=bool))


def _read_npz(path: Path) -> tuple[ByteArray, BoolArray | None]:
    """The arrays `frames` and, where there is one, `covered`."""
    arrays = files.read_npz(path)
    if "frames" not in arrays:
        raise BadData(
            f"{path} holds {', '.join(arrays) or 'nothing'}: expected an npz file with an array "
            "'frames'"
        )
    return arrays["frames"], arrays.get("covered")


def _read_images(path: Path) -> ByteArray:
    """Frames [F, H, W, 3] of a video or a folder of images, [S, F, H, W, 3] of a folder of such
    folders.
    """
    if path.is_file():
        video = frames.VideoFrames.open(path)
        return _stack(path, [video.read(index) for index in range(len(video))])
    samples = sorted(child for child in path.iterdir() if child.is_dir())
    if samples:
        return _stack(path, [_read_images(sample) for sample in samples])
    return _stack(path, [frames.read_image(image) for image in frames.image_files(path)])


def _stack(path: Path, images: list[ByteArray]) -> ByteArray:
    shapes = {image.shape for image in images}
    if len(shapes) != 1:
        message = " and ".join(map(str, sorted(shapes))) or "nothing"
        raise BadData(
            f"{path} holds {message}, expected images of one size, as many in every sample"
        )
    return np.stack(images)
