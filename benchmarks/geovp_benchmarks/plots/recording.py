"""A kept clip as a Rerun recording: frames, cloud, paths and sampled futures on one time line, to
be turned about.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from geovp_benchmarks.results.store import Cell, Results
from geovp_classic import registry
from geovp_classic.data.atomic import atomic_write
from geovp_classic.errors import BadData, MissingExtra
from geovp_classic.geometry import pinhole, se3
from geovp_classic.types import (
    ByteArray,
    Clip,
    FloatArray,
    Motion,
    Prediction,
    PrivilegedInput,
    Trajectory,
)

FARTHEST_M, LEAST_CONFIDENCE, EVERY_PX = 80.0, 0.5, 2  # of the cloud's points
TRUTH, SEEN, CLOUD = (
    [20, 20, 20],
    [150, 150, 150],
    -1.5,
)  # colours; pixels of the screen, which Rerun takes negative
COLOURS = (
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [86, 180, 233],
    [230, 159, 0],
)
JPEG_QUALITY = 90


@dataclass(frozen=True)
class KeptClip:
    """A clip with the predictions that were kept of it, in one world: the true one, or else the
    first row's.
    """

    clip: Clip
    num_past: int
    predictions: dict[str, Prediction]  # by row

    @classmethod
    def read(cls, results: Results, name: str, rows: Sequence[str] = ()) -> Self:
        """All rows or those named; BadData for a clip or a row that was not kept."""
        clips = [clip for clip, _ in results.clips()]
        if name not in clips:
            raise BadData(
                f"no clip {name!r} is kept in {results.root}{registry.nearest(name, clips)}"
            )
        kept = {
            cell.label: cell
            for cell in results.cells()
            if name in dict(results.predictions(cell.name))
        }
        for row in rows:
            if row not in kept:
                raise BadData(
                    f"of clip {name} no method {row!r} is kept{registry.nearest(row, kept)}"
                )
        cells: list[Cell] = [kept[row] for row in rows or kept]
        predictions = {cell.label: results.prediction(cell.name, name) for cell in cells}
        return cls(results.clip(name), int(results.protocol()["num_past"]), predictions)

    @property
    def past(self) -> Trajectory | None:
        """The observed cameras in that world."""
        if self.clip.trajectory is not None:
            return self.clip.trajectory[: self.num_past]
        return next(
            (one.motion.past for one in self.predictions.values() if one.motion is not None), None
        )

    def placed(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """Past [P, 4, 4] and futures [S, F, 4, 4] in that world; a past without metres gets the
        true length.
        """
        past = self.past
        assert past is not None
        last_from_own = se3.inverse(motion.past.world_from_cam[-1])
        found = [last_from_own @ poses for poses in (motion.past.world_from_cam, motion.futures)]
        length, true_length = (
            _length(one) for one in (motion.past.world_from_cam, past.world_from_cam)
        )
        if past.is_metric and not motion.past.is_metric and length > 0:
            for poses in found:
                poses[..., :3, 3] *= true_length / length
        return past.world_from_cam[-1] @ found[0], past.world_from_cam[-1] @ found[1]

    def cloud(self) -> tuple[FloatArray, ByteArray]:
        """Points [N, 3] and colours [N, 3] of the observed frames, by recorded depth or, without
        it, by multiview.
        """
        past, clip, count = self.past, self.clip, self.num_past
        if past is None:
            return np.empty((0, 3)), np.empty((0, 3), np.uint8)
        if clip.depths is not None:
            depths = clip.depths[:count].astype(np.float64)
        else:
            context = clip.split(count, PrivilegedInput.NONE)[0]
            inverse, confidence = registry.build("depth_sources", "multiview").inverse_depths(
                context, past
            )
            known = (inverse > 0) & (confidence > LEAST_CONFIDENCE)
            depths = np.divide(
                1.0, inverse, out=np.zeros_like(inverse, dtype=np.float64), where=known
            )
        farthest = FARTHEST_M if past.is_metric else np.inf
        known = (depths > 0) & np.isfinite(depths) & (depths < farthest)
        known[:, 1::EVERY_PX] = known[:, :, 1::EVERY_PX] = False
        rays = pinhole.rays(clip.intrinsics)
        points = [
            se3.transform(world_from_cam, rays[mask] * depth[mask][:, None])
            for world_from_cam, depth, mask in zip(past.world_from_cam, depths, known, strict=True)
        ]
        return np.concatenate(points), clip.frames[:count][known]


def write(results: Results, name: str, rows: Sequence[str] = (), path: Path | None = None) -> Path:
    """Write the recording and return its file; MissingExtra without Rerun."""
    try:
        import rerun as rr
    except ModuleNotFoundError as error:
        remedy = registry.install_command(registry.EXTRA_OF_MODULE["rerun"])
        raise MissingExtra(f"recordings need rerun, which is not installed: {remedy}") from error
    kept = KeptClip.read(results, name, rows)
    into = path or results.recording(name)
    with atomic_write(into) as scratch:
        recording = rr.RecordingStream("geovp", recording_id=name)
        recording.save(scratch)
        recording.send_blueprint(_views(kept))
        _log_truth(recording, kept)
        for number, (row, prediction) in enumerate(kept.predictions.items()):
            _log_row(recording, kept, row, prediction, COLOURS[number % len(COLOURS)])
        recording.disconnect()  # writes what is left
    return into


def _views(kept: KeptClip) -> Any:
    """The world on the left, images on the right."""
    import rerun as rr
    import rerun.blueprint as rrb

    images = [["seen"], *(["predicted", row] for row in kept.predictions)]
    views = [rrb.Spatial2DView(origin=rr.new_entity_path(path), name=path[-1]) for path in images]
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Spatial3DView(origin="/world"), rrb.Grid(*views)), collapse_panels=True
    )


def _log_truth(recording: Any, kept: KeptClip) -> None:
    import rerun as rr

    clip, count = kept.clip, kept.num_past
    recording.log("world", rr.ViewCoordinates.RDF, static=True)
    points, colours = kept.cloud()
    recording.log("world/cloud", rr.Points3D(points, colors=colours, radii=CLOUD), static=True)
    past = kept.past
    poses = past.world_from_cam if clip.trajectory is None and past is not None else None
    if clip.trajectory is not None:
        poses = clip.trajectory.world_from_cam
        future = rr.LineStrips3D([poses[count - 1 :, :3, 3]], colors=[TRUTH])
        recording.log("world/truth/future", future, static=True)
    if poses is not None:
        recording.log(
            "world/truth/past", rr.LineStrips3D([poses[:count, :3, 3]], colors=[SEEN]), static=True
        )
        recording.log("world/truth/camera", _camera(clip), static=True)
    for step, frame in enumerate(clip.frames):
        _set_time(recording, clip, step)
        recording.log("seen", rr.Image(frame).compress(jpeg_quality=JPEG_QUALITY))
        if poses is not None and step < len(poses):
            recording.log("world/truth/camera", _transform(poses[step]))


def _log_row(
    recording: Any, kept: KeptClip, row: str, prediction: Prediction, colour: list[int]
) -> None:
    """The first sample's images and path, and the paths of all samples where there are several."""
    import rerun as rr

    count, futures, parts = kept.num_past, None, ["world", "rows", row]
    if prediction.motion is not None:
        past, futures = kept.placed(prediction.motion)
        fan = np.concatenate([np.broadcast_to(past[-1], (len(futures), 1, 4, 4)), futures], axis=1)[
            ..., :3, 3
        ]
        strips: dict[str, FloatArray] = {"past": past[None, :, :3, 3], "future": fan[:1]}
        strips |= {"fan": fan} if len(fan) > 1 else {}
        for name, lines in strips.items():
            drawn = rr.LineStrips3D(list(lines), colors=[colour] * len(lines))
            recording.log(rr.new_entity_path([*parts, name]), drawn, static=True)
        recording.log(rr.new_entity_path([*parts, "camera"]), _camera(kept.clip), static=True)
    for step, frame in enumerate(prediction.frames[0]):
        _set_time(recording, kept.clip, count + step)
        image = rr.Image(frame).compress(jpeg_quality=JPEG_QUALITY)
        recording.log(rr.new_entity_path(["predicted", row]), image)
        if futures is not None:
            recording.log(rr.new_entity_path([*parts, "camera"]), _transform(futures[0, step]))


def _camera(clip: Clip) -> Any:
    import rerun as rr

    camera = clip.intrinsics
    size_px = [camera.width_px, camera.height_px]
    return rr.Pinhole(image_from_camera=camera.matrix, resolution=size_px, image_plane_distance=1.0)


def _transform(world_from_cam: FloatArray) -> Any:
    import rerun as rr

    return rr.Transform3D(translation=world_from_cam[:3, 3], mat3x3=world_from_cam[:3, :3])


def _set_time(recording: Any, clip: Clip, step: int) -> None:
    recording.set_time("frame", sequence=step)
    recording.set_time("time", duration=float(clip.times_s[step] - clip.times_s[0]))


def _length(world_from_cam: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(world_from_cam[:, :3, 3], axis=0), axis=1).sum())
