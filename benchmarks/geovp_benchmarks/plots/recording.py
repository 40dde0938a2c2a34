"""A kept clip as a Rerun recording: observed and predicted images and the paths of cameras."""

from pathlib import Path

import numpy as np

from geovp_benchmarks.results.store import Results
from geovp_classic import registry
from geovp_classic.data.atomic import atomic_write
from geovp_classic.errors import MissingExtra
from geovp_classic.geometry import se3


def write(results: Results, name: str) -> Path:
    """Write the recording and return its file; raise BadData for what was not kept."""
    clip, last = results.clip(name), results.protocol()["num_past"] - 1
    images, paths = {"observed": clip.frames}, {}
    world_from_last = np.eye(4)
    if clip.trajectory:
        paths["truth"] = clip.trajectory.world_from_cam[None]
        world_from_last = clip.trajectory.world_from_cam[last]
    for method in results.methods():
        if name not in results.predictions(method.name):
            continue
        prediction = results.prediction(method.name, name)
        images[f"predicted/{method.label}"] = prediction.frames[0]
        if prediction.motion:
            last_from_world = se3.inverse(prediction.motion.past.world_from_cam[-1])
            paths[method.label] = world_from_last @ last_from_world @ prediction.motion.futures
    try:
        import rerun as rr
    except ModuleNotFoundError as error:
        remedy = registry.install_command("viz")
        raise MissingExtra(f"recordings need rerun, which is not installed: {remedy}") from error
    with atomic_write(results.recording(name)) as scratch:
        recording = rr.RecordingStream("geovp", recording_id=name)
        recording.save(scratch)
        for entity, frames in images.items():
            for step, frame in enumerate(frames, len(clip.frames) - len(frames)):
                recording.set_time("time", duration=float(clip.times_s[step] - clip.times_s[0]))
                image = rr.Image(frame).compress()
                recording.log(rr.new_entity_path(entity.split("/", 1)), image)
        for label, poses in paths.items():
            lines = rr.LineStrips3D(list(poses[..., :3, 3]))
            recording.log(rr.new_entity_path(["world", label]), lines, static=True)
        recording.disconnect()  # writes what is left
    return results.recording(name)
