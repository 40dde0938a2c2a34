"""One clip all the way: from a folder of images or a video to predicted frames, poses, cloud, strip and film."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.plots import film
from geovp_classic import exports, registry
from geovp_classic.data import pose_files, windows
from geovp_classic.data.windows import Recording
from geovp_classic.errors import BadData
from geovp_classic.interfaces import Scene
from geovp_classic.predictors import GeometricPredictor
from geovp_classic.types import ByteArray, Clip, Context, Motion, Trajectory, Views

Watch = Callable[[int, int], None]  # (stages done, stages in all)
NUM_STAGES = 5
STRIP_HORIZONS = (1, 5, 10, 15, 20)


@dataclass(frozen=True)
class Wanted:
    """What the user asks for."""

    path: Path  # a folder of images or a video
    intrinsics: tuple[float, float, float, float]  # fx, fy, cx, cy of the images as they are stored
    rate_hz: float | None = None
    camera_height_m: float | None = None
    first: int | None = None  # the first observed frame; None: as late as possible
    num_past: int = 10
    num_future: int = 20
    size_px: int = 256
    with_wide: bool = False  # see the whole images, not their middle only

    def predictor(self) -> GeometricPredictor:
        """The best we have: chained odometry and forecast, depth fusion; metres only where the height gives them."""
        frames = "wide" if self.with_wide else "crop"
        scale = "unit-speed" if self.camera_height_m is None else "ground-plane"
        odometry = {"name": "monocular", "frames": frames, "scale": {"name": scale}}
        pose_source = registry.build("pose_sources", {"name": "chained", "odometry": odometry})
        return GeometricPredictor(pose_source, registry.build("renderers", {"name": "depth-fusion", "frames": frames}))


@dataclass(frozen=True)
class Predicted:
    """One predicted clip."""

    context: Context
    motion: Motion
    views: Views  # [F]
    seen_again: Views  # [P], the scene from where the observed frames were taken
    first: int  # number of the first observed frame
    came: ByteArray | None  # [F, H, W, 3], where the recording goes on so far


def predict(wanted: Wanted, watch: Watch) -> Predicted:
    """Read, track, forecast, reconstruct and show; BadData says what is missing."""
    recording = _recording(wanted)
    first = _first(wanted, len(recording.frames))
    context = _context(wanted, recording, first)
    watch(1, NUM_STAGES)
    predictor = wanted.predictor()
    motion = predictor.estimate(context)
    watch(2, NUM_STAGES)
    scene: Scene = predictor.reconstruct(context, motion.past)
    watch(3, NUM_STAGES)
    past_s, future_s = np.split(context.times_s, [context.num_past])
    views = scene.view(motion.futures[0], future_s, context.intrinsics)
    seen_again = scene.view(motion.past.world_from_cam, past_s, context.intrinsics)
    watch(4, NUM_STAGES)
    return Predicted(context, motion, views, seen_again, first, _came(wanted, recording, first))


def write(predicted: Predicted, folder: Path) -> list[Path]:
    """Everything, into a folder that appears only when all of it is written; the paths, in order of interest."""
    with _whole(folder) as place:
        _write_images(predicted, place)
        _write_film(predicted, place)
        path, camera = _path(predicted), predicted.context.intrinsics
        pose_files.write_kitti(place / "poses.kitti.txt", path)
        pose_files.write_tum(place / "poses.tum.txt", path)
        points, colours = exports.cloud(predicted.seen_again, predicted.motion.past.world_from_cam, camera)
        exports.write_ply(place / "cloud.ply", points, colours)
        names = [f"seen/{n:06d}.png" for n in _numbers(predicted)[: predicted.context.num_past]]
        names += [f"frames/{n:06d}.png" for n in _numbers(predicted)[predicted.context.num_past :]]
        exports.write_colmap(place / "colmap", camera, names, path.world_from_cam, points, colours)
    told = ("strip.png", "film.mp4", "film.gif", "frames", "depths", "poses.kitti.txt", "poses.tum.txt")
    return [folder / name for name in (*told, "cloud.ply", "colmap")]


def check_free(folder: Path) -> None:
    """BadData when the folder holds something already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadData(f"--out {folder} holds something already: give another folder, or remove it")


def _recording(wanted: Wanted) -> Recording:
    if wanted.path.is_dir() and wanted.rate_hz is None:
        raise BadData(f"{wanted.path} is a folder of images, which do not say when they were taken: give --fps")
    spec = {
        "name": "folder",
        "path": wanted.path,
        "intrinsics": wanted.intrinsics,
        "frame_rate_hz": wanted.rate_hz,
        "camera_height_m": wanted.camera_height_m,
        "num_frames": 2,
    }
    dataset = registry.build("datasets", {key: value for key, value in spec.items() if value is not None})
    recording: Recording = dataset.recording
    return recording


