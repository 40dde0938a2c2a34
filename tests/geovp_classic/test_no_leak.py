"""No component sees ground truth beyond its `needs`: neither itself nor its nested components."""

import dataclasses
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
import street

from geovp_benchmarks.checks.contracts import Trial, has_context
from geovp_classic import registry
from geovp_classic.depth.given import Given
from geovp_classic.geometry import se3
from geovp_classic.pose_sources.ground_truth import GroundTruth
from geovp_classic.pose_sources.registered import Registered
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.renderers.depth_fusion import DepthFusion
from geovp_classic.types import Clip, Context, ExtraView, PrivilegedInput
from tests import registered

NUM_PAST = 6
ROLES = [role for role in registry.ROLES if has_context(role)]
COMPONENTS = [(role, name) for role in ROLES for name in registered.names(role)]
FIELD_OF_INPUT = {
    PrivilegedInput.PAST_POSES: "past",
    PrivilegedInput.FUTURE_POSES: "future",
    PrivilegedInput.PAST_DEPTHS: "past_depths",
    PrivilegedInput.CAMERA_HEIGHT: "camera_height_m",
    PrivilegedInput.FULL_FRAMES: "full",
    PrivilegedInput.RIGHT_FRAMES: "right",
    PrivilegedInput.FUTURE_FRAMES: "future_frames",
}
FUTURE_FULL = PrivilegedInput.FUTURE_FRAMES | PrivilegedInput.FULL_FRAMES


def leaked_fields(context: Context, needs: PrivilegedInput) -> list[str]:
    """Return the fields that are set although they are not needed."""
    return [
        field
        for needed, field in (
            *FIELD_OF_INPUT.items(),
            (PrivilegedInput.FULL_FRAMES, "full_observations"),
            (FUTURE_FULL, "future_full"),
        )
        if needed not in needs and getattr(context, field) is not None
    ]


def falsify(clip: Clip, needs: PrivilegedInput) -> Clip:
    """Return the clip with the same observed frames, times and needed inputs, all else false."""
    frames = clip.frames.copy()
    if PrivilegedInput.FUTURE_FRAMES not in needs:
        frames[NUM_PAST:] = 255 - frames[NUM_PAST:]
    error = np.zeros((len(clip), 6))
    if PrivilegedInput.PAST_POSES not in needs:
        error[:NUM_PAST] = np.linspace([0.5, 0, 0, 0, 0.1, 0], [3, 1, 2, 0.5, 0.3, 0.1], NUM_PAST)
    if PrivilegedInput.FUTURE_POSES not in needs:
        error[NUM_PAST:] = [2, -1, 5, 0.2, 0.7, -0.3]
    poses = clip.trajectory.world_from_cam @ se3.exp(error)
    depths = clip.depths * np.float32(3)
    if PrivilegedInput.PAST_DEPTHS in needs:
        depths[:NUM_PAST] = clip.depths[:NUM_PAST]
    return dataclasses.replace(
        clip,
        frames=frames,
        trajectory=dataclasses.replace(clip.trajectory, world_from_cam=poses),
        depths=depths,
        moving=np.ones(clip.depths.shape, dtype=bool),
        camera_height_m=clip.camera_height_m * (1 if PrivilegedInput.CAMERA_HEIGHT in needs else 2),
        full=_falsify_view(
            clip.full, PrivilegedInput.FULL_FRAMES in needs, keep_future=FUTURE_FULL in needs
        ),
        right=_falsify_view(clip.right, PrivilegedInput.RIGHT_FRAMES in needs),
    )


def _falsify_view(view: ExtraView, is_needed: bool, keep_future: bool = False) -> ExtraView:
    frames = 255 - view.frames
    if is_needed:
        frames[:NUM_PAST] = view.frames[:NUM_PAST]
    if keep_future:
        frames[NUM_PAST:] = view.frames[NUM_PAST:]
    return dataclasses.replace(view, frames=frames)


class Witness:
    """Proxy of a component that records each call with fields that the component does not need."""

    def __init__(self, component: Any, calls: list[tuple[str, list[str]]]) -> None:
        """Append the class and the leaked fields of each call to `calls`."""
        self.component = watched(component, calls)
        self.calls = calls

    def __getattr__(self, name: str) -> Any:
        value = getattr(self.component, name)
        if not callable(value):
            return value

        def call(*args: Any, **kwargs: Any) -> Any:
            for argument in (*args, *kwargs.values()):
                if isinstance(argument, Context):
                    leaked = leaked_fields(argument, self.component.needs)
                    self.calls.append((type(self.component).__name__, leaked))
            return value(*args, **kwargs)

        return call


def watched(component: Any, calls: list[tuple[str, list[str]]]) -> Any:
    """Return the component with a witness in place of each nested component with needs."""
    witnesses = {}
    for field in dataclasses.fields(component):
        nested = getattr(component, field.name)
        if hasattr(nested, "needs"):
            witnesses[field.name] = Witness(nested, calls)
    return dataclasses.replace(component, **witnesses) if witnesses else component


