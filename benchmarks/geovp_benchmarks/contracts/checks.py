"""The promises that every component of a role keeps, each tested on a small rendered street."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geovp_benchmarks.contracts import street
from geovp_benchmarks.contracts.exercises import RUN, Outputs, Trial, require, same_bytes, views
from geovp_classic import registry
from geovp_classic.errors import Incompatible
from geovp_classic.types import Clip, Context, ExtraView, PrivilegedInput, Trajectory

NUM_PAST = 6
FROM_FRAMES = (
    "pose_sources",
    "pose_refinements",
    "odometries",
    "depth_sources",
    "renderers",
    "predictors",
)
SAMPLED = ("pose_sources", "forecasters", "predictors")
FROM_MOTION = (*FROM_FRAMES, "forecasters")
FROM_UNIT = ("pose_refinements", "depth_sources", "renderers")


@dataclass(frozen=True)
class Finding:
    """One promise, and whether it was kept."""

    name: str
    passed: bool
    detail: str = ""  # the error, or a remark


def check(role: str, component: Any, clip: Clip | None = None) -> list[Finding]:
    """Test every promise of a component's role; an error that the component raises is a finding.

    The test clip is a rendered street of 128x128 pixels, or a `clip` with poses, depths and more
    than NUM_PAST frames for components that accept certain sizes only. Executors and scales are
    only described and built again.
    """
    registry.names(role)  # UnknownComponent for a role that does not exist
    trial = Trial(clip or street.clip(), NUM_PAST)
    return [
        _find(name, promise, role, component, trial)
        for name, roles, promise in PROMISES
        if role in roles
    ]


Promise = Callable[
    [str, Any, Trial], str | None
]  # role, component, trial -> a remark; raises when it is broken


def _find(name: str, promise: Promise, role: str, component: Any, trial: Trial) -> Finding:
    try:
        return Finding(name, True, promise(role, component, trial) or "")
    except (Exception, SystemExit) as error:  # whatever a plug-in raises is the finding
        return Finding(name, False, f"{type(error).__name__}: {' '.join(str(error).split())}")


def _run(role: str, component: Any, trial: Trial, context: Context | None = None) -> Outputs:
    """The outputs of the role's exercise; without a context, on what the component needs."""
    return RUN[role](component, trial, _needed(component, trial) if context is None else context)


def _needed(component: Any, trial: Trial) -> Context:
    return trial.full_context.only(getattr(component, "needs", PrivilegedInput.NONE))


def _has_interface(role: str, component: Any, trial: Trial) -> str | None:
    protocol = registry.PROTOCOL_OF_ROLE.get(role)
    if protocol is None:
        return f"{role} have no interface to check"
    wanted = [name for name in dir(protocol) if not name.startswith("_")]
    missing = [name for name in wanted if not hasattr(component, name)]
    require(
        isinstance(component, protocol), f"{type(component).__name__} lacks {', '.join(missing)}"
    )
    if "needs" in wanted:
        require(
            isinstance(component.needs, PrivilegedInput),
            f"needs is {component.needs!r}, expected a PrivilegedInput",
        )
    return None


def _is_frozen(role: str, component: Any, trial: Trial) -> None:
    frozen = getattr(getattr(type(component), "__dataclass_params__", None), "frozen", False)
    require(
        frozen,
        f"{type(component).__name__} is not a frozen dataclass: a component's fields are its "
        "settings",
    )


def _is_described(role: str, component: Any, trial: Trial) -> None:
    table = registry.describe(component)
    again = registry.describe(registry.build(role, table))
    require(again == table, f"{table} builds a component that is described as {again}")


def _returns_valid_outputs(role: str, component: Any, trial: Trial) -> None:
    _run(role, component, trial)


def _is_deterministic(role: str, component: Any, trial: Trial) -> None:
    same = same_bytes(_run(role, component, trial), _run(role, component, trial))
    require(
        same, "the same input gave another output the second time: give randomness a seed field"
    )


def _keeps_input(role: str, component: Any, trial: Trial) -> None:
    shown = (trial.full_context, trial.past, trial.clip)
    before = list(_bytes_of(shown))
    _run(role, component, trial)
    require(before == list(_bytes_of(shown)), "it changed the arrays that it was given")


def _uses_only_its_needs(role: str, component: Any, trial: Trial) -> None:
    needed, full = _run(role, component, trial), _run(role, component, trial, trial.full_context)
    require(
        same_bytes(needed, full), f"its output changes when it is shown more than {component.needs}"
    )


def _returns_samples(role: str, component: Any, trial: Trial) -> None:
    _run(role, component, dataclasses.replace(trial, num_samples=3))


