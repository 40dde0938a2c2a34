"""A clip's predicted frames with some stages from the truth: poses, depth, and what is done to images."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from benchmarks.studies.budget.poses import PAST, SCALE, STAGES, ClipMotions, Oracles
from geovp_classic.depth.given import Given
from geovp_classic.depth.stereo import Stereo
from geovp_classic.geometry import pinhole
from geovp_classic.interfaces import DepthSource, Renderer, Scene
from geovp_classic.render.exposure import BRIGHTEST, DARKEST, apply_log_gain
from geovp_classic.types import BoolArray, ByteArray, Clip, Context, Target, Views

DEPTH, HOLES, MOVING, EXPOSURE = "depth", "holes", "dynamic objects", "exposure"
ALL_STAGES = (*STAGES, DEPTH, HOLES, MOVING, EXPOSURE)
COARSE = 8  # an image is compared in brightness at so much less resolution, whatever its poses are
MIN_CELLS = 8  # of such a coarse image


@dataclass(frozen=True)
class ClipImages:
    """All mixtures of one clip's predicted frames; what they share is computed once."""

    motions: ClipMotions
    renderer: Renderer
    depth: DepthSource | None  # the oracle's
    context: Context
    target: Target
    steps: tuple[int, ...]  # of the future frames
    scenes: dict[Oracles, Scene] = field(default_factory=dict)
    views: dict[Oracles, Views] = field(default_factory=dict)

    def frames(self, oracles: Oracles) -> ByteArray:
        """Predicted frames [N, H, W, 3]; holes and dynamic objects are copied from the true ones."""
        views, real = self._view(oracles & {*STAGES, DEPTH}), self.real
        frames = views.frames
        if EXPOSURE in oracles:
            pairs = zip(frames, real, views.covered, strict=True)
            frames = np.stack([apply_log_gain(frame, log_gain(frame, *others)) for frame, *others in pairs])
        if HOLES in oracles:
            frames = np.where(views.covered[..., None], frames, real)
        if MOVING in oracles and self.target.moving is not None:
            frames = np.where(self.target.moving[list(self.steps)][..., None], real, frames)
        return frames

    @cached_property
    def real(self) -> ByteArray:
        """The true frames [N, H, W, 3]."""
        return self.target.frames[list(self.steps)]

    def _view(self, oracles: Oracles) -> Views:
        if oracles not in self.views:
            motion = self.motions.motion(oracles)
            about_scene = oracles & {PAST, SCALE, DEPTH}
            if about_scene not in self.scenes:
                renderer = with_depth(self.renderer, self.depth) if DEPTH in oracles else self.renderer
                self.scenes[about_scene] = renderer.reconstruct(self.context.only(renderer.needs), motion.past)
            steps, times_s = list(self.steps), self.context.times_s[self.context.num_past :]
            scene, camera = self.scenes[about_scene], self.context.intrinsics
            self.views[oracles] = scene.view(motion.futures[0, steps], times_s[steps], camera)
        return self.views[oracles]


def log_gain(
    predicted: ByteArray,  # [H, W, 3]
    real: ByteArray,  # [H, W, 3]
    covered: BoolArray,  # [H, W]
) -> float:
    """The median log ratio of true to predicted grey levels, over coarse cells that are comparable in both."""
    height, width = covered.shape
    size_px = (max(1, width // COARSE), max(1, height // COARSE))
    small = [
        np.asarray(cv2.resize(image.astype(np.float32), size_px, interpolation=cv2.INTER_AREA))
        for image in (pinhole.grey(predicted), pinhole.grey(real), covered)
    ]
    good = small[2] > 0.99
    for image in small[:2]:
        good &= (image > DARKEST) & (image < BRIGHTEST)
    return float(np.median(np.log(small[1][good] / small[0][good]))) if good.sum() >= MIN_CELLS else 0.0


def with_depth(renderer: Renderer, depth: DepthSource | None) -> Renderer:
    """The renderer with another depth source."""
    component: Any = renderer
    return component if depth is None else replace(component, depth=depth)


def oracle_depth(clip: Clip, renderer: Renderer) -> DepthSource | None:
    """Recorded depth, else that of the right images; None where there is neither, or the renderer takes none."""
    component: Any = renderer
    if not isinstance(getattr(component, "depth", None), DepthSource):
        return None
    if clip.depths is not None and getattr(component, "frames", "crop") == "crop":  # recorded for the crop alone
        return Given()
    return None if clip.right is None else Stereo()


def not_measurable(clip: Clip, renderer: Renderer) -> dict[str, str]:
    """The stages without an oracle for such clips, and why."""
    reasons = {}
    if oracle_depth(clip, renderer) is None:
        reasons[DEPTH] = "needs recorded depth or right images (--stereo), and a renderer that takes a depth source"
    if clip.moving is None:
        reasons[MOVING] = "needs exact masks of what moves, which only synthetic clips have"
    return reasons
