"""The promises that every component of a role keeps, each tried on a small drawn street."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geovp_classic import registry
from geovp_classic.contracts import street
from geovp_classic.contracts.exercises import RUN, Outputs, Trial, demand, same_bytes
from geovp_classic.errors import Incompatible, UnknownComponent
from geovp_classic.registry import nearest
from geovp_classic.types import Clip, Context, Grant

NUM_PAST = 6
FROM_FRAMES = ("pose_sources", "pose_refinements", "odometries", "depth_sources", "renderers", "predictors")
SAMPLED = ("pose_sources", "forecasters", "predictors")
FROM_MOTION = (*FROM_FRAMES, "forecasters")
FROM_UNIT = ("pose_refinements", "depth_sources", "renderers")


@dataclass(frozen=True)
class Finding:
    """One promise, and whether it was kept."""

    name: str
    passed: bool
    detail: str = ""  # what went wrong, or a remark


def check(role: str, component: Any, clip: Clip | None = None) -> list[Finding]:
    """What a component keeps of its role's promises and what it breaks; nothing that it does is raised.

    It is tried on a drawn street of 128x128 pixels, or on a `clip` with poses, depths and more than NUM_PAST frames,
    for components that work on certain sizes only. Executors and scales are only described and built again.
    """
    if role not in registry.ROLES:
        raise UnknownComponent(f"there is no role {role!r}{nearest(role, registry.ROLES)}")
    trial = Trial(clip or street.clip(), NUM_PAST)
    return [_find(name, promise, role, component, trial) for name, roles, promise in PROMISES if role in roles]


Promise = Callable[[str, Any, Trial], str]  # role, component, trial -> a remark; raises when it is broken


def _find(name: str, promise: Promise, role: str, component: Any, trial: Trial) -> Finding:
    try:
        return Finding(name, True, promise(role, component, trial))
    except Exception as error:  # whatever a plug-in raises is the finding
        return Finding(name, False, f"{type(error).__name__}: {' '.join(str(error).split())}")


def _run(role: str, component: Any, trial: Trial, context: Context | None = None) -> Outputs:
    """The role's exercise; without a context, on what the component asked for."""
    if context is None:
        context = trial.everything.only(getattr(component, "needs", Grant.NONE))
    return RUN[role](component, trial, context)


def _fulfils_interface(role: str, component: Any, trial: Trial) -> str:
    protocol = registry.PROTOCOL_OF_ROLE.get(role)
    if protocol is None:
        return f"{role} have no interface to check"
    wanted = [name for name in dir(protocol) if not name.startswith("_")]
    missing = [name for name in wanted if not hasattr(component, name)]
    demand(isinstance(component, protocol), f"{type(component).__name__} lacks {', '.join(missing)}")
    if "needs" in wanted:
        demand(isinstance(component.needs, Grant), f"needs is {component.needs!r}, expected a Grant")
    return ""


def _is_frozen(role: str, component: Any, trial: Trial) -> str:
    frozen = getattr(getattr(type(component), "__dataclass_params__", None), "frozen", False)
    demand(frozen, f"{type(component).__name__} is not a frozen dataclass: a component's fields are its settings")
    return ""


def _is_described(role: str, component: Any, trial: Trial) -> str:
    table = registry.describe(component)
    again = registry.describe(registry.build(role, table))
    demand(again == table, f"{table} builds a component that is described as {again}")
    return ""


def _keeps_shapes(role: str, component: Any, trial: Trial) -> str:
    _run(role, component, trial)
    return ""


def _repeats_itself(role: str, component: Any, trial: Trial) -> str:
    first, second = _run(role, component, trial), _run(role, component, trial)
    demand(
        same_bytes(first, second), "the same input gave something else the second time: give randomness a seed field"
    )
    return ""


def _leaves_input(role: str, component: Any, trial: Trial) -> str:
    before = _all_bytes(trial)
    _run(role, component, trial)
    demand(before == _all_bytes(trial), "it changed the arrays that it was given")
    return ""


