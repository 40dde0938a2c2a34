"""Every registered component keeps its promises, and the checks find every promise that is broken."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from geovp_benchmarks.contracts import check, street
from geovp_classic import registry
from geovp_classic.errors import Incompatible, MissingExtra, UnknownComponent
from geovp_classic.forecasting.constant import Hold
from geovp_classic.inpainters.blank import Blank
from geovp_classic.metrics.image import Psnr
from geovp_classic.odometry.recorded import Recorded as RecordedPast
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.renderers.given_depth import GivenDepth
from geovp_classic.types import (
    Context,
    FloatArray,
    Intrinsics,
    Motion,
    Prediction,
    PrivilegedInput,
    Trajectory,
    Views,
)

REGISTERED = [(role, name) for role in registry.ROLES for name in registry.names(role)]


@pytest.mark.parametrize(("role", "name"), REGISTERED, ids=lambda part: part)
def test_registered_components_keep_their_promises(
    role: str, name: str, build_component: Callable[[str, str], Any]
) -> None:
    findings = check(role, build_component(role, name))
    missing = [
        finding.detail for finding in findings if finding.detail.startswith(MissingExtra.__name__)
    ]
    if missing:
        pytest.skip(missing[0])
    assert [f"{finding.name}: {finding.detail}" for finding in findings if not finding.passed] == []
    assert len(findings) >= 3


def broken(role: str, component: Any) -> dict[str, str]:
    """The details of the broken promises by name; that a test's class is not registered is left
    out.
    """
    findings = {
        finding.name: finding.detail for finding in check(role, component) if not finding.passed
    }
    assert "not registered" in findings.pop("can be described and built again")
    return findings


@dataclass(frozen=True)
class Thief(GroundTruth):
    """Asks for the past only, and takes the future when it lies about."""

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
class Vandal(CopyLast):
    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        prediction = super().predict(context)
        frames = context.frames.base
        assert isinstance(frames, np.ndarray)
        frames.flags.writeable = True
        frames[0] ^= 1
        return prediction


@dataclass(frozen=True)
class Shrinker(CopyLast):
    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        return Prediction(super().predict(context).frames[:, :, ::2])


@dataclass(frozen=True)
class Fragile(RecordedPast):
    def track(self, context: Context) -> tuple[Trajectory, np.ndarray]:
        if (context.frames[0] == context.frames[-1]).all() or context.num_past < 3:
            raise ZeroDivisionError("no parallax")
        return super().track(context)


@dataclass(frozen=True)
class Choosy(RecordedPast):
    def track(self, context: Context) -> tuple[Trajectory, np.ndarray]:
        if (context.frames[0] == context.frames[-1]).all() or context.num_past < 3:
            raise Incompatible("nothing moves: choose a clip where the camera does")
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
class Forgetful:
    """A refinement that does not keep the motion of the pose source."""

    needs: ClassVar[PrivilegedInput] = PrivilegedInput.NONE

    def refine(self, context: Context, motion: Motion) -> Motion:
        return Motion(motion.past, motion.futures, motion.tracked)


@dataclass(frozen=True)
class Biased(GivenDepth):
    """Its frames are brighter by a number that depends on more than the pose and the time of a
    view.
    """

    by: Literal["number of poses", "row", "previous row", "first call", "nothing"] = "nothing"

    def reconstruct(self, context: Context, past: Trajectory) -> Any:
        scene, by, calls = super().reconstruct(context, past), self.by, []

        class BiasedScene:
            def view(
                self, world_from_cam: FloatArray, times_s: FloatArray, intrinsics: Intrinsics
            ) -> Views:
                views = scene.view(world_from_cam, times_s, intrinsics)
                row = np.arange(len(times_s))
                calls.append(row)
                bias = {
                    "number of poses": np.full(len(row), len(row)),
                    "row": row,
                    "previous row": np.rint(10 * times_s[np.maximum(row - 1, 0)]),
                    "first call": np.full(len(row), len(calls) == 1),
                    "nothing": 0 * row,
                }[by]
                brighter = np.clip(views.frames + bias.astype(int)[:, None, None, None], 0, 255)
                return replace(views, frames=brighter.astype(np.uint8))

        return BiasedScene()


@pytest.mark.parametrize(
    ("role", "component", "promise", "detail"),
    [
        (
            "pose_sources",
            Thief(),
            "uses only what it needs",
            "shown more than PrivilegedInput.PAST_POSES",
        ),
        ("forecasters", Gambler(), "is deterministic", "give randomness a seed field"),
        (
            "forecasters",
            Miser(),
            "returns the number of samples asked for",
            r"shape \(1, 4, 4, 4\), expected \(3, 4, 4, 4\)",
        ),
        (
            "predictors",
            Shrinker(),
            "returns valid outputs",
            r"shape \(1, 4, 64, 128, 3\), expected",
        ),
        (
            "odometries",
            Fragile(),
            "accepts or refuses a standing camera",
            "ZeroDivisionError: no parallax",
        ),
        (
            "odometries",
            Fragile(),
            "accepts or refuses a past of two frames",
            "ZeroDivisionError: no parallax",
        ),
        ("inpainters", Painter(), "returns valid outputs", "covered pixels were changed"),
        (
            "frame_metrics",
            UpsideDown(),
            "returns valid outputs",
            "noise scores as well as the truth",
        ),
        (
            "pose_refinements",
            Forgetful(),
            "returns valid outputs",
            "was not kept: use Motion.refined",
        ),
        (
            "renderers",
            Speechless(),
            "has the methods of its interface",
            "Speechless lacks needs, reconstruct",
        ),
    ],
    ids=lambda part: type(part).__name__ if not isinstance(part, str) else part.split(" ")[0],
)
def test_a_broken_promise_is_found(role: str, component: Any, promise: str, detail: str) -> None:
    found = broken(role, component)
    with pytest.raises(AssertionError, match=detail):
        raise AssertionError(found[promise])


INDEPENDENT = "renders every view from its own pose and time alone"


@pytest.mark.parametrize("by", ["number of poses", "row", "previous row", "first call"])
def test_a_view_that_depends_on_more_than_its_pose_and_time_is_found(by: Any) -> None:
    assert (
        "a view depends on its own pose and time alone"
        in broken("renderers", Biased(by=by))[INDEPENDENT]
    )


def test_a_scene_of_independent_views_keeps_every_promise() -> None:
    assert broken("renderers", Biased(by="nothing")) == {}


def test_how_well_the_last_frame_is_shown_is_a_remark() -> None:
    promise = "shows the last observed frame from the last observed pose"
    (exact,), (wrong,) = (
        [finding for finding in check("renderers", component) if finding.name == promise]
        for component in (GivenDepth(), Biased(by="number of poses"))
    )
    assert exact.passed
    assert exact.detail == "mean absolute grey difference 0.00 of 255"
    assert wrong.passed
    assert (
        wrong.detail == "mean absolute grey difference 1.00 of 255"
    )  # brighter by one, as one pose was asked for


def test_a_plug_in_that_raises_anything_is_a_finding() -> None:
    @dataclass(frozen=True)
    class Quitter(GroundTruth):
        @property
        def needs(self) -> PrivilegedInput:
            raise SystemExit("no licence")

    assert "SystemExit: no licence" in broken("pose_sources", Quitter())["returns valid outputs"]


def test_input_that_was_changed_is_noticed() -> None:
    own = replace(street.clip(), frames=street.clip().frames.copy())
    findings = {finding.name: finding for finding in check("predictors", Vandal(), own)}
    assert not findings["does not change its input"].passed


def test_a_component_that_can_be_changed_is_refused() -> None:
    assert "not a frozen dataclass" in broken("predictors", Soft())["is a frozen dataclass"]


def test_saying_that_a_clip_does_not_suit_is_keeping_the_promise() -> None:
    findings = {finding.name: finding for finding in check("odometries", Choosy())}
    assert findings["accepts or refuses a standing camera"].passed
    assert findings["accepts or refuses a standing camera"].detail.startswith(
        "refuses: nothing moves"
    )


def test_an_unknown_role_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownComponent, match="did you mean 'renderers'"):
        check("renderer", GivenDepth())


def test_the_street_is_what_it_says() -> None:
    """A point of the first frame lies, by its depth and the poses, where the last frame shows the
    same colour.
    """
    clip = street.clip()
    context, target = clip.split(1, ~PrivilegedInput.NONE)
    views = (
        GivenDepth()
        .reconstruct(context, clip.trajectory[:1])
        .view(target.trajectory.world_from_cam, clip.times_s[1:], clip.intrinsics)
    )
    near = views.covered & (clip.depths[1:] < 15)
    error = np.abs(views.frames.astype(float) - target.frames)[near]
    assert near.mean() > 0.2
    assert np.median(error) < 4
    still = street.clip(step_m=0.0)
    assert (still.frames == still.frames[0]).all()
