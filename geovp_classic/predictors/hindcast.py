"""Hindcasting: what would have been predicted is compared with what was then observed.

The first half of the observed frames predicts the second half: by geometry, by the motion of the
image, and by copies of the last frame. This tests depths, layers and the forecast at once, with
observed frames alone, and decides what a clip is shown by. The poses of the first half are those of
the whole past: with five frames alone, odometry fails more often than with ten.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import get_args

import cv2
import numpy as np

from geovp_classic.errors import BadData, Incompatible
from geovp_classic.geometry import pinhole
from geovp_classic.interfaces import FramePredictor, Scene
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.predictors.flow_extrapolation import FlowExtrapolation
from geovp_classic.rendering.source import Source, resampled
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Intrinsics,
    ShownBy,
    Views,
)


@dataclass(frozen=True)
class HindcastVerdict:
    """Result of a hindcast; by default that of a scene that was not tested."""

    # Root mean square errors in grey values; empty: not tested
    errors: Mapping[ShownBy, float] = field(default_factory=dict)
    shown_by: ShownBy = "geometry"
    agreement: float = 1.0  # in [0, 1], of what is shown with the observed frames


@dataclass(frozen=True)
class Hindcast:
    """Choice between geometry, image motion and copies by the errors of their hindcasts."""

    image_motion: FramePredictor = FlowExtrapolation()
    # Of the predicted frames; a quarter of the pixels takes a quarter of the time
    scale: float = 0.5
    # Frames are not reduced below it: at 64 px, errors of coarse scenes equal those of copies
    min_width_px: int = 128
    # Others replace geometry if their error is less than this fraction of its error. Chosen on the
    # videos of other cameras, where .75 to .95 differ by .1 dB, and on KITTI's train and val, where
    # smaller ones keep geometry in all clips.
    max_error_ratio: float = 0.85
    # Grey values, of an error that halves the confidence; it only sets the unit of ranks
    error_at_half_confidence: float = 10.0

    def __post_init__(self) -> None:
        if not 0 < self.scale <= 1:
            raise BadData(f"hindcast: scale is {self.scale}, expected more than 0 and at most 1")

    def judge(
        self, predictor: FramePredictor, context: Context, mask: BoolArray
    ) -> HindcastVerdict:
        """Return by what a clip is shown, given the predictor by geometry.

        All observed frames of the context [P] must be usable; pixels of the mask [H, W] are not
        compared. With fewer than four frames, or too few for a component, there is no test.
        """
        if context.num_past < 4:
            return HindcastVerdict()

        # The observed frames are a clip of their own, whose future is known
        size_px = self.frame_size(context.intrinsics)
        needs = predictor.needs | self.image_motion.needs
        first, second = _resized_clip(context, size_px).split(context.num_past // 2, needs)
        if context.steps is not None:
            first = replace(first, steps=context.steps[: first.num_past])
        mask = pinhole.resize_mask(mask, size_px)

        # Predict its future, and compare
        candidates: dict[ShownBy, FramePredictor] = {
            "geometry": predictor,
            "image-motion": self.image_motion,
            "last-frame": CopyLast(),
        }
        errors: dict[ShownBy, float] = {}
        for name, candidate in candidates.items():
            try:
                prediction = candidate.predict(first.only(candidate.needs))
            except Incompatible:  # too few corners, for example
                errors[name] = np.inf
            except BadData:  # settings that half of the frames do not suit
                return HindcastVerdict()
            else:
                errors[name] = self.error(prediction.frames[0], second.frames, mask)
        return self.verdict([errors])

    def verdict(self, tests: Sequence[Mapping[ShownBy, float]]) -> HindcastVerdict:
        """Return the verdict on the mean errors of one test or more; geometry is preferred."""
        errors = {name: float(np.mean([test[name] for test in tests])) for name in tests[0]}
        shown_by = min(errors, key=errors.__getitem__)
        if errors[shown_by] >= self.max_error_ratio * errors["geometry"]:
            shown_by = "geometry"
        agreement = 1 / (1 + errors[shown_by] / self.error_at_half_confidence)
        return HindcastVerdict(errors, shown_by, agreement)

    def frame_size(self, camera: Intrinsics) -> tuple[int, int]:
        """Return (width, height) of the predicted frames in pixels."""
        scale = max(self.scale, min(1.0, self.min_width_px / camera.width_px))
        return max(1, round(camera.width_px * scale)), max(1, round(camera.height_px * scale))

    @staticmethod
    def error(predicted: ByteArray, actual: ByteArray, mask: BoolArray) -> float:
        """Return the root mean square error of frames [F, H, W, 3] outside of a mask [H, W]."""
        is_compared = (~mask).astype(np.uint8)
        squares = [
            np.mean(cv2.mean(cv2.absdiff(*pair).astype(np.float32) ** 2, is_compared)[:3])
            for pair in zip(predicted, actual, strict=True)
        ]
        return float(np.sqrt(np.mean(squares)))


@dataclass(frozen=True)
class ShownScene:
    """A scene that is replaced where something else shows the truth or is the better guess.

    This is the last frame under the scene mask and from the pose of the last frame, and everywhere
    what the verdict says. Copied pixels are not covered by the scene.
    """

    scene: Scene
    context: Context  # of the usable whole frames
    mask: BoolArray  # [H, W], non-scene pixels
    world_from_last: FloatArray  # [4, 4]
    image_motion: FramePredictor = FlowExtrapolation()
    verdict: HindcastVerdict = HindcastVerdict()
    max_rounding: float = 1e-9  # of an entry of a pose, which is still that of the last frame

    def view(
        self,
        world_from_cam: FloatArray,
        times_s: FloatArray,
        intrinsics: Intrinsics,
    ) -> Views:
        """Return the views from the poses [F, 4, 4] at the times [F], in any size."""
        copied = self.copied(world_from_cam, intrinsics)
        if copied.all():
            last = self._seen(self.context.frames[-1], intrinsics)
            frames = np.repeat(last[None], len(times_s), axis=0)
            return Views(frames, ~copied, np.zeros(copied.shape, np.float32))
        if self.verdict.shown_by == "image-motion":
            views = self._moved_views(times_s, intrinsics)
        else:
            views = self.scene.view(world_from_cam, times_s, intrinsics)
        if not copied.any():
            return views
        last = pinhole.resize(self.context.frames[-1], intrinsics.size_px)
        frames = np.where(copied[..., None], last, views.frames)
        moving = None if views.moving is None else views.moving & ~copied
        return Views(frames, views.covered & ~copied, views.depths, moving)

    def copied(self, world_from_cam: FloatArray, intrinsics: Intrinsics) -> BoolArray:
        """Return which pixels [F, H, W] of the views are those of the last frame.

        Those of a camera with another field of view are so by the verdict alone.
        """
        mask = pinhole.resize_mask(self.mask, intrinsics.size_px)
        shift = np.abs(world_from_cam - self.world_from_last)
        is_last = shift.max(axis=(1, 2)) < self.max_rounding
        is_last &= self.verdict.shown_by == "geometry"
        pixels = is_last[:, None, None] | mask
        pixels &= self._has_view(intrinsics)
        return pixels | (self.verdict.shown_by == "last-frame")

    def _has_view(self, intrinsics: Intrinsics) -> bool:
        """Return whether a camera has the field of view of the context."""
        same_view = self.context.intrinsics.resized(*intrinsics.size_px)
        return np.allclose(intrinsics.matrix, same_view.matrix)

    def _seen(self, frame: ByteArray, intrinsics: Intrinsics) -> ByteArray:
        """Return a frame of the context as a camera at its place shows it."""
        if self._has_view(intrinsics):
            return pinhole.resize(frame, intrinsics.size_px)
        return resampled(Source(frame, self.context.intrinsics, np.eye(4)), intrinsics)

    def each(
        self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
    ) -> dict[ShownBy, ByteArray]:
        """Return the frames [F, H, W, 3] of the views by each way to show them."""
        ways: tuple[ShownBy, ...] = get_args(ShownBy)
        scenes = {way: replace(self, verdict=HindcastVerdict(shown_by=way)) for way in ways}
        return {
            way: scene.view(world_from_cam, times_s, intrinsics).frames
            for way, scene in scenes.items()
        }

    def _moved_views(self, times_s: FloatArray, intrinsics: Intrinsics) -> Views:
        """Return views [F] by image motion, measured in their size; none before the last frame."""
        context = self.context
        last = np.stack([self._seen(frame, intrinsics) for frame in context.frames[-2:]])
        frames = np.repeat(last[-1:], len(times_s), axis=0)
        covered = np.zeros(frames.shape[:3], bool)
        is_future = times_s > context.past_s[-1]
        if is_future.any():
            future_s = np.append(context.past_s[-2:], times_s[is_future])
            prediction = self.image_motion.predict(Context(last, future_s, intrinsics))
            frames[is_future] = prediction.frames[0]
            if prediction.covered is not None:
                covered[is_future] = prediction.covered[0]
        return Views(frames, covered, np.zeros(frames.shape[:3], np.float32))


def _resized_clip(context: Context, size_px: tuple[int, int]) -> Clip:
    """Return the observed frames of a context as a clip, with its privileged inputs."""
    depths = context.past_depths
    if depths is not None:
        nearest = cv2.INTER_NEAREST_EXACT
        depths = np.stack([cv2.resize(each, size_px, interpolation=nearest) for each in depths])
    return Clip(
        context.name,
        np.stack([pinhole.resize(frame, size_px) for frame in context.frames]),
        context.past_s,
        context.intrinsics.resized(*size_px),
        context.past,
        depths,
        full=context.full,
        right=context.right,
        camera_height_m=context.camera_height_m,
    )
