"""Predictions that were recorded in files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geovp_classic import files
from geovp_classic.data.formats import pose_files
from geovp_classic.data.frames import image_frames, image_names, video_frames
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, Context, Motion, Prediction, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class RecordedPredictions:
    """Predictions of other software, stored by the name of the clip.

    For a clip "03/000180", `path` holds 03/000180.npz with `frames` (uint8 [F, H, W, 3], or
    [S, F, H, W, 3]) and optionally `covered` (bool, without the 3), a folder 03/000180 of F images
    in the order of their names, or a video 03/000180.mp4 of F frames. `poses` may hold
    03/000180.txt, in the format of KITTI or TUM, with a pose for each past and future frame in any
    world frame; `poses_are_metric` states whether in metres.
    """

    path: Path
    poses: Path | None = None
    poses_are_metric: bool = True
    needs = PrivilegedInput.NONE

    def __post_init__(self) -> None:
        for folder in filter(None, (self.path, self.poses)):
            if not folder.is_dir():
                raise BadData(f"{folder} is not a folder: give the one with a file for each clip")

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Read the recorded frames; raise BadData if they are missing or do not fit the clip."""
        path = self._find(context.name)
        covered = None
        if path.suffix == ".npz":
            arrays = files.read_npz(path)
            images = arrays.get("frames", np.empty(0))
            covered = arrays.get("covered")
        elif path.suffix == ".mp4":
            video = video_frames.VideoFrames(path)
            images = np.stack([video.read(number) for number in range(len(video))])
        else:
            images = _read_images(path)
        if images.ndim == 4:
            images = images[None]
            covered = None if covered is None else covered[None]
        samples = slice(num_samples if len(images) > 1 else 1)
        expected = (samples.stop, context.num_future, *context.frames.shape[1:])
        if images[samples].shape != expected:
            raise BadData(f"{path}: frames of shape {images.shape}, expected {expected}")
        covered = None if covered is None else covered[samples]
        motion = self._motion(context)
        try:
            return Prediction(images[samples], covered, motion)
        except BadData as error:
            raise BadData(f"{path}: {error}") from error

    def _find(self, name: str) -> Path:
        candidates = [self.path / f"{name}{ending}" for ending in (".npz", ".mp4", "")]
        paths = list(filter(Path.exists, candidates))
        if not name or len(paths) != 1:
            raise BadData(
                f"{self.path} has {len(paths)} predictions of clip {name!r}, expected one .npz, "
                f".mp4 or folder of images at {self.path / name}"
            )
        return paths[0]

    def _motion(self, context: Context) -> Motion | None:
        if self.poses is None:
            return None
        path = self.poses / f"{context.name}.txt"
        times_s = context.times_s
        recorded = pose_files.read_trajectory(path, times_s, is_metric=self.poses_are_metric)
        num_past = context.num_past
        poses = recorded.world_from_cam
        past = Trajectory(poses[:num_past], times_s[:num_past], self.poses_are_metric)
        return Motion(past, poses[None, num_past:], np.ones(num_past, bool))


def _read_images(folder: Path) -> ByteArray:
    """Read frames [F, H, W, 3] of a folder."""
    paths = image_names.image_files(folder)
    expected = "expected one or more images of one size"
    with files.checked(f"{folder} holds {len(paths)} images", expected):
        return np.stack([image_frames.read_image(path) for path in paths])
