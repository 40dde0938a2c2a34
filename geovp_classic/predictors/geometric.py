"""The geometric predictor: a pose source and a renderer, which meet only here."""

from dataclasses import dataclass

import numpy as np

from geovp_classic.interfaces import PoseSource, Renderer, Scene
from geovp_classic.observation.masking import behind_static_regions, without_static_regions
from geovp_classic.types import Context, Motion, Prediction, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class GeometricPredictor:
    """A pose source says where the camera will be, and a renderer shows the scene from there.

    `predict` runs three steps; a caller with many predictors runs them one by one and caches their
    results: a motion per pose source, a scene per past. Parts of the vehicle in the image are shown
    to neither and stay where they are.
    """

    pose_source: PoseSource
    renderer: Renderer

    @property
    def needs(self) -> PrivilegedInput:
        """The needs of both parts; each part is shown only what it needs itself."""
        return self.pose_source.needs | self.renderer.needs

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Frames [S, F, H, W, 3] with coverage and motion; S = 1 when the pose source is
        deterministic.
        """
        motion = self.estimate(context, num_samples)
        return show(self.reconstruct(context, motion.past), motion, context)

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        """Step 1: the motion."""
        return self.pose_source.estimate(
            without_static_regions(context.only(self.pose_source.needs)), num_samples
        )

    def reconstruct(self, context: Context, past: Trajectory) -> Scene:
        """Step 2: the scene, which depends on the past alone."""
        seen = context.only(self.renderer.needs)
        return behind_static_regions(
            self.renderer.reconstruct(without_static_regions(seen), past), seen
        )


def show(scene: Scene, motion: Motion, context: Context) -> Prediction:
    """Step 3: the views of the scene from every sampled future of the motion, at the
    future times.
    """
    times_s = context.times_s[context.num_past :]
    samples = [scene.view(future, times_s, context.intrinsics) for future in motion.futures]
    covered = np.stack([views.covered for views in samples])
    return Prediction(np.stack([views.frames for views in samples]), covered, motion)
