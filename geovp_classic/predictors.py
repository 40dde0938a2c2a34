"""Whole predictors: geometry (a pose source and a renderer meet here, and only here), the last frame, recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geovp_classic.interfaces import PoseSource, Renderer, Scene
from geovp_classic.types import Context, Grant, Intrinsics, Motion, Prediction, Trajectory


@dataclass(frozen=True)
class GeometricPredictor:
    """Where the camera will be, by a pose source, and what it sees there, by a renderer.

    `predict` is its three steps in a row; who predicts often keeps their results: motions per pose source, scenes per
    past.
    """

    pose_source: PoseSource
    renderer: Renderer

    @property
    def needs(self) -> Grant:
        """What the two parts need; each part sees only its own share."""
        return self.pose_source.needs | self.renderer.needs

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Frames [S, F, H, W, 3] with coverage and motion; S = 1 when the pose source is deterministic."""
        motion = self.estimate(context, num_samples)
        return show(self.reconstruct(context, motion.past), motion, context.intrinsics)

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """The first step: the motion."""
        return self.pose_source.estimate(context.only(self.pose_source.needs), num_samples)

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """The second step: the scene, which depends on the past alone."""
        return self.renderer.reconstruct(context.only(self.renderer.needs), past)


def show(scene: Scene, motion: Motion, camera: Intrinsics) -> Prediction:
    """The third step: the scene seen from every sampled future of the motion."""
    samples = [scene.view(future, camera) for future in motion.futures]
    frames, covered = np.stack([views.frames for views in samples]), np.stack([views.covered for views in samples])
    return Prediction(frames, covered, motion)


@dataclass(frozen=True)
class CopyLast:
    """The last observed frame, again and again."""

    @property
    def needs(self) -> Grant:
        """Nothing but the frames."""
        return Grant.NONE

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """The last frame F times, one sample."""
        return Prediction(np.tile(context.frames[-1], (1, context.num_future, 1, 1, 1)))
