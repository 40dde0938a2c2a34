"""Error budget of a method, and sensitivity of its renderer to errors of the poses."""

import numpy as np

from geovp_benchmarks.evaluation.oracles import STAGES, OracleClip, Oracles, with_true_depth
from geovp_benchmarks.evaluation.variants import Method, Predict, change_tables, score
from geovp_benchmarks.progress import Progress
from geovp_benchmarks.tables.table_model import Table
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, Clip, FloatArray

AXES = (
    "x",
    "y",
    "z",
    "pitch",
    "yaw",
    "roll",
)  # of a twist: right, down, forward; up, right, clockwise
Offset = tuple[str, float]  # axis of the future camera; signed metres or degrees


def error_budget(method: Method, progress: Progress) -> list[Table]:
    """Return the changes of all metrics by stage.

    *Alone* replaces one stage of the forecast, *one by one* adds stages from top to bottom, so
    that the changes add up, and *without* removes one stage from the truth.
    """
    clip = method.dataset[0]
    missing = {}
    if with_true_depth(method.predictor.renderer, clip) is None:
        missing["depth"] = "recorded depth or right images (--stereo), and a renderer with a depth"
    if clip.moving is None:
        missing["dynamic objects"] = "masks of dynamic objects, as synthetic clips have"
    stages = [stage for stage in STAGES if stage not in missing]
    nothing: Oracles = frozenset()
    everything = frozenset(stages)
    pairs = {}
    for number, stage in enumerate(stages):
        before = frozenset(stages[:number])
        pairs[stage, "alone"] = nothing, frozenset({stage})
        pairs[stage, "one by one"] = before, before | {stage}
        pairs[stage, "without"] = everything, everything - {stage}
    scores = score(
        method.clips(progress),
        method.metrics,
        {variant for pair in pairs.values() for variant in pair},
        lambda clip: OracleClip(method, clip).frames,
    )
    changes: dict[str, dict[str, FloatArray]] = {stage: {} for stage in stages}
    for (stage, column), (before, after) in pairs.items():
        changes[stage][column] = scores.values[after] - scores.values[before]
    levels = {"forecast": nothing, "truth": everything}
    notes = [f"{stage} is not measured: it needs {needed}" for stage, needed in missing.items()]
    return change_tables(method.title, scores, levels, changes, notes)


def pose_sensitivity(
    method: Method,
    progress: Progress,
    angles_deg: tuple[float, ...] = (0.1, 0.2, 0.5, 1.0, 2.0),
    shifts_m: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.5),
) -> list[Table]:
    """Return the changes of all metrics by offset; raise Incompatible without metric poses."""
    exact = ("yaw", 0.0)
    sizes = {axis: (shifts_m if axis in "xyz" else angles_deg) for axis in AXES}
    offsets = [(axis, size) for axis in AXES for size in sizes[axis]]
    scores = score(
        method.clips(progress),
        method.metrics,
        [exact, *offsets, *((axis, -size) for axis, size in offsets)],
        lambda clip: view_from_offsets(method, clip),
    )
    changes = {}
    for axis, size in offsets:
        negative, positive = (
            scores.values[axis, offset] - scores.values[exact] for offset in (-size, size)
        )
        changes[f"{axis} {size:g} {'m' if axis in 'xyz' else 'deg'}"] = {
            "both signs": (negative + positive) / 2,
            "negative": negative,
            "positive": positive,
        }
    return change_tables(method.title, scores, {"no offset": exact}, changes)


def view_from_offsets(method: Method, clip: Clip) -> Predict[Offset]:
    """Return the function that predicts a clip from offset poses."""
    oracle = OracleClip(method, clip)
    truth = frozenset(STAGES[:8])
    poses = oracle.motion(truth).futures[0, oracle.steps]
    if not oracle.truth.past.is_metric:
        raise Incompatible(f"{clip.name} has no metric poses: offsets are in metres")

    def view(offset: Offset) -> tuple[ByteArray, ByteArray]:
        frames = oracle.render(truth, poses @ cam_from_offset(offset)).frames
        return frames, oracle.target.frames[oracle.steps]

    return view


def cam_from_offset(offset: Offset) -> FloatArray:
    """Return the pose [4, 4] of the offset camera in the frame of the exact one."""
    axis, size = offset
    twist = np.zeros(6)
    twist[AXES.index(axis)] = size if axis in "xyz" else np.deg2rad(size)
    return se3.exp(twist)
