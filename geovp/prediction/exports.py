"""Output files of a prediction: images, videos, poses, depth maps and COLMAP model."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from geovp.drawing import video
from geovp.drawing.page import Page
from geovp.drawing.strip import draw_strip
from geovp.prediction.colmap_model import build_model
from geovp.prediction.prediction import Predicted
from geovp_classic.atomic import atomic_write
from geovp_classic.data.formats import pose_files
from geovp_classic.errors import BadData
from geovp_classic.predictors.hindcast import ShownScene
from geovp_classic.types import FloatArray, Motion, Trajectory


def check_free(folder: Path) -> None:
    """Raise BadData unless the folder is new or empty, or OSError if it cannot be written."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadData(f"--out {folder} holds something already: give another folder, or remove it")
    with atomic_write(folder) as scratch:
        scratch.mkdir()
    folder.rmdir()


def write(predicted: Predicted, folder: Path) -> list[Path]:
    """Write all files and return their paths; the folder appears only when it is complete."""
    context, prediction = predicted.context, predicted.prediction
    motion, scene = prediction.motion, predicted.scene
    # Numbered as in the recording.
    names = [f"{number:06d}.png" for number in predicted.numbers]
    with atomic_write(folder) as scratch:
        write_images(scratch / "seen", names[: context.num_past], context.frames)
        for sample, frames in enumerate(prediction.frames):
            target = scratch / "samples" / f"{sample:03d}" if sample else scratch
            place = target if sample else scratch / "frames"
            write_images(place, names[context.num_past :], frames)
            if motion is not None:
                poses = np.concatenate([motion.past.world_from_cam, motion.futures[sample]])
                path = Trajectory(poses, context.times_s, motion.past.is_metric)
                pose_files.write_both(target, "poses", path)
        _write_videos(predicted, scratch)
        if motion is not None and scene is not None:
            _write_scene(predicted, scene, motion, names, scratch)
        about = json.dumps(
            predicted.about(),
            indent=2,
            default=lambda x: x.tolist() if hasattr(x, "tolist") else str(x),
        )
        (scratch / "predict.json").write_text(about + "\n")
    return sorted(folder.iterdir())


def write_images(folder: Path, names: Sequence[str], images: npt.NDArray[Any]) -> None:
    """Write RGB images [N, H, W, 3] or depth maps [N, H, W] as PNG.

    Pillow cannot: with pycolmap's copy of zlib in the process, it crashes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if images.ndim == 4:
        images = images[..., ::-1]
    for name, image in zip(names, images, strict=True):
        content = cv2.imencode(".png", np.ascontiguousarray(image))[1]
        (folder / name).write_bytes(content.tobytes())


def write_depths(
    folder: Path,
    names: Sequence[str],
    depths: FloatArray,  # [F, H, W], 0 = unknown
    *,
    is_metric: bool,
) -> None:
    """Write depth maps as 16-bit PNG, and the meaning of their values as scale.txt.

    Metric depths have 256 values per metre, as KITTI's; other depths have their median at 16384.
    """
    scale, unit = 256.0, "metres"
    if not is_metric:
        unit = "the unit of the poses, which is not known in metres"
        if (is_surface := np.isfinite(depths) & (depths > 0)).any():
            scale = 16384 / float(np.median(depths[is_surface]))
    values = np.where(depths > 0, np.clip(np.rint(depths * scale), 1, 65535), 0)
    write_images(folder, names, values.astype(np.uint16))
    text = f"depth = value / {scale:.9g}, in {unit}; 0: unknown, 65535: infinitely far or beyond\n"
    (folder / "scale.txt").write_text(text)


def _write_videos(predicted: Predicted, folder: Path) -> None:
    context, frames = predicted.context, predicted.prediction.frames[0]
    rows = {"predicted": frames, "real": predicted.actual, **predicted.shown}
    if predicted.scene is not None:  # what does not show the scene has an outline
        rows["predicted"] = np.stack([video.outlined(x, predicted.scene.mask) for x in frames])
    recorded = {name: row for name, row in rows.items() if len(row)}
    strip = Page("strip")
    draw_strip(strip, recorded, context.future_s - context.past_s[-1], 8.0)
    strip.write(folder / "strip.png")
    film = video.film(context.frames, frames, predicted.actual)
    rate_hz = 1 / float(np.mean(np.diff(context.times_s)))
    video.write_mp4(folder / "film.mp4", film, rate_hz)
    video.write_gif(folder / "film.gif", film, rate_hz)


def _write_scene(
    predicted: Predicted, scene: ShownScene, motion: Motion, names: Sequence[str], folder: Path
) -> None:
    """Write depth maps, the cloud and the COLMAP model of the first sample."""
    context, past, future = predicted.context, motion.past, motion.futures[0]
    depths = scene.view(future, context.future_s, context.intrinsics).depths
    future_names = names[context.num_past :]
    write_depths(folder / "depths", future_names, depths, is_metric=past.is_metric)
    # At one instant, so that dynamic objects leave no trails.
    now_s = np.full(context.num_past, context.past_s[-1])
    views = scene.scene.view(past.world_from_cam, now_s, context.intrinsics)
    poses = np.concatenate([past.world_from_cam, future])
    model = build_model(context.intrinsics, names, poses, views)
    if model.num_points3D():
        model.export_PLY(folder / "cloud.ply")
    frames = np.concatenate([context.frames, predicted.prediction.frames[0]])
    write_images(folder / "colmap" / "images", names, frames)
    sparse = folder / "colmap" / "sparse" / "0"
    sparse.mkdir(parents=True)
    model.write_binary(str(sparse))
