"""Contract tests of components: promises of each role, tested on clips of the synthetic street."""

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from geovp_classic import registry
from geovp_classic.data.synthetic.dataset import Synthetic
from geovp_classic.errors import Incompatible
from geovp_classic.types import (
    ByteArray,
    Context,
    FloatArray,
    Motion,
    Prediction,
    PrivilegedInput,
    Views,
)

Outputs = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Finding:
    """Result of one promise."""

    name: str
    passed: bool
    detail: str = ""  # the error, or a remark


def check(role: str, component: Any) -> list[Finding]:
    """Test each promise of a component's role; errors that the component raises are findings.

    Executors and scales are described and built again only. Raises UnknownComponent for an unknown
    role.
    """
    registry.names(role)
    trial = Trial(role, component, street(0))
    findings = []
    for name, promise in _promises(role):
        try:
            findings.append(Finding(name, True, promise(trial) or ""))
        except (Exception, SystemExit) as error:  # any error of a plug-in is a finding
            detail = f"{type(error).__name__}: {' '.join(str(error).split())}"
            findings.append(Finding(name, False, detail))
    return findings


@functools.cache
def street(number: int) -> Any:
    """Return a context with all privileged inputs: 0 drives straight ahead, 7 is stationary."""
    clips = Synthetic(
        num_clips=8, num_frames=10, size_px=(128, 128), with_full=True, with_right=True
    )
    return clips[number].split(6, ~PrivilegedInput.NONE)[0]


def has_context(role: str) -> bool:
    """Return whether the components of a role are given a context."""
    return hasattr(registry.PROTOCOL_OF_ROLE.get(role), "needs") and role != "scales"


# Running a component


@dataclass(frozen=True)
class Trial:
    """Component of a role with a context on which it is run."""

    role: str
    component: Any
    truth: Any  # Context with all privileged inputs
    num_samples: int = 1

    def run(self, context: Context | None = None) -> Outputs:
        """Return the outputs for a context; by default with the privileged inputs of `needs`."""
        truth, needs = self.truth, getattr(self.component, "needs", PrivilegedInput.NONE)
        output = motion = self._call(context or truth.only(needs))
        if isinstance(output, Prediction):
            self._require_samples("frames", output.frames, *truth.future_frames.shape)
            motion = output.motion
        if isinstance(motion, Motion):
            same = np.array_equal(motion.past.times_s, truth.past.times_s)
            require(same, "the past poses have other times than the frames")
            self._require_samples("futures", motion.futures, truth.num_future, 4, 4)
        return arrays(output)

    def _call(self, context: Context) -> Any:
        """Return the output of a component of any role."""
        component, truth, num_samples = self.component, self.truth, self.num_samples
        # True poses, where a component is given some.
        past, future = truth.past, truth.future
        motion = Motion(past, future.world_from_cam[None], np.ones(truth.num_past, dtype=bool))
        match self.role:
            case "pose_sources":
                return component.estimate(context, num_samples)
            case "pose_refinements":
                return component.refine(context, motion)
            case "odometries":
                past, tracked = component.track(context)
                return Motion(past, motion.futures, tracked)
            case "forecasters":
                futures = component.forecast(past, future.times_s, num_samples)
                require_shape("futures", futures, num_samples, truth.num_future, 4, 4)
                return replace(motion, futures=futures)
            case "depth_sources":
                outputs = np.stack(component.inverse_depths(context, past))
                require_shape("depths and confidences", outputs, 2, *context.frames.shape[:3])
                maxima = np.array([np.finfo(np.float32).max, 1])[:, None, None, None]
                is_valid = (outputs >= 0) & (outputs <= maxima)  # not of NaN
                require(is_valid.all(), "inverse depths are not finite, or confidences above 1")
                return outputs
            case "renderers":
                scene = component.reconstruct(context, past)
                backwards = future.world_from_cam @ np.diag([-1.0, 1.0, -1.0, 1.0])
                poses = np.concatenate([past.world_from_cam, future.world_from_cam, backwards])
                return self.view(scene, poses, np.append(truth.times_s, future.times_s))
            case "predictors":
                return component.predict(context, num_samples)
            case "inpainters":
                return _inpaint(component, truth.future_frames, truth.frames[-1])
            case "frame_metrics":
                return _score_frames(component, truth.future_frames)
            case "set_metrics":
                features = component.features(truth.frames, truth.future_frames)
                require_shape("features", features, *features.shape[:1])
                return np.asarray(features)
            case "trajectory_metrics":
                last = past.world_from_cam[[-1] * len(future)]
                return _score(component, future, replace(future, world_from_cam=last))
            case "datasets":
                np.testing.assert_raises(IndexError, component.__getitem__, len(component))
                return component[len(component) - 1]

    def view(self, scene: Any, world_from_cam: FloatArray, times_s: FloatArray) -> Views:
        """Render a scene of the component."""
        views: Views = scene.view(world_from_cam, times_s, self.truth.intrinsics)
        require_shape("frames", views.frames, len(times_s), *self.truth.frames.shape[1:])
        require((views.depths >= 0).all(), "depths are negative or NaN, expected 0 where unknown")
        return views

    def _require_samples(self, name: str, array: npt.NDArray[Any], *shape: int) -> None:
        """Require as many samples of a shape as requested, or one of a deterministic component."""
        require_shape(name, array, 1 if len(array) == 1 else self.num_samples, *shape)