def _first(wanted: Wanted, count: int) -> int:
    if wanted.num_past < 2:
        raise BadData("--past 1 shows no motion: give 2 or more, 10 is what the forecast was made for")
    last_possible = count - wanted.num_past
    if last_possible < 0:
        raise BadData(f"{wanted.path} has {count} frames, but {wanted.num_past} must be seen: give fewer with --past")
    first = last_possible if wanted.first is None else wanted.first
    if not 0 <= first <= last_possible:
        raise BadData(f"--first {first} and {wanted.num_past} frames from there: the last possible is {last_possible}")
    return first


def _context(wanted: Wanted, recording: Recording, first: int) -> Context:
    """The observed frames; times to predict go on at the mean rate of these."""
    size_px = (wanted.size_px, wanted.size_px)
    clip: Clip = windows.cut(recording, first, wanted.num_past, size_px, with_wide=wanted.with_wide)
    step_s = float(np.mean(np.diff(clip.times_s)))
    ahead_s = clip.times_s[-1] + step_s * np.arange(1, wanted.num_future + 1)
    return Context(
        frames=clip.frames,
        times_s=np.concatenate([clip.times_s, ahead_s]),
        intrinsics=clip.intrinsics,
        camera_height_m=clip.camera_height_m,
        wide=clip.wide,
        name=clip.name,
    )


def _came(wanted: Wanted, recording: Recording, first: int) -> ByteArray | None:
    begin = first + wanted.num_past
    if begin + wanted.num_future > len(recording.frames):
        return None
    return windows.cut(recording, begin, wanted.num_future, (wanted.size_px, wanted.size_px)).frames


def _numbers(predicted: Predicted) -> range:
    """The numbers of all frames, as they are in the recording."""
    return range(predicted.first, predicted.first + len(predicted.context.times_s))


def _path(predicted: Predicted) -> Trajectory:
    past, future = predicted.motion.past, predicted.motion.futures[0]
    poses = np.concatenate([past.world_from_cam, future])
    return Trajectory(poses, predicted.context.times_s, past.is_metric)


def _write_images(predicted: Predicted, place: Path) -> None:
    """Observed and predicted frames, and the depth of the predicted ones with a word on its scale."""
    numbers, num_past = _numbers(predicted), predicted.context.num_past
    is_metric = predicted.motion.past.is_metric
    scale = exports.depth_scale(predicted.views.depths, is_metric)
    for name in ("seen", "frames", "depths"):
        (place / name).mkdir()
    for number, frame in zip(numbers, predicted.context.frames, strict=False):
        _write_png(place / "seen" / f"{number:06d}.png", frame)
    for step, number in enumerate(numbers[num_past:]):
        _write_png(place / "frames" / f"{number:06d}.png", predicted.views.frames[step])
        exports.write_depth(place / "depths" / f"{number:06d}.png", predicted.views.depths[step], scale)
    unit = "metres" if is_metric else "the unit of the poses, which is not known in metres"
    words = f"depth = value / {scale:.9g}, in {unit}; 0: unknown, 65535: infinitely far or beyond\n"
    (place / "depths" / "scale.txt").write_text(words)


def _write_film(predicted: Predicted, place: Path) -> None:
    horizons = [k for k in STRIP_HORIZONS if k <= len(predicted.views.frames)]
    shown = [k - 1 for k in horizons]
    last = predicted.context.frames[-1]
    rows = [("predicted", [last, *predicted.views.frames[shown]])]
    if predicted.came is not None:
        rows.append(("real", [last, *predicted.came[shown]]))
    _write_png(place / "strip.png", film.strip(rows, ["(last seen)", *(f"+{k}" for k in horizons)]))
    frames = film.film(predicted.context.frames, predicted.views.frames, predicted.came)
    rate_hz = 1 / float(np.mean(np.diff(predicted.context.times_s)))
    film.write_mp4(place / "film.mp4", frames, rate_hz)
    (place / "film.gif").write_bytes(film.gif(frames, rate_hz))


def _write_png(path: Path, image: ByteArray) -> None:
    path.write_bytes(cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes())


@contextmanager
def _whole(folder: Path) -> Iterator[Path]:
    """A scratch folder beside, renamed into place when all went well, removed otherwise."""
    check_free(folder)
    scratch = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        scratch.mkdir(parents=True)
        yield scratch
        if folder.exists():
            folder.rmdir()
        scratch.replace(folder)
    except OSError as error:
        raise BadData(f"--out {folder} cannot be written ({error.strerror}): give another folder") from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
