"""Outputs of a component on a test clip, checked and reduced to arrays."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

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
class Trial:
    """Component of a role with a context on which it is run."""

    role: str
    component: Any
    truth: Any  # Context with all privileged inputs
    num_samples: int = 1

    def run(self, context: Context | None = None) -> Outputs:
        """Run the component on a context; by default on its privileged inputs alone."""
        needs = getattr(self.component, "needs", PrivilegedInput.NONE)
        output = _call(self, context or self.truth.only(needs))
        _check(self, output)
        return arrays(output)

    def view(self, scene: Any, world_from_cam: FloatArray, times_s: FloatArray) -> Views:
        """Render a scene of the component."""
        views: Views = scene.view(world_from_cam, times_s, self.truth.intrinsics)
        require_shape("frames", views.frames, len(times_s), *self.truth.frames.shape[1:])
        require((views.depths >= 0).all(), "depths are negative or NaN, expected 0 where unknown")
        return views


def require(condition: object, message: str) -> None:
    """Raise AssertionError with the message unless the condition holds."""
    if not condition:
        raise AssertionError(message)


def require_shape(name: str, array: npt.NDArray[Any], *shape: int) -> None:
    """Raise AssertionError unless an array has a shape."""
    require(array.shape == shape, f"{name} have shape {array.shape}, expected {shape}")


def arrays(value: Any, name: str = "output") -> Outputs:
    """Return the arrays of a dataclass or tuple and of its nested ones, by name."""
    if isinstance(value, np.ndarray):
        return {name: value}
    fields = dict(enumerate(value)) if isinstance(value, tuple) else getattr(value, "__dict__", {})
    outputs: Outputs = {}
    for key, field in fields.items():
        outputs |= arrays(field, f"{name}.{key}")
    return outputs


def require_equal(first: Outputs, second: Outputs, message: str) -> None:
    """Require that two runs agree within 1e-6 of a value and one grey level of a pixel."""
    require(first.keys() == second.keys(), message)
    for name, array in first.items():
        tolerance = 1 if array.dtype == np.uint8 else 1e-6
        pair = array.astype(float), second[name].astype(float)
        require(np.allclose(*pair, rtol=1e-6, atol=tolerance, equal_nan=True), message)


def _call(trial: Trial, context: Context) -> Any:
    """Return the output of a component of any role."""
    component, truth = trial.component, trial.truth
    past, future = truth.past, truth.future
    motion = Motion(past, future.world_from_cam[None], np.ones(truth.num_past, dtype=bool))
    match trial.role:
        case "pose_sources":
            return component.estimate(context, trial.num_samples)
        case "pose_refinements":
            return component.refine(context, motion)
        case "odometries":
            past, tracked = component.track(context)
            return Motion(past, motion.futures, tracked)
        case "forecasters":
            futures = component.forecast(past, future.times_s, trial.num_samples)
            require_shape("futures", futures, trial.num_samples, truth.num_future, 4, 4)
            return replace(motion, futures=futures)
        case "depth_sources":
            inverse_depths, confidences = component.inverse_depths(context, past)
            for values, maximum in ((inverse_depths, np.finfo(np.float32).max), (confidences, 1)):
                require_shape("depths and confidences", values, *context.frames.shape[:3])
                is_valid = (values >= 0) & (values <= maximum)  # not of NaN
                require(is_valid.all(), f"depths and confidences are not within 0 and {maximum}")
            return inverse_depths, confidences
        case "renderers":
            scene = component.reconstruct(context, past)
            backwards = future.world_from_cam @ np.diag([-1.0, 1.0, -1.0, 1.0])
            poses = np.concatenate([past.world_from_cam, future.world_from_cam, backwards])
            return trial.view(scene, poses, np.append(truth.times_s, future.times_s))
        case "predictors":
            return component.predict(context, trial.num_samples)
        case "inpainters":
            return _inpaint(component, truth.future_frames, truth.frames[-1])
        case "frame_metrics":
            return _score_frames(component, truth.future_frames)
        case "trajectory_metrics":
            last = past.world_from_cam[[-1] * len(future)]
            return _score(component, future, replace(future, world_from_cam=last))
        case "datasets":
            return _last_clip(component)


def _check(trial: Trial, output: Any) -> None:
    """Require motions and predictions with the times and frame sizes of the context."""
    truth = trial.truth
    if isinstance(output, Prediction):
        _require_samples(trial, "frames", output.frames, *truth.future_frames.shape)
        output = output.motion
    if isinstance(output, Motion):
        same = np.array_equal(output.past.times_s, truth.past.times_s)
        require(same, "the past poses have other times than the frames")
        _require_samples(trial, "futures", output.futures, truth.num_future, 4, 4)


def _require_samples(trial: Trial, name: str, array: npt.NDArray[Any], *shape: int) -> None:
    """Require as many samples of a shape as requested, or one of a deterministic component."""
    require_shape(name, array, 1 if len(array) == 1 else trial.num_samples, *shape)


def _inpaint(inpainter: Any, frames: ByteArray, last: ByteArray) -> Views:
    """Inpaint a strip and the whole last frame, and require that other pixels stay."""
    covered = np.ones(frames.shape[:3], dtype=bool)
    covered[:, :, 30:50] = False
    covered[-1] = False
    views = Views(frames * covered[..., None], covered, covered.astype(np.float32))
    inpainted = replace(views, frames=inpainter.inpaint(views, last))
    num_changed = (inpainted.frames[covered] != frames[covered]).any(axis=-1).sum()
    require(num_changed == 0, f"{num_changed} covered pixels were changed")
    return inpainted


def _score_frames(metric: Any, frames: ByteArray) -> tuple[FloatArray, ...]:
    """Compare frames with noise, and require NaN where no pixel is compared."""
    truth = frames.repeat(2, axis=1).repeat(2, axis=2)  # MS-SSIM needs 161 pixels
    noise = np.random.default_rng(0).integers(0, 256, truth.shape, dtype=np.uint8)
    mask = np.ones(truth.shape[:3], dtype=bool)
    mask[0] = False
    scores, masked = _score(metric, truth, noise, None), metric(noise, truth, mask)
    require((scores[0] != scores[1]).all(), "noise is as good as the truth")
    expected = np.append(np.nan, scores[1, 1:])
    same = np.allclose(masked, expected, equal_nan=True)
    require(same, f"masked values are {masked}, expected {expected}: the first mask is empty")
    return scores, masked


def _score(metric: Any, truth: Any, worse: Any, *mask: None) -> FloatArray:
    """Return a metric's values [2, F] of the truth, which has to be better, and a prediction."""
    scores = np.stack([metric(truth, truth, *mask), metric(worse, truth, *mask)])
    require_shape("values", scores, 2, len(truth))
    gains = (scores[0] - scores[1]) * (1 if metric.higher_is_better else -1)
    require(np.nanmin(gains) >= 0, f"noise or a stationary camera is better, gains are {gains}")
    return scores


def _last_clip(dataset: Any) -> Any:
    """Return the last clip, and require IndexError for the next one."""
    with suppress(IndexError):
        dataset[len(dataset)]
        raise AssertionError("there are more clips than the length, expected IndexError")
    return dataset[len(dataset) - 1]
