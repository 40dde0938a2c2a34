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
class Verdict:
    """Result of a hindcast; by default that of a scene that was not tested."""

    error_ratio: float | None = None  # of the scene over copies; None: not tested
    agreement: float = 1.0  # in [0, 1], of what is shown with earlier frames
    is_trusted: bool = True


@dataclass(frozen=True)
class Hindcast:
    """Comparison of a scene with earlier frames and with copies of the last frame."""

    # Evenly spaced among the usable frames before the last: the nearest, the farthest, one between
    num_frames: int = 3
    # Of the views; a quarter of the pixels takes a quarter of the time
    scale: float = 0.5
    # Views are not reduced below it: at 64 px, errors of coarse scenes equal those of copies
    min_width_px: int = 128
    # A scene with a larger one is replaced by the last frame; 1 less a margin of 5 % for noise
    max_error_ratio: float = 0.95
    # Grey values, about the noise of a camera; frames that change less do not test a scene
    min_change: float = 3.0
    # Grey values, of a hindcast error that halves the confidence; it only sets the unit of ranks
    error_at_half_confidence: float = 10.0

    def __post_init__(self) -> None:
        if self.num_frames < 1 or not 0 < self.scale <= 1:
            raise BadData(
                f"hindcast: num_frames {self.num_frames} and scale {self.scale}, expected at "
                "least one frame and a scale in (0, 1]"
            )

    def judge(self, scene: Scene, context: Context, past: Trajectory) -> Verdict:
        """Return whether a scene is trusted: it must predict earlier frames better than copies."""
        scene_error, copy_error = self.errors(scene, context, past)
        error_ratio = scene_error / copy_error
        is_trusted = error_ratio <= self.max_error_ratio
        shown_error = scene_error if is_trusted else copy_error
        agreement = 1 / (1 + shown_error / self.error_at_half_confidence)
        return Verdict(error_ratio, agreement, is_trusted)

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
        # Choose earlier frames, and render the scene from their poses
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

        # Compare the views and the last frame with these frames, over the same pixels
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
    failed its hindcast. The copied pixels are not covered by the scene.
    """

    scene: Scene
    verdict: Verdict
    last: ByteArray  # [H, W, 3]
    mask: BoolArray  # [H, W], non-scene pixels
    world_from_last: FloatArray  # [4, 4]
    intrinsics: Intrinsics  # of the last frame
    max_rounding: float = 1e-9  # of an entry of a pose, which is still that of the last frame

    @property
    def error_ratio(self) -> float | None:
        """Return the error of the hindcast over that of copies; None if it was not tested."""
        return self.verdict.error_ratio

    @property
    def agreement(self) -> float:
        """Return the agreement of what is shown with earlier frames, in [0, 1]."""
        return self.verdict.agreement

    @property
    def is_trusted(self) -> bool:
        """Return whether the scene is shown."""
        return self.verdict.is_trusted

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4], in any size."""
        views = self.scene.view(world_from_cam, times_s, intrinsics)
        copied = self.copied(world_from_cam, intrinsics)
        if not copied.any():
            return views
        last = pinhole.resize(self.last, (intrinsics.width_px, intrinsics.height_px))
        frames = np.where(copied[..., None], last, views.frames)
        return Views(frames, views.covered & ~copied, views.depths)

    def copied(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> BoolArray:
        """Return which pixels [F, H, W] of the views are those of the last frame.

        A camera with another field of view has none.
        """
        size_px = intrinsics.width_px, intrinsics.height_px
        num_views = len(world_from_cam)
        same_view = self.intrinsics.resized(*size_px).matrix
        if not np.allclose(intrinsics.matrix, same_view):
            return np.zeros((num_views, size_px[1], size_px[0]), bool)
        shift = np.abs(world_from_cam - self.world_from_last)
        is_last = shift.max(axis=(1, 2)) < self.max_rounding
        is_last |= not self.is_trusted
        mask = cv2.resize(self.mask.astype(np.uint8), size_px, interpolation=cv2.INTER_NEAREST)
        return is_last[:, None, None] | (mask > 0)


def _error(predicted: ByteArray, actual: ByteArray, covered: BoolArray) -> float:
    """Return the mean absolute difference of covered pixels at equal mean brightness."""
    is_covered = covered.astype(np.uint8)
    actual_mean = np.mean(cv2.mean(actual, is_covered)[:3])
    predicted_mean = np.mean(cv2.mean(predicted, is_covered)[:3])
    gain = float(actual_mean / max(predicted_mean, 1.0))
    difference = np.abs(np.float32(gain) * predicted - actual)
    return float(np.mean(cv2.mean(difference, is_covered)[:3]))
