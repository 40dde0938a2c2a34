"""Prediction of one clip from a folder of images, a video or a webcam."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geovp_benchmarks.matrix.components import code_hash
from geovp_benchmarks.predict import webcam
from geovp_benchmarks.predict.camera import Camera, find_camera
from geovp_benchmarks.predict.request import PredictionRequest, output_size
from geovp_benchmarks.progress import announce
from geovp_benchmarks.results.provenance import versions
from geovp_classic import registry
from geovp_classic.api import evaluate
from geovp_classic.data import windows
from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.geometry import se3
from geovp_classic.interfaces import FramePredictor
from geovp_classic.odometry.speed_prior import MIN_SPREAD
from geovp_classic.predictors.geometric import GeometricPredictor, show
from geovp_classic.predictors.hindcast import CheckedScene
from geovp_classic.types import ByteArray, Context, Motion, Prediction, PrivilegedInput, Target


@dataclass(frozen=True)
class Predicted:
    """A predicted clip with its scores and plausibility."""

    request: PredictionRequest
    predictor: FramePredictor
    camera: Camera
    context: Context
    first: int  # number of the first observed frame
    prediction: Prediction
    scene: CheckedScene | None  # of a geometric predictor
    actual: ByteArray  # [F' <= F, H, W, 3], recorded future frames

    @cached_property
    def scores(self) -> dict[str, list[float]]:
        """Return each metric per step, of the first sample against the recorded future."""
        return _score(self.prediction.frames[0], self.actual)

    @cached_property
    def copy_last_scores(self) -> dict[str, list[float]]:
        """Return each metric per step, of copies of the last observed frame."""
        return _score(self.context.frames[[-1] * self.context.num_future], self.actual)

    def warnings(
        self, min_tracked_fraction: float = 0.7, max_off_axis_deg: float = 6.0
    ) -> list[str]:
        """Return a sentence for each sign that the prediction is wrong."""
        messages = []
        if self.camera.source == "assumed":
            messages.append(
                f"the motion does not tell the focal length: {self.camera.fov_deg:.0f} degrees are "
                "assumed; give --fov, --calibration or --intrinsics"
            )
        if self.scene is not None and not self.scene.is_trusted:
            messages.append(
                "the scene does not explain earlier frames, so the last frame is predicted: check "
                "the intrinsics and --fps"
            )
        motion = self.prediction.motion
        if motion is None:
            return messages
        if motion.tracked.mean() < min_tracked_fraction:
            messages.append("few frames were tracked: give sharper frames or a larger --size")
        if (off_axis_deg(motion) or 0.0) > max_off_axis_deg:
            messages.append(
                f"the camera travels {off_axis_deg(motion):.0f} degrees off its optical axis: "
                "unless it is mounted like that, the principal point is wrong"
            )
        if (motion.past.scale_uncertainty or 0.0) >= MIN_SPREAD:
            messages.append("no road was found: the scale is that of typical driving speeds")
        if not np.ptp(motion.past.world_from_cam[:, :3, 3], axis=0).any():
            messages.append("the camera is stationary, so the prediction is static")
        return messages

    def about(self) -> dict[str, Any]:
        """Return the contents of predict.json."""
        motion, scene, confidence = self.prediction.motion, self.scene, self.prediction.confidence
        return {
            "settings": dataclasses.asdict(self.request),
            "predictor": registry.describe(self.predictor),
            "versions": versions(),
            "code": code_hash([self.predictor]),
            "camera": dataclasses.asdict(self.camera),
            "frames": {
                "first": self.first,
                "observed": self.context.num_past,
                "predicted": self.context.num_future,
            },
            "tracked_frames": motion and int(motion.tracked.sum()),
            "is_metric": motion is not None and motion.past.is_metric,
            "scale_uncertainty": motion and motion.past.scale_uncertainty,
            "off_axis_deg": motion and off_axis_deg(motion),
            "hindcast_error_ratio": scene and scene.error_ratio,
            "scene_mask_fraction": float(scene.mask.mean()) if scene else 0.0,
            "confidence": None if confidence is None else confidence[0].tolist(),
            "warnings": self.warnings(),
            "scores": self.scores,
            "copy_last_scores": self.copy_last_scores,
        }

    def summary(self) -> list[str]:
        """Return a line on the camera, one per score, and one per warning."""
        camera = self.camera
        interval = ""
        if camera.interval_px is not None:
            interval = " (90 %: {:.0f} to {:.0f})".format(*camera.interval_px)
        lines = [
            f"camera ({camera.source}): focal length {camera.intrinsics.fx_px:.1f} px{interval}, "
            f"{camera.fov_deg:.0f} degrees wide"
        ]
        for name, values in self.scores.items():
            copied = np.mean(self.copy_last_scores[name])
            lines.append(f"{name} {np.mean(values):.3f}, of copies {copied:.3f}")
        return [*lines, *(f"warning: {message}" for message in self.warnings())]


def predict(request: PredictionRequest) -> Predicted:
    """Read, track, forecast, reconstruct and render; BadData names a missing input."""
    predictor = request.build()
    missing = predictor.needs & ~(PrivilegedInput.CAMERA_HEIGHT | PrivilegedInput.FULL_FRAMES)
    if missing:
        name = registry.name_of(predictor)
        raise BadData(f"{name} needs {missing.name}, which a video does not have")
    announce("reading frames")
    recording = _open(request)
    first = _first(request, len(recording.frames))
    end = first + request.num_past
    announce("calibrating", 1)
    camera, recording = find_camera(recording, end, request)
    stored = recording.intrinsics
    size_px = output_size(request.size_px, stored.width_px, stored.height_px)
    with_full = PrivilegedInput.FULL_FRAMES in predictor.needs
    clip = windows.cut(recording, first, request.num_past, size_px, with_full=with_full)
    step_s = float(np.mean(np.diff(clip.times_s)))
    future_s = clip.times_s[-1] + step_s * np.arange(1, request.num_future + 1)
    context = Context(
        frames=clip.frames,
        times_s=np.concatenate([clip.times_s, future_s]),
        intrinsics=clip.intrinsics,
        camera_height_m=clip.camera_height_m,
        full=clip.full,
        name=clip.name,
    )
    prediction, scene = _run(predictor, context, request.num_samples)
    num_recorded = min(request.num_future, len(recording.frames) - end)
    actual = clip.frames[:0]
    if num_recorded:
        actual = windows.cut(recording, end, num_recorded, size_px).frames
    return Predicted(request, predictor, camera, context, first, prediction, scene, actual)


def off_axis_deg(
    motion: Motion,
    max_turn_deg_s: float = 7.0,
    lever_arm_m: float = 2.0,  # of a camera in front of a car's rear axle
    assumed_speed_m_s: float = 3.0,  # where lengths are not in metres
) -> float | None:
    """Return the angle between optical axis and direction of travel that turning cannot explain.

    A wrong principal point turns the path by the angle of its offset. A camera in front of the rear
    axle also moves sideways in turns, by yaw rate times lever arm. None if the camera never moved.
    """
    past, durations_s = motion.past, np.diff(motion.past.times_s)
    steps = se3.inverse(past.world_from_cam[:-1]) @ past.world_from_cam[1:]
    turn_rates = se3.rotation_angle_rad(steps) / durations_s
    is_usable = motion.tracked[1:] & (turn_rates < np.radians(max_turn_deg_s))
    offsets = steps[is_usable, :3, 3]
    right, down, ahead = offsets.sum(axis=0)
    if right == down == ahead == 0:
        return None
    speed_m_s = assumed_speed_m_s
    if past.is_metric:
        speed_m_s = np.median(np.linalg.norm(offsets, axis=1) / durations_s[is_usable])
    angle_rad = np.arctan2(np.hypot(right, down), abs(ahead))
    angle_rad -= np.arctan2(lever_arm_m * np.median(turn_rates[is_usable]), speed_m_s)
    return float(np.degrees(max(0.0, angle_rad)))


def _open(request: PredictionRequest, num_webcam_frames: int = 45) -> Recording:
    """Open the video, or record from the webcam for long enough to estimate the focal length."""
    path = request.path
    if path.name.isdecimal() and not path.exists():
        recording = webcam.record(int(path.name), max(request.num_past, num_webcam_frames))
    elif path.is_dir() and request.rate_hz is None:
        raise BadData(f"{path} is a folder of images, which have no times: give --fps")
    else:
        spec = {"name": "folder", "path": path, "num_frames": 2}
        spec |= {"intrinsics": (1000.0, 1000.0, 0.0, 0.0)}
        if request.rate_hz is not None:
            spec["frame_rate_hz"] = request.rate_hz
        recording = registry.build("datasets", spec).recording
    return dataclasses.replace(recording, camera_height_m=request.camera_height_m)


def _first(request: PredictionRequest, num_frames: int) -> int:
    """Return the number of the first observed frame."""
    last_possible = num_frames - request.num_past
    first = last_possible if request.first is None else request.first
    if not 0 <= first <= last_possible:
        raise BadData(
            f"{request.path} has {num_frames} frames, of which {request.num_past} must be seen: "
            f"the last possible --first is {last_possible}; or give a smaller --past"
        )
    return first


def _run(
    predictor: FramePredictor, context: Context, num_samples: int
) -> tuple[Prediction, CheckedScene | None]:
    """Return the prediction, and the scene of a geometric predictor."""
    if not isinstance(predictor, GeometricPredictor):
        announce("predicting", 1)
        return predictor.predict(context.only(predictor.needs), num_samples), None
    announce("tracking the camera", 1)
    observed = predictor.observe(context)
    motion = predictor.estimate(observed, num_samples)
    announce("reconstructing", 1)
    scene = predictor.reconstruct(observed, motion.past)
    announce("rendering", 1)
    return show(scene, motion, context), scene


def _score(frames: ByteArray, actual: ByteArray) -> dict[str, list[float]]:
    if not len(actual):
        return {}
    values = evaluate(Prediction(frames[None, : len(actual)]), Target(actual))
    return {name: steps[0].tolist() for name, steps in values.items()}
