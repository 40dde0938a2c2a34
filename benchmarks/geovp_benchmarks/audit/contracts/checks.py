"""Promises of the components of each role, tested on a small rendered street."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geovp_benchmarks.audit.contracts import street
from geovp_benchmarks.audit.contracts.exercises import RUN, Trial, equal, require, views
from geovp_classic import registry
from geovp_classic.errors import Incompatible
from geovp_classic.types import Clip, ExtraView, Trajectory


@dataclass(frozen=True)
class Finding:
    """Result of one promise."""

    name: str
    passed: bool
    detail: str = ""  # the error, or a remark


# Returns a remark, or raises an error if it is broken.
Promise = Callable[[Trial], str | None]


def check(role: str, component: Any, clip: Clip | None = None) -> list[Finding]:
    """Test each promise of a component's role; errors that the component raises are findings.

    The test clip is a rendered street of 128x128 pixels, or a `clip` with poses, depths and more
    than six frames for components that accept certain sizes only. Executors and scales are
    described and built again only. Raises UnknownComponent for an unknown role.
    """
    registry.names(role)
    trial = Trial(role, component, clip or street.clip())
    return [_test(name, promise, trial) for name, promise in _promises(role)]


def _promises(role: str) -> Iterator[tuple[str, Promise]]:
    """Yield the promises of a role with their names."""
    protocol = registry.PROTOCOL_OF_ROLE.get(role)
    has_context = role in RUN and hasattr(protocol, "needs")
    has_motion = has_context or role == "forecasters"
    yield "has the methods of its interface", _has_interface
    yield "is a frozen dataclass", _is_frozen
    yield "can be described and built again", _is_described
    if role in RUN:
        yield "returns valid outputs", _returns_valid_outputs
        yield "is deterministic", _is_deterministic
        yield "does not change its input", _keeps_input
    if has_context:
        yield "uses only its privileged inputs", _uses_only_its_needs
    if role in ("pose_sources", "forecasters", "predictors"):
        yield "returns the requested number of samples", _returns_samples
    if role == "renderers":
        yield "renders each view from its own pose and time alone", _views_are_independent
    if has_motion:
        yield "accepts or refuses a stationary camera", _accepts(_stationary)
        yield "accepts or refuses a past of two frames", _accepts(_two_frames)
    if role in ("pose_refinements", "depth_sources", "renderers"):
        yield "accepts or refuses poses without a unit", _accepts(_without_unit)


def _test(name: str, promise: Promise, trial: Trial) -> Finding:
    try:
        return Finding(name, True, promise(trial) or "")
    except (Exception, SystemExit) as error:  # any error of a plug-in is a finding
        return Finding(name, False, f"{type(error).__name__}: {' '.join(str(error).split())}")


def _has_interface(trial: Trial) -> str | None:
    protocol = registry.PROTOCOL_OF_ROLE.get(trial.role)
    if protocol is None:
        return f"{trial.role} have no interface to check"
    members = [name for name in dir(protocol) if not name.startswith("_")]
    missing = [name for name in members if not hasattr(trial.component, name)]
    lacks = f"{type(trial.component).__name__} lacks {', '.join(missing)}"
    require(isinstance(trial.component, protocol), lacks)
    return None


def _is_frozen(trial: Trial) -> None:
    parameters = getattr(trial.component, "__dataclass_params__", None)
    require(
        getattr(parameters, "frozen", False),
        f"{type(trial.component).__name__} is not a frozen dataclass: its fields are its settings",
    )


def _is_described(trial: Trial) -> None:
    table = registry.describe(trial.component)
    rebuilt = registry.describe(registry.build(trial.role, table))
    require(rebuilt == table, f"{table} builds a component that is described as {rebuilt}")


def _returns_valid_outputs(trial: Trial) -> None:
    trial.run()


def _is_deterministic(trial: Trial) -> None:
    same = equal(trial.run(), trial.run())
    require(same, "two runs differ on the same input: give randomness a seed field")


def _keeps_input(trial: Trial) -> None:
    context = trial.full_context
    owners = (context, context.full, context.right, trial.past, trial.clip)
    values = [value for owner in owners if owner for value in vars(owner).values()]
    inputs = [value for value in values if isinstance(value, np.ndarray)]
    before = [array.copy() for array in inputs]
    trial.run()
    for array, copied in zip(inputs, before, strict=True):
        require((array == copied).all(), "it changed its input arrays")


def _uses_only_its_needs(trial: Trial) -> None:
    same = equal(trial.run(), trial.run(trial.full_context))
    require(same, f"its output depends on more inputs than {trial.component.needs}")


def _returns_samples(trial: Trial) -> None:
    dataclasses.replace(trial, num_samples=3).run()


def _views_are_independent(trial: Trial) -> None:
    context = trial.full_context.only(trial.component.needs)
    scene = trial.component.reconstruct(context, trial.past)
    times_s = trial.clip.times_s
    poses = trial.trajectory.world_from_cam
    together = views(scene, poses, times_s, trial)
    order = np.random.default_rng(0).permutation(len(poses))
    repeated = np.full(3, len(poses) - 1)
    alone = np.split(order, len(order))
    for rows in (order, repeated, *alone):
        again = views(scene, poses[rows], times_s[rows], trial)
        expected = {name: array[rows] for name, array in together.items()}
        require(
            equal(again, expected),
            f"views change if only poses {rows.tolist()} are requested: "
            "a view depends on its own pose and time alone",
        )


def _accepts(vary: Callable[[Trial], Trial]) -> Promise:
    """Return the promise to run on a variant of the clip, or to refuse it with Incompatible."""

    def promise(trial: Trial) -> str | None:
        try:
            vary(trial).run()
        except Incompatible as refusal:
            return f"refuses: {refusal}"
        return None

    return promise


def _stationary(trial: Trial) -> Trial:
    last = trial.num_past - 1
    steps = [0] * trial.num_past + [last] * len(trial.frames)
    return dataclasses.replace(trial, clip=_resample(trial.clip, steps))


def _two_frames(trial: Trial) -> Trial:
    steps = range(trial.num_past - 2, len(trial.clip))
    return dataclasses.replace(trial, clip=_resample(trial.clip, steps), num_past=2)


def _without_unit(trial: Trial) -> Trial:
    unscaled = dataclasses.replace(trial.trajectory, is_metric=False)
    clip = dataclasses.replace(trial.clip, trajectory=unscaled)
    return dataclasses.replace(trial, clip=clip)


def _resample(clip: Clip, steps: Sequence[int]) -> Clip:
    """Return the clip with the frames, poses and depths of some steps, at its last times."""
    rows = np.array(steps)
    times_s = clip.times_s[-len(rows) :]
    fields: dict[str, Any] = {"times_s": times_s}
    for name in ("frames", "trajectory", "depths", "moving", "full", "right"):
        value = getattr(clip, name)
        if isinstance(value, Trajectory):
            value = Trajectory(value.world_from_cam[rows], times_s, value.is_metric)
        elif isinstance(value, ExtraView):
            value = dataclasses.replace(value, frames=value.frames[rows])
        elif value is not None:
            value = value[rows]
        fields[name] = value
    return dataclasses.replace(clip, **fields)
