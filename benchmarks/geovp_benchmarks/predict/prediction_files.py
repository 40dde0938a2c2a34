"""The files of a prediction: frames, depth maps, poses, cloud, strip, films, and predict.json."""

import importlib.util
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geovp_benchmarks.plots import video
from geovp_benchmarks.predict import exports
from geovp_benchmarks.predict.predicted import Predicted
from geovp_classic.data import pose_files
from geovp_classic.data.atomic import atomic_write
from geovp_classic.errors import BadData
from geovp_classic.types import Trajectory


def write(predicted: Predicted, folder: Path) -> list[Path]:
    """Write all files and return their paths in order of interest.

    The folder appears only when it is complete. BadData if it cannot be written.
    """
    check_free(folder)
    try:
        with atomic_write(folder) as scratch:
            scratch.mkdir()
            _write_files(predicted, scratch)
    except OSError as error:
        raise BadData(
            f"--out {folder} cannot be written ({error.strerror}): give another folder"
        ) from error
    names = "strip.png film.mp4 film.gif predict.json frames samples depths poses.kitti.txt"
    paths = [folder / name for name in f"{names} poses.tum.txt cloud.ply colmap".split()]
    return [path for path in paths if path.exists()]


def check_free(folder: Path) -> None:
    """Raise BadData if the folder is not empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadData(f"--out {folder} holds something already: give another folder, or remove it")


def _write_files(predicted: Predicted, folder: Path) -> None:
    context = predicted.context
    numbers = range(predicted.first, predicted.first + len(context.times_s))
    names = [f"{number:06d}.png" for number in numbers]  # as in the recording
    observed, future = names[: context.num_past], names[context.num_past :]
    for name, frame in zip(observed, context.frames, strict=True):
        exports.write_png(folder / "seen" / name, frame)
    for sample, frames in enumerate(predicted.prediction.frames):
        images = folder / "samples" / f"{sample:03d}" if sample else folder / "frames"
        for name, frame in zip(future, frames, strict=True):
            exports.write_png(images / name, frame)
    _write_videos(predicted, folder)
    _write_poses(predicted, folder)
    _write_scene(predicted, folder, names)
    (folder / "predict.json").write_text(json.dumps(predicted.about(), indent=2) + "\n")


def _write_videos(predicted: Predicted, folder: Path) -> None:
    frames, actual = predicted.prediction.frames[0], predicted.actual
    observed, times_s = predicted.context.frames, predicted.context.times_s
    exports.write_png(folder / "strip.png", video.strip(observed[-1], frames, actual))
    film = video.side_by_side(observed, frames, actual)
    rate_hz = 1 / float(np.mean(np.diff(times_s)))
    if importlib.util.find_spec("av"):  # an extra; the gif shows the same
        video.write_mp4(folder / "film.mp4", film, rate_hz)
    (folder / "film.gif").write_bytes(video.gif(film, rate_hz))


def _write_poses(predicted: Predicted, folder: Path) -> None:
    """Write the observed and future path of each sample."""
    motion = predicted.prediction.motion
    if motion is None:
        return
    past = motion.past
    for sample, future in enumerate(motion.futures):
        poses = np.concatenate([past.world_from_cam, future])
        path = Trajectory(poses, predicted.context.times_s, past.is_metric)
        target = folder / "samples" / f"{sample:03d}" if sample else folder
        pose_files.write_kitti(target / "poses.kitti.txt", path)
        pose_files.write_tum(target / "poses.tum.txt", path)


def _write_scene(predicted: Predicted, folder: Path, names: Sequence[str]) -> None:
    """Write the depth maps with their scale, the cloud and the COLMAP model of the first sample."""
    motion, context, geometry = predicted.prediction.motion, predicted.context, predicted.geometry
    if motion is None or geometry is None:
        return
    past, depths = motion.past, geometry.views.depths
    scale = exports.depth_scale(depths, past.is_metric)
    (folder / "depths").mkdir()
    for name, depth in zip(names[context.num_past :], depths, strict=True):
        exports.write_depth(folder / "depths" / name, depth, scale)
    unit = "metres" if past.is_metric else "the unit of the poses, which is not known in metres"
    text = f"depth = value / {scale:.9g}, in {unit}; 0: unknown, 65535: infinitely far or beyond\n"
    (folder / "depths" / "scale.txt").write_text(text)
    views = geometry.rerendered
    points, colours = exports.cloud(views, past.world_from_cam, context.intrinsics)
    if len(points):
        exports.write_ply(folder / "cloud.ply", points, colours)
    frames = np.concatenate([context.frames, predicted.prediction.frames[0]])
    poses = np.concatenate([past.world_from_cam, motion.futures[0]])
    exports.write_colmap(
        folder / "colmap",
        context.intrinsics,
        dict(zip(names, frames, strict=True)),
        poses,
        points,
        colours,
        np.where(views.covered, views.depths, 0.0),
    )
