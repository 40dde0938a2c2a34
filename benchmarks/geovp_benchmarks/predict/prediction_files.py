"""The files of a prediction: frames, depth maps, poses, cloud, strip, films, and predict.json."""

import importlib.util
import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from geovp_benchmarks.plots import video
from geovp_benchmarks.predict import exports
from geovp_benchmarks.predict.predicted import Predicted
from geovp_classic.data import pose_files
from geovp_classic.data.atomic import atomic_write
from geovp_classic.errors import BadData
from geovp_classic.types import ByteArray, FloatArray, Trajectory

IN_ORDER = ["strip.png", "film.mp4", "film.gif", "predict.json", "frames", "samples", "depths"]
IN_ORDER += ["poses.kitti.txt", "poses.tum.txt", "cloud.ply", "colmap"]


def write(predicted: Predicted, folder: Path) -> list[Path]:
    """Everything, into a folder that appears only when all of it is written; the paths, in order of
    interest.
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
    return [folder / name for name in IN_ORDER if (folder / name).exists()]


def check_free(folder: Path) -> None:
    """BadData when the folder holds something already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadData(f"--out {folder} holds something already: give another folder, or remove it")


def _write_files(predicted: Predicted, folder: Path) -> None:
    context = predicted.context
    files = [
        f"{predicted.first + step:06d}.png" for step in range(len(context.times_s))
    ]  # as in the recording
    names = [
        f"{'seen' if step < context.num_past else 'frames'}/{file}"
        for step, file in enumerate(files)
    ]
    _write_images(predicted, folder, names)
    _write_videos(predicted, folder)
    _write_geometry(predicted, folder, names)
    (folder / "predict.json").write_text(json.dumps(predicted.about(), indent=2) + "\n")


def _write_images(predicted: Predicted, folder: Path, names: Sequence[str]) -> None:
    """Observed and predicted frames by name; further samples in folders of their own."""
    samples = predicted.prediction.frames
    for name, frame in zip(names, [*predicted.context.frames, *samples[0]], strict=True):
        _write_png(folder / name, frame)
    for number, frames in enumerate(samples[1:], 1):
        for name, frame in zip(names[predicted.context.num_past :], frames, strict=True):
            _write_png(folder / "samples" / f"{number:03d}" / Path(name).name, frame)


def _write_videos(predicted: Predicted, folder: Path) -> None:
    frames = predicted.prediction.frames[0]
    shown = [k - 1 for k in video.HORIZONS if k <= len(frames)]
    last, actual = predicted.context.frames[-1], predicted.actual
    rows = [("predicted", [last, *frames[shown]])]
    if actual is not None:
        rows.append(("real", [last, *actual[[k for k in shown if k < len(actual)]]]))
    _write_png(
        folder / "strip.png", video.strip(rows, ["(last seen)", *(f"+{k + 1}" for k in shown)])
    )
    film = video.side_by_side(predicted.context.frames, frames, actual)
    rate_hz = 1 / float(np.mean(np.diff(predicted.context.times_s)))
    if importlib.util.find_spec("av"):  # an extra; the gif shows the same
        video.write_mp4(folder / "film.mp4", film, rate_hz)
    (folder / "film.gif").write_bytes(video.gif(film, rate_hz))


def _write_geometry(predicted: Predicted, folder: Path, names: Sequence[str]) -> None:
    """Poses where there are some, depth maps with their scale and the cloud where
    there is a scene.
    """
    motion, context, scene = predicted.prediction.motion, predicted.context, predicted.geometry
    if motion is None:
        return
    past = motion.past
    poses = np.concatenate([past.world_from_cam, motion.futures[0]])
    path = Trajectory(poses, context.times_s, past.is_metric)
    pose_files.write_kitti(folder / "poses.kitti.txt", path)
    pose_files.write_tum(folder / "poses.tum.txt", path)
    if scene is None:
        return
    _write_depths(scene.views.depths, past.is_metric, folder / "depths", names[context.num_past :])
    points, colours = exports.cloud(scene.rerendered, past.world_from_cam, context.intrinsics)
    if len(points):
        exports.write_ply(folder / "cloud.ply", points, colours)
    exports.write_colmap(folder / "colmap", context.intrinsics, names, poses, points, colours)


def _write_depths(depths: FloatArray, is_metric: bool, folder: Path, names: Sequence[str]) -> None:
    folder.mkdir()
    scale = exports.depth_scale(depths, is_metric)
    for name, depth in zip(names, depths, strict=True):
        exports.write_depth(folder / Path(name).name, depth, scale)
    unit = "metres" if is_metric else "the unit of the poses, which is not known in metres"
    words = f"depth = value / {scale:.9g}, in {unit}; 0: unknown, 65535: infinitely far or beyond\n"
    (folder / "scale.txt").write_text(words)


def _write_png(path: Path, image: ByteArray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes())
