"""Registered components keep their promises, and the checks find each broken promise."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.checks.contracts import Finding, check
from geovp_classic import registry
from geovp_classic.errors import Incompatible
from geovp_classic.forecasting.constant import Hold
from geovp_classic.inpainters.blank import Blank
from geovp_classic.metrics.image import Psnr
from geovp_classic.odometry.recorded_past import RecordedPast
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.renderers.ground_far_plane import GroundFarPlane
from geovp_classic.types import (
    Context,
    FloatArray,
    Motion,
    Prediction,
    PrivilegedInput,
    Trajectory,
    Views,
)
from tests import registered

REGISTERED = [(role, name) for role in registry.ROLES for name in registered.names(role)]


@pytest.mark.parametrize(("role", "name"), REGISTERED, ids=lambda part: part)
def test_registered_components_keep_their_promises(
    role: str, name: str, build_component: Callable[[str, str], Any]
) -> None:
    findings = check(role, build_component(role, name))
    for finding in findings:
        if finding.detail.startswith("MissingExtra"):
            pytest.skip(finding.detail)
    assert [finding for finding in findings if not finding.passed] == []
    assert len(findings) >= 3


def findings_of(role: str, component: Any) -> dict[str, Finding]:
    return {finding.name: finding for finding in check(role, component)}


def broken(role: str, component: Any) -> dict[str, str]:
    """Return the details of broken promises by name, without that of an unregistered class."""
    findings = findings_of(role, component)
    details = {name: finding.detail for name, finding in findings.items() if not finding.passed}
    assert "not registered" in details.pop("can be described and built again")
    return details


@dataclass(frozen=True)
class Thief(GroundTruth):
    """Declares the past only, and uses the future if it gets it."""

    @property
    def needs(self) -> PrivilegedInput:
        return PrivilegedInput.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        if context.future is not None:
            return super().estimate(context, num_samples)
        futures = np.tile(context.past.world_from_cam[-1], (1, context.num_future, 1, 1))
        return Motion(context.past, futures, np.ones(context.num_past, bool))


@dataclass(frozen=True)
class Gambler(Hold):
    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        futures = super().forecast(past, times_s, num_samples).copy()
        futures[..., 0, 3] += np.random.default_rng().normal()
        return futures


@dataclass(frozen=True)
class Miser(Hold):
    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        return super().forecast(past, times_s)


@dataclass(frozen=True)
class Shrinker(CopyLast):
    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        return Prediction(super().predict(context).frames[:, :, ::2])


@dataclass(frozen=True)
class Fragile(RecordedPast):
    error: type[BaseException] = ZeroDivisionError

    def track(self, context: Context) -> tuple[Trajectory, np.ndarray]:
        world_from_cam = context.past.world_from_cam
        if (world_from_cam[0] == world_from_cam[-1]).all() or context.num_past < 3:
            raise self.error("no parallax")
        return super().track(context)


@dataclass(frozen=True)
class Painter(Blank):
    def inpaint(self, views: Views, last: np.ndarray) -> np.ndarray:
        return np.full_like(views.frames, 128)


@dataclass(frozen=True)
class UpsideDown(Psnr):
    @property
    def higher_is_better(self) -> bool:
        return False


@dataclass
class Soft(CopyLast.__base__):
    needs = PrivilegedInput.NONE
    predict = CopyLast.predict


@dataclass(frozen=True)
class Speechless:
    """Has no method at all."""


@dataclass(frozen=True)
class Altered(GroundFarPlane):
    """A renderer whose views are changed, given their times."""

    change: Callable[[Views, FloatArray], Views] = lambda views, times_s: views

    def reconstruct(self, context: Context, past: Trajectory) -> Any:
        scene, change = super().reconstruct(context, past), self.change
        return SimpleNamespace(
            view=lambda poses, times_s, camera: change(scene.view(poses, times_s, camera), times_s)
        )


def brighter(views: Views, by: FloatArray) -> Views:
    """Add ten grey levels times a number [F]."""
    frames = views.frames + 10.0 * by[:, None, None, None]
    return replace(views, frames=np.clip(frames, 0, 255).astype(np.uint8))


def by_number_of_poses(views: Views, times_s: FloatArray) -> Views:
    return brighter(views, np.full(len(times_s), len(times_s)))


def by_previous_time(views: Views, times_s: FloatArray) -> Views:
    return brighter(views, np.rint(10 * np.append(times_s[:1], times_s[:-1])))


def all_covered(views: Views, times_s: FloatArray) -> Views:
    return replace(views, covered=np.ones_like(views.covered))


def mirrored(views: Views, times_s: FloatArray) -> Views:
    return replace(views, frames=views.frames[:, :, ::-1].copy())


STATIONARY = "accepts or refuses a stationary camera"
TWO_FRAMES = "accepts or refuses a past of two frames"
VALID = "returns valid outputs"
INDEPENDENT = "renders each view from its own pose and time alone"


@pytest.mark.parametrize(
    ("role", "component", "promise", "detail"),
    [
        ("pose_sources", Thief(), "uses only its privileged inputs", "PrivilegedInput.PAST_POSES"),
        ("forecasters", Gambler(), "is deterministic", "give randomness a seed field"),
        ("forecasters", Miser(), "returns the requested number of samples", "(1, 4, 4, 4)"),
        ("predictors", Shrinker(), VALID, "(1, 4, 64, 128, 3)"),
        ("predictors", Soft(), "is a frozen dataclass", "not a frozen dataclass"),
        ("odometries", Fragile(), STATIONARY, "ZeroDivisionError: no parallax"),
        ("odometries", Fragile(error=SystemExit), TWO_FRAMES, "SystemExit: no parallax"),
        ("inpainters", Painter(), VALID, "covered pixels were changed"),
        (
            "frame_metrics",
            UpsideDown(),
            VALID,
            "noise or a stationary camera is better",
        ),
        ("renderers", Speechless(), "has the methods of its interface", "lacks needs, reconstruct"),
        (
            "renderers",
            Altered(change=all_covered),
            "covers nothing behind the first camera",
            "100 % of the view",
        ),
        (
            "renderers",
            Altered(change=mirrored),
            "shows the last frame from its pose",
            "mirror images are as near",
        ),
        (
            "renderers",
            Altered(change=by_number_of_poses),
            INDEPENDENT,
            "its own pose and time alone",
        ),
        ("renderers", Altered(change=by_previous_time), INDEPENDENT, "its own pose and time alone"),
    ],
    ids=lambda part: type(part).__name__ if not isinstance(part, str) else part.split(" ")[0],
)
def test_a_broken_promise_is_found(role: str, component: Any, promise: str, detail: str) -> None:
    assert detail in broken(role, component)[promise]


def test_a_scene_of_independent_views_keeps_all_promises() -> None:
    assert broken("renderers", Altered()) == {}


def test_refusing_a_clip_keeps_the_promise() -> None:
    finding = findings_of("odometries", Fragile(error=Incompatible))[STATIONARY]
    assert finding.passed
    assert finding.detail == "refuses: no parallax"
