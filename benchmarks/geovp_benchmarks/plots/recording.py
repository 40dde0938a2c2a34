"""A kept clip as a Rerun recording: observed and predicted images and the paths of cameras."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geovp_benchmarks.plots import style
from geovp_benchmarks.results.store import Results
from geovp_classic import registry
from geovp_classic.data.atomic import atomic_write
from geovp_classic.errors import BadData, MissingExtra
from geovp_classic.geometry import se3
from geovp_classic.types import Clip, FloatArray, Prediction


def read(
    results: Results, name: str, methods: Sequence[str] = ()
) -> tuple[Clip, dict[str, Prediction]]:
    """Read a kept clip and its predictions by method; raise BadData for what was not kept."""
    clips = [clip for clip, _ in results.clips()]
    if name not in clips:
        raise BadData(f"no clip {name!r} is kept in {results.root}{registry.nearest(name, clips)}")
    names = {
        method.label: method.name
        for method in results.methods()
        if name in dict(results.predictions(method.name))
    }
    for method in methods:
        if method not in names:
            nearest = registry.nearest(method, names)
            raise BadData(f"of clip {name} no method {method!r} is kept{nearest}")
    predictions = {method: results.prediction(names[method], name) for method in methods or names}
    return results.clip(name), predictions


def write(
    results: Results, name: str, methods: Sequence[str] = (), path: Path | None = None
) -> Path:
    """Write the recording and return its file; raise MissingExtra without Rerun."""
    try:
        import rerun as rr
    except ModuleNotFoundError as error:
        remedy = registry.install_command(registry.EXTRA_OF_MODULE["rerun"])
        raise MissingExtra(f"recordings need rerun, which is not installed: {remedy}") from error
    clip, predictions = read(results, name, methods)
    num_past = int(results.protocol()["num_past"])
    file = path or results.recording(name)
    with atomic_write(file) as scratch:
        recording = rr.RecordingStream("geovp", recording_id=name)
        recording.save(scratch)
        _log_images(recording, clip, ["observed"], clip.frames, 0)
        if clip.trajectory is not None:
            _log_path(recording, ["truth"], clip.trajectory.world_from_cam[None], style.INK)
        lines = style.line_styles([(method, "") for method in predictions])
        for (method, prediction), line in zip(predictions.items(), lines, strict=True):
            _log_images(recording, clip, ["predicted", method], prediction.frames[0], num_past)
            if prediction.motion is not None:
                last = (
                    clip.trajectory.world_from_cam[num_past - 1] if clip.trajectory else np.eye(4)
                )
                last_tracked = prediction.motion.past.world_from_cam[-1]
                futures = last @ se3.inverse(last_tracked) @ prediction.motion.futures
                _log_path(recording, [method], futures, line.colour)
        recording.disconnect()  # writes what is left
    return file


def _log_images(
    recording: Any, clip: Clip, entity: list[str], frames: Any, first_step: int
) -> None:
    import rerun as rr

    for step, frame in enumerate(frames, first_step):
        recording.set_time("frame", sequence=step)
        recording.set_time("time", duration=float(clip.times_s[step] - clip.times_s[0]))
        image = rr.Image(frame).compress(jpeg_quality=90)
        recording.log(rr.new_entity_path(entity), image)


def _log_path(recording: Any, entity: list[str], poses: FloatArray, colour: str) -> None:
    import rerun as rr

    rgb = [int(colour[at : at + 2], 16) for at in (1, 3, 5)]
    paths = rr.LineStrips3D(list(poses[..., :3, 3]), colors=[rgb] * len(poses))
    recording.log(rr.new_entity_path(["world", *entity]), paths, static=True)
