"""Prediction of one clip: from a folder of images, a video or a webcam to frames, poses and a scene."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import plausibility, webcam
from benchmarks.camera import Camera, find_camera, fov_of_focal
from benchmarks.planning import versions
from benchmarks.progress import Progress
from geovp_classic import registry
from geovp_classic.data import windows
from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.interfaces import FramePredictor, Scene
from geovp_classic.predictors import GeometricPredictor
from geovp_classic.types import ByteArray, Clip, Context, Grant, Prediction, Views

Spec = dict[str, Any] | str

NUM_STAGES = 5
LONGER_SIDE_PX = 640  # of predicted frames, unless a size is given
BASE_BYTES, PLANE_BYTES, FRAME_BYTES = (
    4e8,
    10,
    40,
)  # the latter two a pixel; 1.1 GiB measured at 640x640, 10 + 20 frames
NUM_PLANES, TALL_PX = 96, 320  # of the depth sweep, proportionally more over taller images
OFFERED = Grant.CAMERA_HEIGHT | Grant.WIDE_FRAMES  # what one's own video can grant
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
class PredictionRequest:
    """The input of `predict`."""

    path: Path  # a folder of images, a video, or the number of a webcam
    intrinsics: tuple[float, float, float, float] | None = None  # fx, fy, cx, cy of the images as they are stored
    fov_deg: float | None = None  # horizontal, in place of intrinsics
    calibration: Path | None = None  # a file with the intrinsics
    rate_hz: float | None = None
    camera_height_m: float | None = None
    first: int | None = None  # the first observed frame; None: as late as possible
    num_past: int = 10
    num_future: int = 20
    size_px: tuple[int, int] | int | None = None  # width and height, or a square's side; None: the video's aspect
    with_wide: bool = False  # use the whole images, not their middle only
    pose_source: Spec | None = None  # in place of the best we have, as in a matrix
    renderer: Spec | None = None
    predictor: Spec | None = None  # in place of both
    num_samples: int = 1

    def build(self) -> FramePredictor:
        """The predictor asked for; by default odometry and forecast, refined, and depth fusion."""
        if self.predictor is not None:
            if self.pose_source is not None or self.renderer is not None:
                raise BadData("--predictor takes the place of --pose-source and --renderer: give it alone")
            built: FramePredictor = registry.build("predictors", self.predictor, "--predictor")
            return built
        frames = "wide" if self.with_wide else "crop"
        renderer = self.renderer or {"name": "depth-fusion", "frames": frames}
        pose_source = registry.build("pose_sources", self.pose_source or self._best(frames), "--pose-source")
        return GeometricPredictor(pose_source, registry.build("renderers", renderer, "--renderer"))

    def _best(self, frames: str) -> Spec:
        """Metres where the height gives them."""
        scale = "unit-speed" if self.camera_height_m is None else "ground-plane"
        odometry = {"name": "monocular", "frames": frames, "scale": {"name": scale}}
        refinements = [
            {"name": "registration", "frames": frames},
            "unmeasured-intervals",
            "rotation-drift",
            "nonholonomic",
            {"name": "road-height", "frames": frames},
        ]
        return {"name": "refined", "source": {"name": "chained", "odometry": odometry}, "refinements": refinements}


@dataclass(frozen=True)
class Geometry:
    """What the scene of a geometric predictor shows, for the first sample."""

    views: Views  # [F]
    rerendered: Views  # [P], the scene at the last observed time, rendered at the poses of the observed frames


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

    @cached_property
    def unexplained(self) -> float | None:
        """The share of the observed change that the geometry leaves; None for a camera that stands."""
        return None if self.geometry is None else plausibility.unexplained(self.context, self.geometry.rerendered)

    @cached_property
    def warnings(self) -> list[str]:
        """A sentence for everything that speaks against the prediction."""
        motion = self.prediction.motion
        found = [] if motion is None else plausibility.warnings(self.context, motion, self.unexplained)
        return [*self.camera.warnings, *found]

    @cached_property
    def scores(self) -> dict[str, list[float]]:
        """Per step and metric, the first sample beside the recorded future; without LPIPS where it has no weights."""
        if self.actual is None:
            return {}
        predicted, found = self.prediction.frames[0, : len(self.actual)], {}
        for name in METRICS if os.environ.get("GEOVP_LPIPS_WEIGHTS") else METRICS[:2]:  # it would download them
            with contextlib.suppress(GeovpError):  # images too small for a metric, or torch is missing
                values = registry.build("frame_metrics", name)(predicted, self.actual, None)
                found[name] = [round(float(value), 4) for value in values]
        return found

    def about(self) -> dict[str, Any]:
        """Settings, camera, plausibility and scores, for predict.json."""
        motion, camera, asked = self.prediction.motion, self.camera, dataclasses.asdict(self.request)
        return {
            "settings": {key: str(value) if isinstance(value, Path) else value for key, value in asked.items()},
            "predictor": registry.describe(self.predictor),
            "versions": versions(),
            "camera": dataclasses.asdict(camera),
            "frames": {"first": self.first, "observed": self.context.num_past, "predicted": self.context.num_future},
            "tracked_frames": None if motion is None else int(motion.tracked.sum()),
            "is_metric": motion is not None and motion.past.is_metric,
            "unexplained_change": self.unexplained,
            "off_axis_deg": motion and plausibility.off_axis_deg(motion),
            "warnings": self.warnings,
            "scores": self.scores,
        }

    def summary(self) -> list[str]:
        """What the prediction rests on, a line each, and a line for every warning."""
        camera, motion = self.camera, self.prediction.motion
        focal_px, width_px = camera.intrinsics.fx_px, camera.intrinsics.width_px
        sure = "" if camera.interval_px is None else " (90 %: {:.0f} to {:.0f})".format(*camera.interval_px)
        source, fov_deg = CAMERA_SOURCES[camera.source], fov_of_focal(focal_px, width_px)
        lines = [f"camera: {source}, focal length {focal_px:.1f} px{sure}, {fov_deg:.0f} degrees wide"]
        if motion is not None:
            unit = "metres" if motion.past.is_metric else "an unknown unit (--camera-height gives metres)"
            count = f"{int(motion.tracked.sum())} of {len(motion.tracked)} observed frames tracked"
            lines.append(f"motion: {count}, lengths in {unit}")
        means = [f"{name} {np.mean(values):.3f}" for name, values in self.scores.items()]
        lines += (
            [f"scores: {', '.join(means)}, means over {len(self.actual)} recorded frames"]
            if self.actual is not None
            else []
        )
        return [*lines, *(f"warning: {warning}" for warning in self.warnings)]


def predict(request: PredictionRequest, progress: Progress) -> Predicted:
    """Read, track, forecast, reconstruct and render; BadData names the missing input."""
    predictor = request.build()
    if lacking := predictor.needs & ~OFFERED:
        raise BadData(f"{registry.name_of(predictor)} needs {lacking.name}, which one's own video does not have")
    recording = _recording(request)
    first = _first(request, len(recording.frames))
    size_px = output_size(request.size_px, recording.intrinsics.width_px, recording.intrinsics.height_px)
    check_memory(size_px, request.num_past, request.num_future * request.num_samples)
    camera = find_camera(
        recording,
        first + request.num_past,
        request.path,
        request.intrinsics,
        request.fov_deg,
        request.calibration,
    )
    recording = dataclasses.replace(recording, intrinsics=camera.intrinsics)
    context = _context(request, recording, first, size_px, with_wide=Grant.WIDE_FRAMES in predictor.needs)
    progress(1, NUM_STAGES)
    prediction, geometry = _run(predictor, context, request.num_samples, progress)
    actual = _actual(request, recording, first, size_px)
    return Predicted(request, predictor, context, prediction, geometry, first, camera, actual)


def output_size(asked: tuple[int, int] | int | None, width_px: int, height_px: int) -> tuple[int, int]:
    """Width and height of predicted frames; by default the video's aspect, even and at most LONGER_SIDE_PX long."""
    if isinstance(asked, int):
        return asked, asked
    if asked is not None:
        return asked
    scale = min(1.0, LONGER_SIDE_PX / max(width_px, height_px))
    return max(2, 2 * round(width_px * scale / 2)), max(2, 2 * round(height_px * scale / 2))


