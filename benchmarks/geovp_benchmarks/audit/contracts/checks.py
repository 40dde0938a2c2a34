"""Promises of the components of each role, tested on clips of the synthetic street."""

import copy
import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geovp_benchmarks.audit.contracts.outputs import Trial, arrays, equal, require
from geovp_classic import registry
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.errors import Incompatible
from geovp_classic.types import Clip, PrivilegedInput


@dataclass(frozen=True)
class Finding:
    """Result of one promise."""

    name: str
    passed: bool
    detail: str = ""  # the error, or a remark


# Returns a remark as a text, or raises an error if it is broken.
Promise = Callable[[Trial], object]


def check(role: str, component: Any) -> list[Finding]:
    """Test each promise of a component's role; errors that the component raises are findings.

    Executors and scales are described and built again only. Raises UnknownComponent for an unknown
    role.
    """
    registry.names(role)
    drive, stop = (clip(number).split(6, ~PrivilegedInput.NONE)[0] for number in (0, 7))
    trial = Trial(role, component, drive)
    findings = [_test(name, promise, trial) for name, promise in _promises(role)]
    if has_context(role) or role == "forecasters":
        assert drive.past is not None
        unscaled = replace(drive, past=replace(drive.past, is_metric=False))
        variants = {"a stationary camera": stop, "a past of two frames": drive.recent(2)}
        for name, truth in {**variants, "poses without a unit": unscaled}.items():
            varied = replace(trial, truth=truth)
            findings.append(_test(f"accepts or refuses {name}", _runs_or_refuses, varied))
    return findings


@functools.cache
def clip(number: int) -> Clip:
    """Return a clip with all ground truth: 0 drives straight ahead, 7 is stationary."""
    street = Synthetic(
        num_clips=8, num_frames=10, size_px=(128, 128), with_full=True, with_right=True
    )
    return street[number]


def has_context(role: str) -> bool:
    """Return whether the components of a role are given a context."""
    return hasattr(registry.PROTOCOL_OF_ROLE.get(role), "needs") and role != "scales"


def _promises(role: str) -> Iterator[tuple[str, Promise]]:
    """Yield the promises of a role with their names."""
    yield "has the methods of its interface", _has_interface
    yield "is a frozen dataclass", _is_frozen
    yield "can be described and built again", _is_described
    if role not in ("scales", "executors"):
        yield "returns valid outputs", Trial.run
        yield "is deterministic", _is_deterministic
        yield "does not change its input", _keeps_input
    if has_context(role):
        yield "uses only its privileged inputs", _uses_only_its_needs
    if role in ("pose_sources", "forecasters", "predictors"):
        yield (
            "returns the requested number of samples",
            lambda trial: Trial.run(replace(trial, num_samples=3)),
        )
    if role == "renderers":
        yield "renders each view from its own pose and time alone", _views_are_independent


def _test(name: str, promise: Promise, trial: Trial) -> Finding:
    """Return the finding of one promise."""
    try:
        remark = promise(trial)
        return Finding(name, True, remark if isinstance(remark, str) else "")
    except (Exception, SystemExit) as error:  # any error of a plug-in is a finding
        return Finding(name, False, f"{type(error).__name__}: {' '.join(str(error).split())}")


def _has_interface(trial: Trial) -> None:
    """Require the members of the role's protocol."""
    protocol = registry.PROTOCOL_OF_ROLE.get(trial.role, object)  # executors have none
    members = [name for name in dir(protocol) if not name.startswith("_")]
    missing = [name for name in members if not hasattr(trial.component, name)]
    lacks = f"{type(trial.component).__name__} lacks {', '.join(missing)}"
    require(isinstance(trial.component, protocol), lacks)


def _is_frozen(trial: Trial) -> None:
    """Require a frozen dataclass."""
    kind = type(trial.component)
    parameters = getattr(kind, "__dataclass_params__", None)
    is_frozen = getattr(parameters, "frozen", False)
    require(is_frozen, f"{kind.__name__} is not a frozen dataclass: its fields are its settings")


def _is_described(trial: Trial) -> None:
    """Require that the registry builds the same component from its description."""
    table = registry.describe(trial.component)
    rebuilt = registry.describe(registry.build(trial.role, table))
    require(rebuilt == table, f"{table} builds a component that is described as {rebuilt}")


def _is_deterministic(trial: Trial) -> None:
    """Require equal outputs of two runs."""
    same = equal(trial.run(), trial.run())
    require(same, "two runs differ on the same input: give randomness a seed field")


def _keeps_input(trial: Trial) -> None:
    """Require that the arrays of the context stay as they are."""
    before = arrays(copy.deepcopy(trial.truth))
    trial.run(trial.truth)
    for name, array in arrays(trial.truth).items():
        require((array == before[name]).all(), f"it changed its input {name}")


def _uses_only_its_needs(trial: Trial) -> None:
    """Require equal outputs with further inputs."""
    same = equal(trial.run(), trial.run(trial.truth))
    require(same, f"its output depends on more inputs than {trial.component.needs}")


def _views_are_independent(trial: Trial) -> None:
    """Require the same views in another order and alone as of all poses together."""
    truth = trial.truth
    scene = trial.component.reconstruct(truth.only(trial.component.needs), truth.past)
    poses = np.concatenate([truth.past.world_from_cam, truth.future.world_from_cam])
    together = arrays(trial.view(scene, poses, truth.times_s))
    order = np.random.default_rng(0).permutation(len(poses))
    for rows in (order, order[:1]):
        again = arrays(trial.view(scene, poses[rows], truth.times_s[rows]))
        expected = {name: array[rows] for name, array in together.items()}
        same = equal(again, expected)
        require(same, "views change with other poses: each depends on its own pose and time alone")


def _runs_or_refuses(trial: Trial) -> str:
    """Require valid outputs, or the error Incompatible."""
    try:
        trial.run()
    except Incompatible as refusal:
        return f"refuses: {refusal}"
    return ""