def _inpaint(inpainter: Any, frames: ByteArray, last: ByteArray) -> Views:
    """Inpaint a strip and the whole last frame, and require that other pixels stay."""
    covered = np.ones(frames.shape[:3], dtype=bool)
    covered[:, :, 30:50] = False
    covered[-1] = False
    views = Views(frames * covered[..., None], covered, covered.astype(np.float32))
    inpainted = replace(views, frames=inpainter.inpaint(views, last))
    is_same = (inpainted.frames == frames)[covered].all()
    require(is_same, "covered pixels were changed")
    return inpainted


def _score_frames(metric: Any, frames: ByteArray) -> FloatArray:
    """Compare frames with noise, and require NaN where no pixel is compared."""
    truth = frames.repeat(2, axis=1).repeat(2, axis=2)  # MS-SSIM needs 161 pixels
    noise = np.random.default_rng(0).integers(0, 256, truth.shape, dtype=np.uint8)
    mask = np.ones(truth.shape[:3], dtype=bool)
    mask[0] = False
    scores, masked = _score(metric, truth, noise, None), metric(noise, truth, mask)
    require((scores[0] != scores[1]).all(), "noise is as good as the truth")
    expected = np.append(np.nan, scores[1, 1:])
    np.testing.assert_allclose(masked, expected, 1e-5, 1e-8, err_msg="the first mask is empty")
    return np.vstack([scores, masked])


def _score(metric: Any, truth: Any, worse: Any, *mask: None) -> FloatArray:
    """Return a metric's values [2, F] of the truth, which has to be better, and a prediction."""
    scores = np.stack([metric(truth, truth, *mask), metric(worse, truth, *mask)])
    require_shape("values", scores, 2, len(truth))
    gains = (scores[0] - scores[1]) * (1 if metric.higher_is_better else -1)
    require(np.nanmin(gains) >= 0, f"noise or a stationary camera is better, gains are {gains}")
    return scores


def arrays(value: Any, name: str = "output") -> Outputs:
    """Return an array, or the arrays of a dataclass and of its nested ones, by name."""
    if isinstance(value, np.ndarray):
        return {name: value}
    outputs: Outputs = {}
    for key, field in getattr(value, "__dict__", {}).items():
        outputs |= arrays(field, f"{name}.{key}")
    return outputs


def require(condition: object, message: str) -> None:
    """Raise AssertionError with the message unless the condition holds."""
    if not condition:
        raise AssertionError(message)


def require_shape(name: str, array: npt.NDArray[Any], *shape: int) -> None:
    """Raise AssertionError unless an array has a shape."""
    require(array.shape == shape, f"{name} have shape {array.shape}, expected {shape}")


def require_equal(first: Outputs, second: Outputs, message: str) -> None:
    """Require that two runs agree within 1e-6 of a value and one grey level of a pixel."""
    require(first.keys() == second.keys(), message)
    for name, array in first.items():
        tolerance = 1 if array.dtype == np.uint8 else 1e-6
        is_close = np.allclose(array, second[name], rtol=1e-6, atol=tolerance, equal_nan=True)
        require(is_close, message)


# Promises


