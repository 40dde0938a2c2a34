"""Error budget of a method, and sensitivity of its renderer to errors of the poses."""

import numpy as np

from geovp_benchmarks.evaluation.oracles import STAGES, OracleClip, Oracles, with_true_depth
from geovp_benchmarks.evaluation.variants import ChangeTable, Method, Predict, score
from geovp_benchmarks.progress import Progress, tracked
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.pose_sources.registered import Registered
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


def error_budget(method: Method, progress: Progress) -> ChangeTable:
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
        tracked(method.clips(), method.num_clips, progress),
        method.metrics.values(),
        {variant for pair in pairs.values() for variant in pair},
        lambda clip: (
            OracleClip(method.predictor, clip, method.matrix.num_past, method.steps).frames
        ),
    )
    changes: dict[str, dict[str, FloatArray]] = {stage: {} for stage in stages}
    for (stage, column), (before, after) in pairs.items():
        changes[stage][column] = scores.values[after] - scores.values[before]
    levels = {"forecast": scores.values[nothing], "truth": scores.values[everything]}
    notes = [f"{stage} is not measured: it needs {needed}" for stage, needed in missing.items()]
    notes += scores.reasons
    return ChangeTable(method.title, method.metrics, scores.sequences, levels, changes, notes)


def pose_sensitivity(
    method: Method,
    progress: Progress,
    angles_deg: tuple[float, ...] = (0.1, 0.2, 0.5, 1.0, 2.0),
    shifts_m: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.5),
) -> ChangeTable:
    """Return the changes of all metrics by offset; raise Incompatible without metric poses."""
    exact = ("yaw", 0.0)
    sizes = {axis: (shifts_m if axis in "xyz" else angles_deg) for axis in AXES}
    offsets = [(axis, size) for axis in AXES for size in sizes[axis]]
    scores = score(
        tracked(method.clips(), method.num_clips, progress),
        method.metrics.values(),
        [exact, *offsets, *((axis, -size) for axis, size in offsets)],
        lambda clip: viewed_from_offsets(method, clip),
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
    levels = {"no offset": scores.values[exact]}
    return ChangeTable(
        method.title, method.metrics, scores.sequences, levels, changes, scores.reasons
    )


def viewed_from_offsets(method: Method, clip: Clip) -> Predict[Offset]:
    """Return the function that predicts a clip from offset poses."""
    renderer = method.predictor.renderer
    truth = Registered()
    context, target = clip.split(method.matrix.num_past, truth.needs | renderer.needs)
    motion = truth.estimate(context.only(truth.needs))
    if not motion.past.is_metric:
        raise Incompatible(f"{clip.name} has no metric poses: offsets are in metres")
    scene = renderer.reconstruct(context.only(renderer.needs), motion.past)
    steps = np.array(method.steps)
    times_s = context.times_s[context.num_past + steps]

    def view(offset: Offset) -> tuple[ByteArray, ByteArray]:
        poses = motion.futures[0, steps] @ cam_from_offset(offset)
        return scene.view(poses, times_s, context.intrinsics).frames, target.frames[steps]

    return view


def cam_from_offset(offset: Offset) -> FloatArray:
    """Return the pose [4, 4] of the offset camera in the frame of the exact one."""
    axis, size = offset
    twist = np.zeros(6)
    twist[AXES.index(axis)] = size if axis in "xyz" else np.deg2rad(size)
    return se3.exp(twist)