def check_memory(size_px: tuple[int, int], num_past: int, num_future: int) -> None:
    """BadData when frames of that size and number will not fit into the memory that is free."""
    width_px, height_px = size_px
    planes = NUM_PLANES * max(1, height_px / TALL_PX)
    needed = BASE_BYTES + width_px * height_px * (PLANE_BYTES * planes + FRAME_BYTES * (num_past + num_future))
    free = plausibility.free_memory_bytes()
    if needed > free:
        raise BadData(
            f"{num_past + num_future} frames of {width_px}x{height_px} take about {needed / 2**30:.1f} GiB of memory, "
            f"{free / 2**30:.1f} GiB are free: give a smaller --size or fewer frames"
        )


def _run(
    predictor: FramePredictor, context: Context, num_samples: int, progress: Progress
) -> tuple[Prediction, Geometry | None]:
    """The prediction, and what its scene shows when it is made with one."""
    if not isinstance(predictor, GeometricPredictor):
        prediction = predictor.predict(context.only(predictor.needs), num_samples)
        progress(4, NUM_STAGES)
        return prediction, None
    motion = predictor.estimate(context, num_samples)
    progress(2, NUM_STAGES)
    scene: Scene = predictor.reconstruct(context, motion.past)
    progress(3, NUM_STAGES)
    past_s, future_s = np.split(context.times_s, [context.num_past])
    samples = [scene.view(future, future_s, context.intrinsics) for future in motion.futures]
    frames, covered = np.stack([each.frames for each in samples]), np.stack([each.covered for each in samples])
    at_once_s = np.full(len(past_s), past_s[-1])  # a cloud shows one instant: what moves leaves no trail in it
    rerendered = scene.view(motion.past.world_from_cam, at_once_s, context.intrinsics)
    progress(4, NUM_STAGES)
    return Prediction(frames, covered, motion), Geometry(samples[0], rerendered)