def _uses_what_it_asked_for(role: str, component: Any, trial: Trial) -> str:
    asked, shown_all = _run(role, component, trial), _run(role, component, trial, trial.everything)
    demand(same_bytes(asked, shown_all), f"it gives something else when shown more than {component.needs}")
    return ""


def _gives_samples(role: str, component: Any, trial: Trial) -> str:
    _run(role, component, dataclasses.replace(trial, num_samples=3))
    return ""


def _bears_standstill(role: str, component: Any, trial: Trial) -> str:
    still = [0] * NUM_PAST + [NUM_PAST - 1] * (len(trial.clip) - NUM_PAST)
    return _refuses_or_bears(role, component, Trial(_showing(trial.clip, still), NUM_PAST))


def _bears_two_frames(role: str, component: Any, trial: Trial) -> str:
    return _refuses_or_bears(role, component, Trial(_showing(trial.clip, range(NUM_PAST - 2, len(trial.clip))), 2))


def _bears_no_unit(role: str, component: Any, trial: Trial) -> str:
    assert trial.clip.trajectory is not None
    free = dataclasses.replace(trial.clip.trajectory, is_metric=False)
    return _refuses_or_bears(role, component, Trial(dataclasses.replace(trial.clip, trajectory=free), NUM_PAST))


PROMISES: tuple[tuple[str, tuple[str, ...], Promise], ...] = (
    ("fulfils its interface", registry.ROLES, _fulfils_interface),
    ("is a frozen dataclass", registry.ROLES, _is_frozen),
    ("can be described and built again", registry.ROLES, _is_described),
    ("gives what its interface promises", tuple(RUN), _keeps_shapes),
    ("gives the same bytes again", tuple(RUN), _repeats_itself),
    ("leaves what it is given alone", tuple(RUN), _leaves_input),
    ("uses nothing that it did not ask for", FROM_FRAMES, _uses_what_it_asked_for),
    ("gives as many samples as asked for", SAMPLED, _gives_samples),
    ("bears a camera that stands still", FROM_MOTION, _bears_standstill),
    ("bears a past of two frames", FROM_MOTION, _bears_two_frames),
    ("bears or refuses poses without a unit", FROM_UNIT, _bears_no_unit),
)


def _refuses_or_bears(role: str, component: Any, trial: Trial) -> str:
    """Incompatible is an answer as well."""
    try:
        _run(role, component, trial)
    except Incompatible as refusal:
        return f"refuses: {refusal}"
    return ""


def _showing(clip: Clip, steps: Sequence[int]) -> Clip:
    """The clip with the frames and poses of other steps, at its own last times."""
    chosen = np.array(steps)
    times_s = clip.times_s[-len(steps) :]
    assert clip.trajectory is not None
    return dataclasses.replace(
        clip,
        frames=clip.frames[chosen],
        times_s=times_s,
        trajectory=dataclasses.replace(
            clip.trajectory, world_from_cam=clip.trajectory.world_from_cam[chosen], times_s=times_s
        ),
        depths=None if clip.depths is None else clip.depths[chosen],
        moving=None if clip.moving is None else clip.moving[chosen],
        wide=None if clip.wide is None else dataclasses.replace(clip.wide, frames=clip.wide.frames[chosen]),
        right=None if clip.right is None else dataclasses.replace(clip.right, frames=clip.right.frames[chosen]),
    )


def _all_bytes(trial: Trial) -> list[bytes]:
    """Of everything that a component is shown."""
    context, past, target = trial.everything, trial.past, trial.frames
    views = [view.frames for view in (context.wide, context.right) if view is not None]
    arrays = [context.frames, context.times_s, context.past_depths, past.world_from_cam, past.times_s, target, *views]
    arrays += [each.world_from_cam for each in (context.past, context.future) if each is not None]
    return [array.tobytes() for array in arrays if array is not None]
