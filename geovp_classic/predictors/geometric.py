"""The geometric predictor: a pose source and a renderer, which meet only here."""

from dataclasses import dataclass, replace

import numpy as np

from geovp_classic.interfaces import PoseSource, Renderer
from geovp_classic.observation import Observed, Observer, observations_of
from geovp_classic.odometry.recorded_past import RecordedPast
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.predictors.hindcast import Hindcast, ShownScene
from geovp_classic.types import Context, Motion, Prediction, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class GeometricPredictor:
    """Predictor that renders the scene from the poses of a pose source.

    Callers with many predictors run the steps one by one: observe a clip once, estimate a motion
    per pose source, reconstruct a scene per past.
    """

    pose_source: PoseSource
    renderer: Renderer
    observer: Observer = Observer()
    # Replaces the views by image motion or by the last frame where these predict the observed
    # frames better. None: the predictor shows its own images.
    hindcast: Hindcast | None = None

    @property
    def needs(self) -> PrivilegedInput:
        """Return the needs of both components; each sees only its own."""
        return self.pose_source.needs | self.renderer.needs

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        """Predict frames [S, F, H, W, 3]; S = 1 if the pose source is deterministic."""
        observed = self.observe(context)
        motion = self.estimate(observed, num_samples)
        scene = self.reconstruct(observed, motion.past)
        return show(self.judge(scene, motion), motion, context)

    def observe(self, context: Context) -> Observed:
        """Reduce the context to the scene and compute its observations."""
        return self.observer.observe(context.only(self.needs))

    def estimate(self, observed: Observed, num_samples: int = 1) -> Motion:
        """Estimate the past and future motion of the camera."""
        return self.pose_source.estimate(observed.context.only(self.pose_source.needs), num_samples)

    def reconstruct(self, observed: Observed, past: Trajectory) -> ShownScene:
        """Reconstruct the scene, which depends on the past alone."""
        needs = self.renderer.needs
        scene = self.renderer.reconstruct(observed.context.only(needs), past)
        is_usable = observations_of(observed.context, "crop").is_usable
        usable = replace(observed.original, past=past).observed(is_usable)
        return ShownScene(scene, usable, observed.crop_mask(needs), past.world_from_cam[-1])

    def judge(self, scene: ShownScene, motion: Motion) -> ShownScene:
        """Return the scene with the verdict of the hindcast on what is to be shown.

        The image does not follow commands, so that nothing replaces the scene then.
        """
        if self.hindcast is None or motion.is_commanded:
            return scene
        # The poses are known: their forecast and the scene are tested. So is the scene mask: in a
        # part of the frames, the road of a straight drive may look fixed to the camera
        source, observer = self.pose_source, self.observer
        if motion.forecaster is not None:
            source = Chained(RecordedPast(), motion.forecaster)
        if scene.context.full is None:
            observer = replace(observer, mask=scene.mask, mask_mode="replace")
        tested = replace(self, pose_source=source, observer=observer, hindcast=None)
        verdict = self.hindcast.judge(tested, scene.context, scene.mask)
        return replace(scene, image_motion=self.hindcast.image_motion, verdict=verdict)


def show(scene: ShownScene, motion: Motion, context: Context) -> Prediction:
    """Render the scene from all sampled futures of the motion, at the future times."""
    # Views of each sampled future, with the pixels that are copies of the last frame
    times_s, camera = context.future_s, context.intrinsics
    samples = [scene.view(future, times_s, camera) for future in motion.futures]
    frames = np.stack([views.frames for views in samples])
    covered = np.stack([views.covered for views in samples])
    copied = np.stack([scene.copied(future, camera) for future in motion.futures])

    # Confidence falls with the inpainted pixels, with each step after the tracked ones, and with
    # the error of the hindcast
    observed_fraction = (covered | copied).mean(axis=(2, 3))
    num_frames = len(motion.tracked) + np.arange(1, len(times_s) + 1)
    tracked_fraction = motion.tracked.sum() / num_frames
    confidence = observed_fraction * tracked_fraction * scene.verdict.agreement
    return Prediction(frames, covered, motion, confidence, scene.verdict.shown_by, copied)
