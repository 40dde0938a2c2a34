"""No component sees ground truth that it did not ask for: neither itself nor through its parts."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.contracts import street
from geovp_benchmarks.contracts.exercises import RUN, Trial, same_bytes
from geovp_classic import registry
from geovp_classic.geometry import se3
from geovp_classic.interfaces import Forecaster
from geovp_classic.odometry.recorded import Recorded as RecordedPast
from geovp_classic.pose_sources.chained import Chained
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.pose_sources.planar import Planar
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.given_depth import GivenDepth
from geovp_classic.types import Clip, Context, ExtraView, FloatArray, PrivilegedInput, Trajectory

NUM_PAST = 6
ROLES = (
    "pose_sources",
    "pose_refinements",
    "odometries",
    "depth_sources",
    "renderers",
    "predictors",
)
SHOWN_A_CONTEXT = [(role, name) for role in ROLES for name in registry.names(role)]
FIELD_OF_GRANT = {
    PrivilegedInput.PAST_POSES: "past",
    PrivilegedInput.FUTURE_POSES: "future",
    PrivilegedInput.PAST_DEPTHS: "past_depths",
    PrivilegedInput.CAMERA_HEIGHT: "camera_height_m",
    PrivilegedInput.FULL_FRAMES: "full",
    PrivilegedInput.RIGHT_FRAMES: "right",
}


def ungranted(context: Context, needs: PrivilegedInput) -> list[str]:
    """The fields that hold something although nobody asked for it."""
    return [
        field
        for grant, field in FIELD_OF_GRANT.items()
        if grant not in needs and getattr(context, field) is not None
    ]


def another_truth(clip: Clip, needs: PrivilegedInput) -> Clip:
    """The same observed frames, times and grants; everything else is false."""
    frames = clip.frames.copy()
    frames[NUM_PAST:] = 255 - frames[NUM_PAST:]
    lie = np.zeros((len(clip), 6))
    if PrivilegedInput.PAST_POSES not in needs:
        lie[:NUM_PAST] = np.linspace([0.5, 0, 0, 0, 0.1, 0], [3, 1, 2, 0.5, 0.3, 0.1], NUM_PAST)
    if PrivilegedInput.FUTURE_POSES not in needs:
        lie[NUM_PAST:] = [2, -1, 5, 0.2, 0.7, -0.3]
    depths = clip.depths * np.float32(3)
    if PrivilegedInput.PAST_DEPTHS in needs:
        depths[:NUM_PAST] = clip.depths[:NUM_PAST]
    return dataclasses.replace(
        clip,
        frames=frames,
        trajectory=dataclasses.replace(
            clip.trajectory, world_from_cam=clip.trajectory.world_from_cam @ se3.exp(lie)
        ),
        depths=depths,
        moving=np.ones(clip.depths.shape, dtype=bool),
        camera_height_m=clip.camera_height_m * (1 if PrivilegedInput.CAMERA_HEIGHT in needs else 2),
        full=_false_view(clip.full, granted=PrivilegedInput.FULL_FRAMES in needs),
        right=_false_view(clip.right, granted=PrivilegedInput.RIGHT_FRAMES in needs),
    )


def _false_view(view: ExtraView | None, *, granted: bool) -> ExtraView:
    frames = 255 - view.frames
    if granted:
        frames[:NUM_PAST] = view.frames[:NUM_PAST]
    return dataclasses.replace(view, frames=frames)


class Witness:
    """Stands in for a part, does what it does, and notes what it is shown beyond what the part
    asked for.
    """

    def __init__(self, part: Any, seen: list[tuple[str, list[str]]]) -> None:
        """Note in `seen` the part's class and the fields that it did not ask for, at every call."""
        self.part, self.seen = watched(part, seen), seen

    def __getattr__(self, name: str) -> Any:
        value = getattr(self.part, name)
        if not callable(value):
            return value

        def call(*args: Any, **kwargs: Any) -> Any:
            for argument in (*args, *kwargs.values()):
                if isinstance(argument, Context):
                    self.seen.append(
                        (type(self.part).__name__, ungranted(argument, self.part.needs))
                    )
            return value(*args, **kwargs)

        return call


def watched(component: Any, seen: list[tuple[str, list[str]]]) -> Any:
    """The component with a witness in the place of every part that has needs of its own."""
    parts = {
        field.name: Witness(getattr(component, field.name), seen)
        for field in dataclasses.fields(component)
        if hasattr(getattr(component, field.name), "needs")
    }
    return dataclasses.replace(component, **parts) if parts else component


