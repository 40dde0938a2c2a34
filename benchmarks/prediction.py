"""Prediction of one clip: from a folder of images or a video to frames, poses, point cloud, strip and video."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from benchmarks import plausibility
from benchmarks.camera import Camera, find_camera, fov_of_focal
from benchmarks.plots import video
from benchmarks.progress import Progress
from geovp_classic import exports, registry
from geovp_classic.data import pose_files, windows
from geovp_classic.data.atomic import atomic_write
from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.interfaces import Scene
from geovp_classic.predictors import GeometricPredictor
from geovp_classic.types import ByteArray, Clip, Context, Motion, Trajectory, Views

NUM_STAGES = 5
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

    path: Path  # a folder of images or a video
    intrinsics: tuple[float, float, float, float] | None = None  # fx, fy, cx, cy of the images as they are stored
    fov_deg: float | None = None  # horizontal, in place of intrinsics
    calibration: Path | None = None  # a file with the intrinsics
    rate_hz: float | None = None
    camera_height_m: float | None = None
    first: int | None = None  # the first observed frame; None: as late as possible
    num_past: int = 10
    num_future: int = 20
    size_px: int = 256
    with_wide: bool = False  # use the whole images, not their middle only

    def predictor(self) -> GeometricPredictor:
        """The best we have: odometry and forecast, refined, and depth fusion; metres where the height gives them."""
        frames = "wide" if self.with_wide else "crop"
        scale = "unit-speed" if self.camera_height_m is None else "ground-plane"
        odometry = {"name": "monocular", "frames": frames, "scale": {"name": scale}}
        refinements = [
            {"name": "registration", "frames": frames},
            "unmeasured-intervals",
            "rotation-drift",
            "nonholonomic",
            {"name": "road-height", "frames": frames},
        ]
        source = {"name": "chained", "odometry": odometry}
        pose_source = registry.build("pose_sources", {"name": "refined", "source": source, "refinements": refinements})
        return GeometricPredictor(pose_source, registry.build("renderers", {"name": "depth-fusion", "frames": frames}))


@dataclass(frozen=True)
class Predicted:
    """One predicted clip."""

    context: Context
    motion: Motion
    views: Views  # [F]
    rerendered: Views  # [P], the scene at the last observed time, rendered at the poses of the observed frames
    first: int  # number of the first observed frame
    camera: Camera
    actual: ByteArray | None  # [F, H, W, 3], the recorded future, where the recording goes on so far

    @cached_property
    def unexplained(self) -> float | None:
        """The share of the observed change that the geometry leaves; None for a camera that stands."""
        return plausibility.unexplained(self.context, self.rerendered)

    @property
    def warnings(self) -> list[str]:
        """A sentence for everything that speaks against the prediction."""
        return [*self.camera.warnings, *plausibility.warnings(self.context, self.motion, self.unexplained)]


def predict(request: PredictionRequest, progress: Progress) -> Predicted:
    """Read, track, forecast, reconstruct and render; BadData names the missing input."""
    recording = _recording(request)
    first = _first(request, len(recording.frames))
    num_seen = first + request.num_past
    camera = find_camera(recording, num_seen, request.path, request.intrinsics, request.fov_deg, request.calibration)
    recording = dataclasses.replace(recording, intrinsics=camera.intrinsics)
    context = _context(request, recording, first)
    progress(1, NUM_STAGES)
    predictor = request.predictor()
    motion = predictor.estimate(context)
    progress(2, NUM_STAGES)
    scene: Scene = predictor.reconstruct(context, motion.past)
    progress(3, NUM_STAGES)
    past_s, future_s = np.split(context.times_s, [context.num_past])
    views = scene.view(motion.futures[0], future_s, context.intrinsics)
    at_once_s = np.full(len(past_s), past_s[-1])  # a cloud shows one instant: what moves leaves no trail in it
    rerendered = scene.view(motion.past.world_from_cam, at_once_s, context.intrinsics)
    progress(4, NUM_STAGES)
    return Predicted(context, motion, views, rerendered, first, camera, _actual(request, recording, first))


def summary(predicted: Predicted) -> list[str]:
    """What the prediction rests on, a line each, and a line for every warning."""
    camera, tracked = predicted.camera, predicted.motion.tracked
    focal_px, width_px = camera.intrinsics.fx_px, camera.intrinsics.width_px
    sure = "" if camera.interval_px is None else " (90 %: {:.0f} to {:.0f})".format(*camera.interval_px)
    unit = "metres" if predicted.motion.past.is_metric else "an unknown unit (give --camera-height)"
    return [
        f"camera: {CAMERA_SOURCES[camera.source]}, focal length {focal_px:.1f} px{sure}, "
        f"{fov_of_focal(focal_px, width_px):.0f} degrees wide",
        f"motion: {int(tracked.sum())} of {len(tracked)} observed frames tracked, lengths in {unit}",
        *(f"warning: {warning}" for warning in predicted.warnings),
    ]


def write(predicted: Predicted, folder: Path) -> list[Path]:
    """Everything, into a folder that appears only when all of it is written; the paths, in order of interest."""
    check_free(folder)
    try:
        with atomic_write(folder) as scratch:
            scratch.mkdir()
            _write_files(predicted, scratch)
    except OSError as error:
        raise BadData(f"--out {folder} cannot be written ({error.strerror}): give another folder") from error
    names = ("strip.png", "film.mp4", "film.gif", "frames", "depths", "poses.kitti.txt", "poses.tum.txt")
    return [folder / name for name in (*names, "cloud.ply", "colmap")]


def check_free(folder: Path) -> None:
    """BadData when the folder holds something already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadData(f"--out {folder} holds something already: give another folder, or remove it")


