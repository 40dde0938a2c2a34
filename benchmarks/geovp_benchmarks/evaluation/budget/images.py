"""A clip's predicted frames with some stages from the truth: poses, depth, and what is done to
images.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from geovp_benchmarks.evaluation.budget.poses import PAST, SCALE, STAGES, ClipMotions, Oracles
from geovp_classic.depth.given import Given
from geovp_classic.depth.stereo import Stereo
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import pinhole
from geovp_classic.interfaces import DepthSource, Renderer, Scene
from geovp_classic.rendering.exposure import ExposureEstimator, ToneCurve
from geovp_classic.types import BoolArray, ByteArray, Clip, Context, Target, Views

DEPTH, HOLES, MOVING, EXPOSURE = "depth", "holes", "dynamic objects", "exposure"
ALL_STAGES = (*STAGES, DEPTH, HOLES, MOVING, EXPOSURE)
COARSE = 8  # an image is compared in brightness at so much less resolution, whatever its poses are
MIN_SEEN = 0.1  # of a frame's pixels
MIN_CELLS = 8  # of such a coarse image


@dataclass(frozen=True)
class ClipImages:
    """All mixtures of one clip's predicted frames; what they share is computed once."""

    motions: ClipMotions
    renderer: Renderer
    true_depth: Renderer | None  # the same with the depth oracle
    context: Context
    target: Target
    steps: tuple[int, ...]  # of the future frames
    scenes: dict[Oracles, Scene] = field(default_factory=dict)
    views: dict[Oracles, Views] = field(default_factory=dict)

    def frames(self, oracles: Oracles) -> tuple[ByteArray, ByteArray]:
        """Predicted and real frames [N, H, W, 3]; holes and dynamic objects are copied from the
        real ones.

        Holes are the pixels that even true poses do not show. Frames of nearly nothing else are
        left out: without their holes they would be exact, and no mean of decibels stands that.
        Incompatible when none is left.
        """
        views, seen = (
            self._view(oracles & {*STAGES, DEPTH}),
            self._view(frozenset({*STAGES, DEPTH})).covered,
        )
        counted = np.flatnonzero(seen.mean(axis=(1, 2)) >= MIN_SEEN)
        if not len(counted):
            raise Incompatible(
                f"{self.context.name} shows next to nothing in its future that was seen before"
            )
        steps = np.array(self.steps)[counted]
        frames, real = views.frames[counted], self.target.frames[steps]
        if EXPOSURE in oracles:
            pairs = zip(frames, real, views.covered[counted], strict=True)
            frames = np.stack(
                [ToneCurve().apply(frame, log_gain(frame, *others)) for frame, *others in pairs]
            )
        if HOLES in oracles:
            frames = np.where(seen[counted][..., None], frames, real)
        if MOVING in oracles and self.target.moving is not None:
            frames = np.where(self.target.moving[steps][..., None], real, frames)
        return frames, real

    def _view(self, oracles: Oracles) -> Views:
        if oracles not in self.views:
            motion = self.motions.motion(oracles)
            about_scene = oracles & {PAST, SCALE, DEPTH}
            if about_scene not in self.scenes:
                renderer = (
                    self.true_depth if DEPTH in oracles and self.true_depth else self.renderer
                )
                self.scenes[about_scene] = renderer.reconstruct(
                    self.context.only(renderer.needs), motion.past
                )
            steps, times_s = list(self.steps), self.context.times_s[self.context.num_past :]
            scene, camera = self.scenes[about_scene], self.context.intrinsics
            self.views[oracles] = scene.view(motion.futures[0, steps], times_s[steps], camera)
        return self.views[oracles]


def log_gain(
    predicted: ByteArray,  # [H, W, 3]
    real: ByteArray,  # [H, W, 3]
    covered: BoolArray,  # [H, W]
) -> float:
    """The median log ratio of true to predicted grey levels, over coarse cells that are comparable
    in both.
    """
    height, width = covered.shape
    size_px = (max(1, width // COARSE), max(1, height // COARSE))
    small = [
        np.asarray(cv2.resize(image.astype(np.float32), size_px, interpolation=cv2.INTER_AREA))
        for image in (pinhole.grey(predicted), pinhole.grey(real), covered)
    ]
    limits = ExposureEstimator()
    good = small[2] > 0.99
    for image in small[:2]:
        good &= (image > limits.min_grey) & (image < limits.max_grey)
    return (
        float(np.median(np.log(small[1][good] / small[0][good])))
        if good.sum() >= MIN_CELLS
        else 0.0
    )


def with_true_depth(renderer: Renderer, clip: Clip) -> Renderer | None:
    """The renderer with recorded depth, else that of the right images; None without either, or if
    it takes none.
    """
    component: Any = renderer
    if not isinstance(getattr(component, "depth", None), DepthSource):
        return None
    if (
        clip.depths is not None and getattr(component, "frames", "crop") == "crop"
    ):  # recorded for the crop alone
        return replace(component, depth=Given())
    return None if clip.right is None else replace(component, depth=Stereo())