@pytest.mark.parametrize(("role", "name"), SHOWN_A_CONTEXT, ids=lambda part: part)
class TestEveryRegisteredComponent:
    def test_is_shown_only_what_it_asked_for_and_so_are_its_parts(
        self, role: str, name: str, build_component: Callable[[str, str], Any]
    ) -> None:
        component = build_component(role, name)
        context, _ = street.clip().split(NUM_PAST, component.needs)
        assert ungranted(context, component.needs) == []
        seen: list[tuple[str, list[str]]] = []
        trial = Trial(street.clip(), NUM_PAST)
        RUN[role](watched(component, seen), trial, trial.full_context)
        assert [(part, fields) for part, fields in seen if fields] == []

    def test_gives_the_same_when_all_else_is_false(
        self, role: str, name: str, build_component: Callable[[str, str], Any]
    ) -> None:
        component, clip = build_component(role, name), street.clip()
        trial, lie = Trial(clip, NUM_PAST), another_truth(clip, component.needs)
        shown, shown_lie = (one.split(NUM_PAST, component.needs)[0] for one in (clip, lie))
        assert same_bytes(
            RUN[role](component, trial, shown), RUN[role](component, trial, shown_lie)
        )


def test_a_part_that_is_shown_too_much_is_noticed() -> None:
    """The witness itself is not blind."""

    @dataclasses.dataclass(frozen=True)
    class Careless(GeometricPredictor):
        def estimate(self, context: Context, num_samples: int = 1) -> Any:
            return self.pose_source.estimate(context, num_samples)

    seen: list[tuple[str, list[str]]] = []
    trial = Trial(street.clip(), NUM_PAST)
    RUN["predictors"](
        watched(Careless(GroundTruth(), GivenDepth()), seen), trial, trial.full_context
    )
    assert ("GroundTruth", ["past_depths", "camera_height_m", "full", "right"]) in seen


def test_parts_deep_inside_are_watched() -> None:
    source = Planar(Chained(RecordedPast(), registry.build("forecasters", "hold")))
    seen: list[tuple[str, list[str]]] = []
    trial = Trial(street.clip(), NUM_PAST)
    RUN["predictors"](
        watched(GeometricPredictor(source, GivenDepth()), seen), trial, trial.full_context
    )
    assert [part for part, _ in seen] == ["Planar", "Chained", "RecordedPast", "GivenDepth"]
    assert all(fields == [] for _, fields in seen)


def test_a_forecaster_sees_past_poses_and_future_times_only() -> None:
    calls: list[tuple[Trajectory, FloatArray]] = []

    class Listener:
        def forecast(
            self, past: Trajectory, times_s: FloatArray, num_samples: int = 1
        ) -> FloatArray:
            calls.append((past, times_s))
            hold: Forecaster = registry.build("forecasters", "hold")
            return hold.forecast(past, times_s, num_samples)

    clip = street.clip()
    Chained(RecordedPast(), Listener()).estimate(clip.split(NUM_PAST, ~PrivilegedInput.NONE)[0])
    ((past, times_s),) = calls
    np.testing.assert_array_equal(past.world_from_cam, clip.trajectory.world_from_cam[:NUM_PAST])
    np.testing.assert_array_equal(times_s, clip.times_s[NUM_PAST:])


@pytest.mark.parametrize("grant", list(FIELD_OF_GRANT), ids=lambda grant: grant.name)
def test_every_grant_shows_its_own_field_and_none_of_the_future(grant: PrivilegedInput) -> None:
    clip = street.clip()
    context, _ = clip.split(NUM_PAST, grant)
    for seen in (context, clip.split(NUM_PAST, ~PrivilegedInput.NONE)[0].only(grant)):
        assert [field for field in FIELD_OF_GRANT.values() if getattr(seen, field) is not None] == [
            FIELD_OF_GRANT[grant]
        ]
    assert len(context.frames) == NUM_PAST
    for view in (context.full, context.right):
        assert view is None or len(view.frames) == NUM_PAST
    assert context.past_depths is None or len(context.past_depths) == NUM_PAST
    assert context.past is None or len(context.past) == NUM_PAST


def test_not_even_the_memory_behind_the_context_holds_the_future() -> None:
    """A slice of an array leads back to all of it; what a component is shown does not."""
    clip = street.clip()
    context, _ = clip.split(NUM_PAST, ~PrivilegedInput.NONE)
    for view in (context, context.past, context.full, context.right):
        for value in vars(view).values():
            if isinstance(value, np.ndarray) and value is not context.times_s:
                base = value.base if value.base is not None else value
                assert base.nbytes == value.nbytes


def test_every_grant_is_tested_here() -> None:
    assert set(FIELD_OF_GRANT) == set(PrivilegedInput)
    fields = {field.name for field in dataclasses.fields(Context)}
    assert fields == {"name", "frames", "times_s", "intrinsics", *FIELD_OF_GRANT.values()}


def test_every_interface_that_is_shown_a_context_is_tested_here() -> None:
    with_needs = [
        role for role, protocol in registry.PROTOCOL_OF_ROLE.items() if hasattr(protocol, "needs")
    ]
    assert set(ROLES) == set(with_needs) - {
        "scales"
    }  # a scale is told numbers by its odometry, never a context