def _recording(request: PredictionRequest) -> Recording:
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


def _context(request: PredictionRequest, recording: Recording, first: int) -> Context:
    """The observed frames; times to predict go on at the mean rate of these."""
    size_px = (request.size_px, request.size_px)
    clip: Clip = windows.cut(recording, first, request.num_past, size_px, with_wide=request.with_wide)
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


def _actual(request: PredictionRequest, recording: Recording, first: int) -> ByteArray | None:
    begin = first + request.num_past
    if begin + request.num_future > len(recording.frames):
        return None
    return windows.cut(recording, begin, request.num_future, (request.size_px, request.size_px)).frames


def _write_files(predicted: Predicted, folder: Path) -> None:
    context, past = predicted.context, predicted.motion.past
    files = [f"{predicted.first + step:06d}.png" for step in range(len(context.times_s))]  # as in the recording
    names = [f"{'seen' if step < context.num_past else 'frames'}/{file}" for step, file in enumerate(files)]
    _write_images(predicted, folder, names)
    _write_videos(predicted, folder)
    poses = np.concatenate([past.world_from_cam, predicted.motion.futures[0]])
    path = Trajectory(poses, context.times_s, past.is_metric)
    pose_files.write_kitti(folder / "poses.kitti.txt", path)
    pose_files.write_tum(folder / "poses.tum.txt", path)
    points, colours = exports.cloud(predicted.rerendered, past.world_from_cam, context.intrinsics)
    exports.write_ply(folder / "cloud.ply", points, colours)
    exports.write_colmap(folder / "colmap", context.intrinsics, names, poses, points, colours)


def _write_images(predicted: Predicted, folder: Path, names: Sequence[str]) -> None:
    """Observed and predicted frames by name, and depth maps of the predicted ones with their scale."""
    is_metric = predicted.motion.past.is_metric
    scale = exports.depth_scale(predicted.views.depths, is_metric)
    for name in ("seen", "frames", "depths"):
        (folder / name).mkdir()
    for name, frame in zip(names, [*predicted.context.frames, *predicted.views.frames], strict=True):
        _write_png(folder / name, frame)
    for name, depth in zip(names[predicted.context.num_past :], predicted.views.depths, strict=True):
        exports.write_depth(folder / "depths" / Path(name).name, depth, scale)
    unit = "metres" if is_metric else "the unit of the poses, which is not known in metres"
    words = f"depth = value / {scale:.9g}, in {unit}; 0: unknown, 65535: infinitely far or beyond\n"
    (folder / "depths" / "scale.txt").write_text(words)


def _write_videos(predicted: Predicted, folder: Path) -> None:
    horizons = [k for k in video.HORIZONS if k <= len(predicted.views.frames)]
    shown = [k - 1 for k in horizons]
    last = predicted.context.frames[-1]
    rows = [("predicted", [last, *predicted.views.frames[shown]])]
    if predicted.actual is not None:
        rows.append(("real", [last, *predicted.actual[shown]]))
    _write_png(folder / "strip.png", video.strip(rows, ["(last seen)", *(f"+{k}" for k in horizons)]))
    frames = video.side_by_side(predicted.context.frames, predicted.views.frames, predicted.actual)
    rate_hz = 1 / float(np.mean(np.diff(predicted.context.times_s)))
    video.write_mp4(folder / "film.mp4", frames, rate_hz)
    (folder / "film.gif").write_bytes(video.gif(frames, rate_hz))


def _write_png(path: Path, image: ByteArray) -> None:
    path.write_bytes(cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes())