def calls_of(role: str, component: Any) -> list[tuple[str, list[str]]]:
    """Run a component on all privileged inputs and return the calls of its nested components."""
    calls: list[tuple[str, list[str]]] = []
    truth, _ = street.clip().split(NUM_PAST, ~PrivilegedInput.NONE)
    Trial(role, watched(component, calls), truth).run(truth)
    return calls


@pytest.mark.parametrize(("role", "name"), COMPONENTS, ids=lambda part: part)
class TestRegisteredComponents:
    def test_nested_components_see_only_their_needs(
        self, role: str, name: str, build_component: Callable[[str, str], Any]
    ) -> None:
        component = build_component(role, name)
        context, _ = street.clip().split(NUM_PAST, component.needs)
        assert leaked_fields(context, component.needs) == []
        assert [call for call in calls_of(role, component) if call[1]] == []

    def test_the_output_does_not_depend_on_hidden_truth(
        self, role: str, name: str, build_component: Callable[[str, str], Any]
    ) -> None:
        component = build_component(role, name)
        clip = street.clip()
        trial = Trial(role, component, clip.split(NUM_PAST, ~PrivilegedInput.NONE)[0])
        context, _ = clip.split(NUM_PAST, component.needs)
        false_context, _ = falsify(clip, component.needs).split(NUM_PAST, component.needs)
        outputs = trial.run(context)
        for name, array in trial.run(false_context).items():
            np.testing.assert_array_equal(outputs[name], array, err_msg=name)


def test_the_witness_notices_a_leak() -> None:
    @dataclasses.dataclass(frozen=True)
    class Careless(GeometricPredictor):
        def predict(self, context: Context, num_samples: int = 1) -> Any:
            self.pose_source.estimate(context)
            return super().predict(context, num_samples)

    calls = calls_of("predictors", Careless(GroundTruth(), DepthFusion(Given())))
    name, fields = calls[0]
    assert (name, fields[:3]) == ("GroundTruth", ["past_depths", "camera_height_m", "full"])


@pytest.mark.parametrize("frames", ["crop", "full"])
def test_future_images_reach_the_pose_source_alone(frames: Literal["crop", "full"]) -> None:
    predictor = GeometricPredictor(Registered(frames), DepthFusion(frames=frames))
    calls = calls_of("predictors", predictor)
    assert [name for name, _ in calls][:2] == ["Registered", "DepthFusion"]
    assert not any({"future_frames", "future_full"}.intersection(fields) for _, fields in calls)

    clip = street.clip()
    observed, false_observed = (
        predictor.observe(each.split(NUM_PAST, predictor.needs)[0])
        for each in (clip, falsify(clip, ~PrivilegedInput.FUTURE_FRAMES))
    )
    motion = predictor.estimate(observed)
    false_motion = predictor.estimate(false_observed)
    assert np.abs(motion.futures - false_motion.futures).max() > 1e-6
    scenes = [predictor.reconstruct(each, motion.past) for each in (observed, false_observed)]
    views, false_views = (
        scene.view(motion.futures[0], clip.times_s[NUM_PAST:], clip.intrinsics) for scene in scenes
    )
    np.testing.assert_array_equal(views.frames, false_views.frames)


@pytest.mark.parametrize("needs", FIELD_OF_INPUT, ids=lambda needs: needs.name)
def test_a_privileged_input_shows_its_field_without_the_future(needs: PrivilegedInput) -> None:
    clip = street.clip()
    split, _ = clip.split(NUM_PAST, needs)
    restricted = clip.split(NUM_PAST, ~PrivilegedInput.NONE)[0].only(needs)
    for context in (split, restricted):
        assert leaked_fields(context, PrivilegedInput.NONE) == [FIELD_OF_INPUT[needs]]
        for view in (context, context.full, context.right):
            assert view is None or len(view.frames) == NUM_PAST
        for values in (context.past_depths, context.past):
            assert values is None or len(values) == NUM_PAST


def test_the_memory_of_the_context_does_not_hold_the_future() -> None:
    """A slice of an array would lead back to the whole array by `base`."""
    context, _ = street.clip().split(NUM_PAST, ~PrivilegedInput.NONE)
    for owner in (context, context.past, context.full, context.right, context.future_full):
        for name, value in vars(owner).items():
            if isinstance(value, np.ndarray) and value.base is not None and name != "times_s":
                assert value.base.nbytes == value.nbytes


def test_all_privileged_inputs_and_roles_are_tested() -> None:
    assert set(FIELD_OF_INPUT) == set(PrivilegedInput)
    fields = {field.name for field in dataclasses.fields(Context)}
    always = {"name", "frames", "times_s", "intrinsics", "observations", "steps"}
    assert fields == always | {"full_observations", "future_full", *FIELD_OF_INPUT.values()}
    with_needs = {role for role, p in registry.PROTOCOL_OF_ROLE.items() if hasattr(p, "needs")}
    assert set(ROLES) == with_needs - {"scales"}  # a scale gets numbers from its odometry
