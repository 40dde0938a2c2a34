"""Constant offsets of the true future poses, and what they cost in the images."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from geovp_benchmarks.analysis.intervals import KIND
from geovp_benchmarks.evaluation.budget.poses import TRUTH
from geovp_benchmarks.evaluation.budget.scores import Predict, Scores, Subject, heading, text
from geovp_classic.errors import Incompatible
from geovp_classic.geometry import se3
from geovp_classic.types import ByteArray, Clip, FloatArray

ANGLES_DEG = (0.1, 0.2, 0.5, 1.0, 2.0)
SHIFTS_M = (0.02, 0.05, 0.1, 0.2, 0.5)
TURNS, SHIFTS = ("yaw", "pitch", "roll"), ("x", "y", "z")
SIZES = {**dict.fromkeys(TURNS, ANGLES_DEG), **dict.fromkeys(SHIFTS, SHIFTS_M)}


class Offset(NamedTuple):
    """A constant error along or about one axis."""

    axis: str
    size: float  # degrees or metres, signed


EXACT = Offset("yaw", 0.0)
ALL = [
    EXACT,
    *(
        Offset(axis, sign * size)
        for axis, sizes in SIZES.items()
        for size in sizes
        for sign in (-1, 1)
    ),
]


def cam_from_offset(offset: Offset) -> FloatArray:
    """The camera with the offset in the frame of the one without [4, 4]."""
    twist = np.zeros(
        6
    )  # shift along x, y, z; turn about x, y, z: pitch up, yaw to the right, roll clockwise
    index = ("x", "y", "z", "pitch", "yaw", "roll").index(offset.axis)
    twist[index] = offset.size if offset.axis in SHIFTS else np.deg2rad(offset.size)
    return se3.exp(twist)


def predict(subject: Subject, clip: Clip) -> Predict[Offset]:
    """The frames of one clip, for any offset."""
    renderer, num_past = subject.predictor.renderer, subject.matrix.num_past
    context, target = clip.split(num_past, TRUTH.needs | renderer.needs)
    motion = TRUTH.estimate(context.only(TRUTH.needs))
    if not motion.past.is_metric:
        raise Incompatible(
            f"{clip.name} has poses without a unit: offsets are in metres, choose metric poses"
        )
    scene, steps = (
        renderer.reconstruct(context.only(renderer.needs), motion.past),
        list(subject.steps),
    )
    times_s = context.times_s[num_past:][steps]

    def view(offset: Offset) -> tuple[ByteArray, ByteArray]:
        poses = motion.futures[0, steps] @ cam_from_offset(offset)
        return scene.view(poses, times_s, context.intrinsics).frames, target.frames[steps]

    return view


def table(scores: Scores[Offset]) -> Iterator[str]:
    """What an offset costs, as the mean over both signs."""
    subject = scores.subject
    exact = [f"{name} {scores.level(EXACT, name).mean:.4g}" for name in subject.metrics]
    yield f"renderer of {subject.label}: {subject.about}; without an offset {', '.join(exact)}"
    yield f"{'offset':<28}" + "".join(
        f"{heading(name, metric):>29}" for name, metric in subject.metrics.items()
    )
    for axis, sizes in SIZES.items():
        for size in sizes:
            signs = [Offset(axis, -size), Offset(axis, size)]
            changes = [
                text(scores.change(signs, EXACT, name), metric)
                for name, metric in subject.metrics.items()
            ]
            label = _label(axis, size, subject.first.camera_height_m)
            yield f"{label:<28}" + "".join(f"{cell:>29}" for cell in changes)
    yield f"{KIND}. " * scores.have_intervals + "Means over both signs."


def _label(axis: str, size: float, camera_height_m: float | None) -> str:
    if axis in TURNS:
        return f"{axis} {size:g} deg"
    share = "" if camera_height_m is None else f" ({size / camera_height_m:.0%} of height)"
    return f"{axis} {size:g} m{share}"