def _views_are_independent(role: str, component: Any, trial: Trial) -> None:
    scene, times_s = (
        component.reconstruct(_needed(component, trial), trial.past),
        trial.clip.times_s,
    )
    poses = np.concatenate([trial.past.world_from_cam, trial.futures])
    first = views(scene, poses, times_s, trial)
    order = np.random.default_rng(0).permutation(len(poses))
    repeated, single = np.full(3, len(poses) - 1), [order[k : k + 1] for k in order]
    for rows, how in (
        (order, "in another order"),
        (repeated, "three times"),
        *((row, "alone") for row in single),
    ):
        again = views(scene, poses[rows], times_s[rows], trial)
        same = same_bytes(again, {name: array[rows] for name, array in first.items()})
        require(
            same,
            f"poses look different when asked {how}: a view depends on its own pose and time alone",
        )


def _shows_last_frame(role: str, component: Any, trial: Trial) -> str:
    """A remark only, because a renderer may be lossy."""
    scene, last = (
        component.reconstruct(_needed(component, trial), trial.past),
        slice(NUM_PAST - 1, NUM_PAST),
    )
    shown = views(scene, trial.past.world_from_cam[-1:], trial.clip.times_s[last], trial)["frames"]
    difference = shown.mean(axis=-1) - trial.clip.frames[last].mean(axis=-1)
    return f"mean absolute grey difference {np.abs(difference).mean():.2f} of 255"


def _accepts(variant: Callable[[Clip], Trial]) -> Promise:
    """The promise to run on a variant of the clip, or to refuse it with Incompatible."""

    def promise(role: str, component: Any, trial: Trial) -> str | None:
        try:
            _run(role, component, variant(trial.clip))
        except Incompatible as refusal:
            return f"refuses: {refusal}"
        return None

    return promise


def _standing(clip: Clip) -> Trial:
    steps = [0] * NUM_PAST + [NUM_PAST - 1] * (len(clip) - NUM_PAST)
    return Trial(_resampled(clip, steps), NUM_PAST)


def _two_frames(clip: Clip) -> Trial:
    return Trial(_resampled(clip, range(NUM_PAST - 2, len(clip))), 2)


def _without_unit(clip: Clip) -> Trial:
    assert clip.trajectory is not None
    unscaled = dataclasses.replace(clip.trajectory, is_metric=False)
    return Trial(dataclasses.replace(clip, trajectory=unscaled), NUM_PAST)


PROMISES: tuple[tuple[str, tuple[str, ...], Promise], ...] = (
    ("has the methods of its interface", registry.ROLES, _has_interface),
    ("is a frozen dataclass", registry.ROLES, _is_frozen),
    ("can be described and built again", registry.ROLES, _is_described),
    ("returns valid outputs", tuple(RUN), _returns_valid_outputs),
    ("is deterministic", tuple(RUN), _is_deterministic),
    ("does not change its input", tuple(RUN), _keeps_input),
    ("uses only what it needs", FROM_FRAMES, _uses_only_its_needs),
    ("returns the number of samples asked for", SAMPLED, _returns_samples),
    ("renders every view from its own pose and time alone", ("renderers",), _views_are_independent),
    (
        "shows the last observed frame from the last observed pose",
        ("renderers",),
        _shows_last_frame,
    ),
    ("accepts or refuses a standing camera", FROM_MOTION, _accepts(_standing)),
    ("accepts or refuses a past of two frames", FROM_MOTION, _accepts(_two_frames)),
    ("accepts or refuses poses without a unit", FROM_UNIT, _accepts(_without_unit)),
)


def _resampled(clip: Clip, steps: Sequence[int]) -> Clip:
    """The clip with the frames, poses and depths of the given steps, at its own last times."""
    chosen, times_s = np.array(steps), clip.times_s[-len(steps) :]

    def pick(value: Any) -> Any:
        if isinstance(value, Trajectory):
            return Trajectory(value.world_from_cam[chosen], times_s, value.is_metric)
        if isinstance(value, ExtraView):
            return dataclasses.replace(value, frames=value.frames[chosen])
        return None if value is None else value[chosen]

    fields = ("frames", "trajectory", "depths", "moving", "full", "right")
    return dataclasses.replace(
        clip, times_s=times_s, **{name: pick(getattr(clip, name)) for name in fields}
    )


def _bytes_of(value: Any) -> Iterator[bytes]:
    """The contents of every array in nested tuples and dataclasses."""
    if isinstance(value, np.ndarray):
        yield value.tobytes()
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from _bytes_of(getattr(value, field.name))
    elif isinstance(value, tuple):
        for item in value:
            yield from _bytes_of(item)
