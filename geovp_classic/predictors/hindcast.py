"""Hindcasting: a scene must explain the past better than copies of the last frame do.

It is rendered from the poses of a few earlier frames and compared with those. This tests poses,
depths and masks at once, with observed frames alone.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geovp_classic.errors import BadData
from geovp_classic.geometry import pinhole
from geovp_classic.interfaces import Scene
from geovp_classic.observation import observations_of
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Context,
    FloatArray,
    Intrinsics,
    Trajectory,
    Views,
)


@dataclass(frozen=True)
class Hindcast:
    """Comparison of a scene with earlier frames and with copies of the last frame."""

    num_frames: int = 3  # evenly spaced among the usable ones before the last
    # of the views; a quarter of the pixels takes a quarter of the time
    scale: float = 0.5
    # Views are not reduced below it: at 64 px, errors of coarse scenes equal those of copies.
    min_width_px: int = 128
    # A scene with a larger one is replaced by the last frame.
    max_error_ratio: float = 0.95
    # Grey values; frames that change less do not test a scene.
    min_change: float = 3.0
    # Grey values, of a hindcast error that halves the confidence.
    error_at_half_confidence: float = 10.0

    def __post_init__(self) -> None:
        if self.num_frames < 1 or not 0 < self.scale <= 1:
            raise BadData(
                f"hindcast: num_frames {self.num_frames} and scale {self.scale}, expected at "
                "least one frame and a scale in (0, 1]"
            )

    def view_size(self, camera: Intrinsics) -> tuple[int, int]:
        """Return (width, height) of the rendered views in pixels."""
        min_scale = min(1.0, self.min_width_px / camera.width_px)
        scale = max(self.scale, min_scale)
        width_px = max(1, round(camera.width_px * scale))
        return width_px, max(1, round(camera.height_px * scale))

    def errors(self, scene: Scene, context: Context, past: Trajectory) -> tuple[float, float]:
        """Return the mean error of the scene and that of copies, in grey values.

        The context was observed. Only covered pixels are compared; the scene's error is infinite
        if there are none, and 0 without earlier frames.
        """
        earlier = np.flatnonzero(observations_of(context, "crop").is_usable[:-1])
        if len(earlier) == 0:
            return 0.0, self.min_change
        numbers = np.linspace(0, len(earlier) - 1, self.num_frames)
        steps = np.unique(earlier[numbers.round().astype(int)])
        camera = context.intrinsics
        size_px = self.view_size(camera)
        views = scene.view(
            past.world_from_cam[steps],
            past.times_s[steps],
            camera.resized(*size_px),
        )
        last_frame = pinhole.resize(context.frames[-1], size_px)
        errors = []  # of the scene and of copies
        for step, predicted, covered in zip(steps, views.frames, views.covered, strict=True):
            if covered.any():
                frame = pinhole.resize(context.frames[step], size_px)
                scene_error = _error(predicted, frame, covered)
                copy_error = _error(last_frame, frame, covered)
                errors.append((scene_error, max(copy_error, self.min_change)))
        if not errors:
            return np.inf, self.min_change
        scene_error, copy_error = np.mean(errors, axis=0).tolist()
        return scene_error, copy_error


@dataclass(frozen=True)
class CheckedScene:
    """A scene that is replaced by the last frame where that shows the truth or is the best guess.

    This is under the scene mask, from the pose of the last frame, and everywhere if the scene
    failed its hindcast.
    """

    scene: Scene
    error_ratio: float  # of the hindcast: scene over copies
    agreement: float  # in [0, 1], of what is shown with earlier frames
    is_trusted: bool
    last: ByteArray  # [H, W, 3]
    mask: BoolArray  # [H, W], non-scene pixels
    world_from_last: FloatArray  # [4, 4]
    intrinsics: Intrinsics  # of the last frame

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4]; only the scene for any other camera."""
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        if intrinsics != self.intrinsics:
            return views
        shift = np.abs(world_from_cam - self.world_from_last)
        is_last = shift.max(axis=(1, 2)) < 1e-9  # rounding
        is_last |= not self.is_trusted
        is_copied = self.mask | is_last[:, None, None]
        if not is_copied.any():
            return views
        frames = np.where(is_copied[..., None], self.last, views.frames)
        return Views(frames, views.covered | is_copied, views.depths)


def _error(predicted: ByteArray, actual: ByteArray, covered: BoolArray) -> float:
    """Return the mean absolute difference of covered pixels at equal mean brightness."""
    is_covered = covered.astype(np.uint8)
    actual_mean = np.mean(cv2.mean(actual, is_covered)[:3])
    predicted_mean = np.mean(cv2.mean(predicted, is_covered)[:3])
    gain = float(actual_mean / max(predicted_mean, 1.0))
    difference = np.abs(np.float32(gain) * predicted - actual)
    return float(np.mean(cv2.mean(difference, is_covered)[:3]))
