"""One predicted clip, and what is to be said about it: plausibility, scores, settings."""

import contextlib
import dataclasses
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.matrix.components import code_hash
from geovp_benchmarks.predict import plausibility
from geovp_benchmarks.predict.camera import Camera, fov_of_focal
from geovp_benchmarks.predict.prediction_request import PredictionRequest
from geovp_benchmarks.results.provenance import versions
from geovp_classic import registry
from geovp_classic.errors import GeovpError
from geovp_classic.interfaces import FramePredictor
from geovp_classic.predictors.hindcast import CheckedScene
from geovp_classic.types import ByteArray, Context, Prediction, Views

CAMERA_SOURCES = {
    "given": "as given",
    "fov": "by the given angle of view",
    "calibration": "by the calibration file",
    "exif": "by the photos' EXIF data",
    "motion": "estimated from the motion",
    "assumed": "assumed",
}


@dataclass(frozen=True)
class Geometry:
    """What the scene of a geometric predictor shows, for the first sample."""

    views: Views  # [F]
    # [P], the scene at the last observed time, rendered at the poses of the observed frames
    rerendered: Views
    scene: CheckedScene


@dataclass(frozen=True)
class Predicted:
    """One predicted clip."""

    request: PredictionRequest
    predictor: FramePredictor
    context: Context
    prediction: Prediction
    geometry: Geometry | None  # None of a predictor without a scene
    first: int  # number of the first observed frame
    camera: Camera
    actual: ByteArray | None  # [F' <= F, H, W, 3], what was recorded of the future

    @property
    def error_ratio(self) -> float | None:
        """Return the hindcast's error ratio; None without a scene."""
        return None if self.geometry is None else self.geometry.scene.error_ratio

    @cached_property
    def warnings(self) -> list[str]:
        """Return a sentence for each sign that the prediction is wrong."""
        motion = self.prediction.motion
        messages = [] if motion is None else plausibility.warnings(self.context, motion)
        if self.geometry is not None and not self.geometry.scene.is_trusted:
            messages.append(
                f"the scene's error in earlier frames is {self.error_ratio:.0%} of that of copies "
                "of the last one, so the last frame is predicted: check the intrinsics and --fps"
            )
        return [*self.camera.warnings, *messages]

    @cached_property
    def confidence(self) -> list[float] | None:
        """Return the confidence of the first sample per step; see `Prediction.confidence`."""
        steps = self.prediction.confidence
        return None if steps is None else [round(float(value), 4) for value in steps[0]]

    @cached_property
    def scene_mask_fraction(self) -> float:
        """Return the fraction of the frame under the scene mask."""
        if self.geometry is None:
            return 0.0
        return round(float(self.geometry.scene.mask.mean()), 4)

    @cached_property
    def scores(self) -> dict[str, list[float]]:
        """Return each metric per step, of the first sample against the recorded future."""
        return self._score(self.prediction.frames[0])

    @cached_property
    def copy_last_scores(self) -> dict[str, list[float]]:
        """Return each metric per step, of copies of the last observed frame."""
        return self._score(self.context.frames[[-1] * self.context.num_future])

    def _score(self, frames: ByteArray) -> dict[str, list[float]]:
        if self.actual is None:
            return {}
        scores, metrics = {}, ["psnr", "ssim"]
        if os.environ.get("GEOVP_LPIPS_WEIGHTS"):  # they are not downloaded here
            metrics.append("lpips")
        for name in metrics:
            with contextlib.suppress(GeovpError):  # the images are too small, or torch is missing
                metric = registry.build("frame_metrics", name)
                values = metric(frames[: len(self.actual)], self.actual, None)
                scores[name] = [round(float(value), 4) for value in values]
        return scores

    def about(self) -> dict[str, Any]:
        """Return the contents of predict.json: settings, camera, plausibility and scores."""
        motion, camera, asked = (
            self.prediction.motion,
            self.camera,
            dataclasses.asdict(self.request),
        )
        return {
            "settings": {
                key: str(value) if isinstance(value, Path) else value
                for key, value in asked.items()
            },
            "predictor": registry.describe(self.predictor),
            "versions": versions(),
            "code": code_hash([self.predictor]),
            "camera": dataclasses.asdict(camera),
            "frames": {
                "first": self.first,
                "observed": self.context.num_past,
                "predicted": self.context.num_future,
            },
            "tracked_frames": None if motion is None else int(motion.tracked.sum()),
            "is_metric": motion is not None and motion.past.is_metric,
            "scale_uncertainty": motion and motion.past.scale_uncertainty,
            "hindcast_error_ratio": self.error_ratio,
            "off_axis_deg": motion and plausibility.off_axis_deg(motion),
            "confidence": self.confidence,
            "scene_mask_fraction": self.scene_mask_fraction,
            "warnings": self.warnings,
            "scores": self.scores,
            "copy_last_scores": self.copy_last_scores,
        }

    def summary(self) -> list[str]:
        """Return lines about camera, motion, confidence and scores, and a line per warning."""
        camera, motion = self.camera, self.prediction.motion
        focal_px, width_px = camera.intrinsics.fx_px, camera.intrinsics.width_px
        sure = (
            ""
            if camera.interval_px is None
            else " (90 %: {:.0f} to {:.0f})".format(*camera.interval_px)
        )
        source, fov_deg = CAMERA_SOURCES[camera.source], fov_of_focal(focal_px, width_px)
        lens = ", lens distortion taken out" if camera.removed_distortion else ""
        lines = [
            f"camera: {source}, focal length {focal_px:.1f} px{sure}, {fov_deg:.0f} degrees "
            f"wide{lens}"
        ]
        if motion is not None:
            unit = (
                "metres"
                if motion.past.is_metric
                else "an unknown unit (--camera-height gives metres)"
            )
            if motion.past.scale_uncertainty is not None:
                unit += f" +- {motion.past.scale_uncertainty:.0%}"
            count = f"{int(motion.tracked.sum())} of {len(motion.tracked)} observed frames tracked"
            lines.append(f"motion: {count}, lengths in {unit}")
        if self.scene_mask_fraction:
            lines.append(
                "scene mask: letterbox bars, the ego vehicle or --mask cover "
                f"{self.scene_mask_fraction:.0%} of the image"
            )
        if self.confidence is not None:
            lines.append(
                f"confidence: {self.confidence[0]:.2f} at the first step, "
                f"{self.confidence[-1]:.2f} at the last"
            )
        if self.actual is not None:
            means = [
                f"{name} {np.mean(values):.3f} (copy-last {np.mean(copied):.3f})"
                for (name, values), copied in zip(
                    self.scores.items(), self.copy_last_scores.values(), strict=True
                )
            ]
            count = f"means over {len(self.actual)} recorded frames"
            lines.append(f"scores: {', '.join(means)}; {count}")
        return [*lines, *(f"warning: {warning}" for warning in self.warnings)]
