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
from geovp_benchmarks.running.planning import versions
from geovp_classic import registry
from geovp_classic.errors import GeovpError
from geovp_classic.interfaces import FramePredictor
from geovp_classic.predictors.hindcast import CheckedScene
from geovp_classic.types import ByteArray, Context, Prediction, Views

METRICS = ("psnr", "ssim", "lpips")
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
        """A sentence for everything that speaks against the prediction."""
        motion = self.prediction.motion
        found = [] if motion is None else plausibility.warnings(self.context, motion)
        if self.geometry is not None and not self.geometry.scene.is_trusted:
            found.append(
                f"the scene's error in earlier frames is {self.error_ratio:.0%} of that of copies "
                "of the last one, so the last frame is predicted: check the intrinsics and --fps"
            )
        return [*self.camera.warnings, *found]

    @cached_property
    def confidence(self) -> list[float] | None:
        """What the first sample's frames rest on, per step; see `Prediction.confidence`."""
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
        """Per step and metric, the first sample beside the recorded future; without LPIPS where it
        has no weights.
        """
        if self.actual is None:
            return {}
        predicted, found = self.prediction.frames[0, : len(self.actual)], {}
        for name in (
            METRICS if os.environ.get("GEOVP_LPIPS_WEIGHTS") else METRICS[:2]
        ):  # it would download them
            with contextlib.suppress(
                GeovpError
            ):  # images too small for a metric, or torch is missing
                values = registry.build("frame_metrics", name)(predicted, self.actual, None)
                found[name] = [round(float(value), 4) for value in values]
        return found

    def about(self) -> dict[str, Any]:
        """Settings, camera, plausibility and scores, for predict.json."""
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
        }

    def summary(self) -> list[str]:
        """What the prediction rests on, a line each, and a line for every warning."""
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
        means = [f"{name} {np.mean(values):.3f}" for name, values in self.scores.items()]
        lines += (
            [f"scores: {', '.join(means)}, means over {len(self.actual)} recorded frames"]
            if self.actual is not None
            else []
        )
        return [*lines, *(f"warning: {warning}" for warning in self.warnings)]