def _promises(role: str) -> Iterator[tuple[str, Callable[[Trial], str | None]]]:
    """Yield the promises of a role with their names.

    A promise returns a remark or None, or raises an error if it is broken.
    """
    yield "has the methods of its interface", _has_interface
    yield "is a frozen dataclass", _is_frozen
    yield "can be described and built again", _is_described
    if role not in ("scales", "executors"):
        yield "returns valid outputs", _is_valid
        yield "is deterministic", _is_deterministic
    if has_context(role):
        yield "uses only its privileged inputs", _uses_only_its_needs
    if role in ("pose_sources", "forecasters", "predictors"):
        samples = functools.partial(_is_valid, num_samples=3)
        yield "returns the requested number of samples", samples
    if role == "renderers":
        yield "renders each view from its own pose and time alone", _views_are_independent
        yield "covers nothing behind the first camera", _covers_nothing_behind
        yield "shows the last frame from its pose", _shows_the_last_frame
    if has_context(role) or role == "forecasters":
        drive = street(0)
        variants = {
            "a stationary camera": street(7),
            "a past of two frames": drive.recent(2),
            "poses without a unit": replace(drive, past=replace(drive.past, is_metric=False)),
        }
        for name, truth in variants.items():
            promise = functools.partial(_is_valid_or_refused, truth=truth)
            yield f"accepts or refuses {name}", promise


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


def _is_valid(trial: Trial, **changes: Any) -> None:
    """Require valid outputs of a trial with changes."""
    replace(trial, **changes).run()


def _is_valid_or_refused(trial: Trial, truth: Context) -> str | None:
    """Require valid outputs, or the error Incompatible."""
    try:
        _is_valid(trial, truth=truth)
    except Incompatible as refusal:
        return f"refuses: {refusal}"
    return None


def _is_deterministic(trial: Trial) -> None:
    """Require equal outputs of two runs."""
    problem = "two runs differ on the same input: give randomness a seed field"
    require_equal(trial.run(), trial.run(), problem)


def _uses_only_its_needs(trial: Trial) -> None:
    """Require equal outputs with further inputs."""
    problem = f"its output depends on more inputs than {trial.component.needs}"
    require_equal(trial.run(), trial.run(trial.truth), problem)


def _views_are_independent(trial: Trial) -> None:
    """Require the same views in another order and alone as of all poses together."""
    truth = trial.truth
    scene = trial.component.reconstruct(truth.only(trial.component.needs), truth.past)
    poses = np.concatenate([truth.past.world_from_cam, truth.future.world_from_cam])
    together = arrays(trial.view(scene, poses, truth.times_s))
    order = np.random.default_rng(0).permutation(len(poses))
    problem = "views change with other poses: each depends on its own pose and time alone"
    for rows in (order, order[:1]):
        again = arrays(trial.view(scene, poses[rows], truth.times_s[rows]))
        require_equal(again, {name: array[rows] for name, array in together.items()}, problem)


def _view_of_past(trial: Trial, step: int, turn: FloatArray) -> Views:
    """Return the view of the scene from the pose of an observed frame, turned by [4, 4]."""
    truth = trial.truth
    scene = trial.component.reconstruct(truth.only(trial.component.needs), truth.past)
    poses = truth.past.world_from_cam[[step]] @ turn
    return trial.view(scene, poses, truth.past.times_s[[step]])


def _covers_nothing_behind(trial: Trial, max_covered: float = 0.01) -> None:
    """Require that a view backwards is uncovered: the cameras drive ahead, and none saw it.

    A few pixels may be covered at the edges of what was seen.
    """
    backwards = np.diag([-1.0, 1.0, -1.0, 1.0])
    covered = _view_of_past(trial, 0, backwards).covered.mean()
    problem = "of the view backwards is covered, but was never seen: cover points ahead only"
    require(covered <= max_covered, f"{100 * covered:.0f} % {problem}")


def _shows_the_last_frame(trial: Trial, min_covered: float = 0.5) -> None:
    """Require that the view from the last pose is like the last frame, and not like its mirror.

    Exposure, resampling and coarse networks change grey values, but bring no mirror nearer.
    """
    views = _view_of_past(trial, -1, np.eye(4))
    shown, covered = views.frames[0].astype(float), views.covered[0]
    fraction = covered.mean()
    problem = "of the view from the last pose is covered, but all of it was seen"
    require(fraction >= min_covered, f"{100 * fraction:.0f} % {problem}")
    last = trial.truth.frames[-1]
    error, *mirrored = (
        np.abs(shown - image)[covered].mean() for image in (last, last[:, ::-1], last[::-1])
    )
    problem = "grey values off the last frame, and its mirror images are as near"
    require(error < min(mirrored), f"the view from the last pose is {error:.0f} {problem}")