def _recording(request: PredictionRequest) -> Recording:
    if request.path.name.isdecimal() and not request.path.exists():
        return webcam.record(int(request.path.name), max(request.num_past, webcam.NUM_FRAMES))
    if request.path.is_dir() and request.rate_hz is None:
        raise BadData(f"{request.path} is a folder of images, which do not say when they were taken: give --fps")
    spec = {
        "name": "folder",
        "path": request.path,
        "intrinsics": request.intrinsics or (1.0, 1.0, 0.0, 0.0),  # found later, from the frames
        "frame_rate_hz": request.rate_hz,
        "camera_height_m": request.camera_height_m,
        "num_frames": 2,
    }
    dataset = registry.build("datasets", {key: value for key, value in spec.items() if value is not None})
    recording: Recording = dataset.recording
    return recording


def _first(request: PredictionRequest, count: int) -> int:
    if request.num_past < 2:
        raise BadData("--past 1 shows no motion: give 2 or more, 10 is what the forecast was made for")
    last_possible = count - request.num_past
    if last_possible < 0:
        raise BadData(f"{request.path} has {count} frames, but {request.num_past} must be seen: give fewer with --past")
    first = last_possible if request.first is None else request.first
    if not 0 <= first <= last_possible:
        raise BadData(f"--first {first} and {request.num_past} frames from there: the last possible is {last_possible}")
    return first


def _context(
    request: PredictionRequest, recording: Recording, first: int, size_px: tuple[int, int], *, with_wide: bool
) -> Context:
    """The observed frames; times to predict go on at the mean rate of these."""
    clip: Clip = windows.cut(recording, first, request.num_past, size_px, with_wide=with_wide)
    step_s = float(np.mean(np.diff(clip.times_s)))
    ahead_s = clip.times_s[-1] + step_s * np.arange(1, request.num_future + 1)
    return Context(
        frames=clip.frames,
        times_s=np.concatenate([clip.times_s, ahead_s]),
        intrinsics=clip.intrinsics,
        camera_height_m=clip.camera_height_m,
        wide=clip.wide,
        name=clip.name,
    )


def _actual(request: PredictionRequest, recording: Recording, first: int, size_px: tuple[int, int]) -> ByteArray | None:
    begin = first + request.num_past
    count = min(request.num_future, len(recording.frames) - begin)
    return windows.cut(recording, begin, count, size_px).frames if count > 0 else None
