"""How a component of each role is run on a clip, and what its outputs must be; outputs are arrays
by name.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from geovp_classic.errors import GeovpError
from geovp_classic.geometry import se3
from geovp_classic.types import (
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Motion,
    Prediction,
    PrivilegedInput,
    Trajectory,
    Views,
)

Outputs = dict[str, npt.NDArray[Any]]
NOISE_RAD = 2e-4  # amplitude of the pitch error of the past poses that a refinement is given


class ContractViolation(GeovpError):
    """A component broke a promise of its interface; the message says which."""


@dataclass(frozen=True)
class Trial:
    """A clip to run a component on, split into past and future."""

    clip: Clip  # with poses, depths, wide and right frames
    num_past: int
    num_samples: int = 1

    @functools.cached_property
    def full_context(self) -> Context:
        """The context with every grant."""
        return self.clip.split(self.num_past, ~PrivilegedInput.NONE)[0]

    @functools.cached_property
    def past(self) -> Trajectory:
        """The recorded past."""
        assert self.clip.trajectory is not None
        return self.clip.trajectory[: self.num_past]

    @property
    def futures(self) -> FloatArray:
        """The recorded future poses [F, 4, 4]."""
        assert self.clip.trajectory is not None
        return self.clip.trajectory.world_from_cam[self.num_past :]

    @property
    def frames(self) -> ByteArray:
        """The real future frames [F, H, W, 3]."""
        return self.clip.frames[self.num_past :]


def require(condition: bool, message: str) -> None:
    """Raise ContractViolation with the message unless the condition holds."""
    if not condition:
        raise ContractViolation(message)


def pose_source(component: Any, trial: Trial, context: Context) -> Outputs:
    """A motion: a pose for every step, one sample or as many as asked for."""
    motion = component.estimate(context, trial.num_samples)
    _require_type("estimate", motion, Motion)
    _require_past(motion.past, motion.tracked, trial)
    samples, steps = motion.futures.shape[:2]
    expected = (
        f"expected {trial.num_samples} of {len(trial.frames)} (or one sample, when deterministic)"
    )
    good = samples in (1, trial.num_samples) and steps == len(trial.frames)
    require(good, f"{samples} samples of {steps} futures, {expected}")
    return {
        "past": motion.past.world_from_cam,
        "futures": motion.futures,
        "tracked": motion.tracked,
    }


def pose_refinement(component: Any, trial: Trial, context: Context) -> Outputs:
    """A motion with as many poses and futures as the given one, which is kept in `unrefined`."""
    recorded = Motion(trial.past, trial.futures[None], np.ones(trial.num_past, dtype=bool))
    pitch_rad = NOISE_RAD * np.sin(np.arange(trial.num_past))[::-1]
    noisy = trial.past.world_from_cam @ se3.exp(pitch_rad[:, None] * np.eye(6)[4])
    motion = component.refine(
        context, recorded.refined(replace(trial.past, world_from_cam=noisy), recorded.futures)
    )
    _require_type("refine", motion, Motion)
    _require_past(motion.past, motion.tracked, trial)
    shape, expected = motion.futures.shape, recorded.futures.shape
    require(shape == expected, f"futures {shape}, expected {expected}")
    kept = motion.unrefined is not None and (motion.unrefined.futures == recorded.futures).all()
    require(kept, "the motion of the pose source was not kept: use Motion.refined")
    return {"past": motion.past.world_from_cam, "futures": motion.futures}


def odometry(component: Any, trial: Trial, context: Context) -> Outputs:
    """The past trajectory and which steps were tracked."""
    past, tracked = component.track(context)
    _require_past(past, tracked, trial)
    return {"past": past.world_from_cam, "tracked": tracked}


def forecaster(component: Any, trial: Trial, context: Context) -> Outputs:
    """Rigid, finite futures, as many samples as asked for."""
    futures = component.forecast(
        trial.past, trial.clip.times_s[trial.num_past :], trial.num_samples
    )
    _require_array("futures", futures, np.floating, (trial.num_samples, len(trial.frames), 4, 4))
    Motion(
        trial.past, futures, np.ones(trial.num_past, dtype=bool)
    )  # BadData unless rigid and finite
    return {"futures": futures}


def depth_source(component: Any, trial: Trial, context: Context) -> Outputs:
    """Inverse depths and confidences, finite, of the size of the frames."""
    inverse_depths, confidence = component.inverse_depths(context, trial.past)
    for name, array, most in (
        ("inverse depth", inverse_depths, np.inf),
        ("confidence", confidence, 1.0),
    ):
        _require_array(name, array, np.floating, context.frames.shape[:3])
        good = np.isfinite(array) & (array >= 0) & (array <= most)
        require(
            bool(good.all()), f"{name} has {(~good).sum()} values outside [0, {most}] or not finite"
        )
    return {"inverse_depths": inverse_depths, "confidence": confidence}


def renderer(component: Any, trial: Trial, context: Context) -> Outputs:
    """Views from past and future poses, and from the future poses turned round, where little is
    known.
    """
    scene, times_s = component.reconstruct(context, trial.past), trial.clip.times_s
    path = views(scene, np.concatenate([trial.past.world_from_cam, trial.futures]), times_s, trial)
    backwards = views(
        scene, trial.futures @ np.diag([-1.0, 1.0, -1.0, 1.0]), times_s[trial.num_past :], trial
    )
    return {**path, **{f"backwards {name}": array for name, array in backwards.items()}}


def predictor(component: Any, trial: Trial, context: Context) -> Outputs:
    """Predicted frames of the size of the past ones, one sample or as many as asked for."""
    prediction = component.predict(context, trial.num_samples)
    _require_type("predict", prediction, Prediction)
    samples = len(prediction.frames) if len(prediction.frames) == 1 else trial.num_samples
    _require_array(
        "frames",
        prediction.frames,
        np.uint8,
        (samples, len(trial.frames), *context.frames.shape[1:]),
    )
    outputs = {"frames": prediction.frames}
    if prediction.covered is not None:
        outputs["covered"] = prediction.covered
    if prediction.motion is not None:
        _require_past(prediction.motion.past, prediction.motion.tracked, trial)
        outputs["futures"] = prediction.motion.futures
    return outputs


def fill(component: Any, trial: Trial, context: Context) -> Outputs:
    """Frames that differ from the given ones only where these are uncovered: a strip, and all of
    the last frame.
    """
    covered = np.ones(trial.frames.shape[:3], dtype=bool)
    covered[:, :, 30:50] = False
    covered[-1] = False
    depths = np.where(covered, np.linspace(2, 20, trial.clip.intrinsics.width_px), 0).astype(
        np.float32
    )
    given = Views(np.where(covered[..., None], trial.frames, np.uint8(0)), covered, depths)
    filled = component.inpaint(given, trial.clip.frames[trial.num_past - 1])
    _require_array("filled frames", filled, np.uint8, trial.frames.shape)
    changed = int((filled[covered] != trial.frames[covered]).any(axis=-1).sum())
    require(changed == 0, f"{changed} covered pixels were changed")
    return {"frames": filled}


def frame_metric(component: Any, trial: Trial, context: Context) -> Outputs:
    """A number a step, better for the truth than for noise, NaN where the mask leaves nothing."""
    truth = trial.frames.repeat(2, axis=1).repeat(
        2, axis=2
    )  # five scales of MS-SSIM need 161 pixels
    noise = np.random.default_rng(0).integers(0, 256, truth.shape, dtype=np.uint8)
    everywhere = np.ones(truth.shape[:3], dtype=bool)
    not_first = everywhere & (np.arange(len(truth)) > 0)[:, None, None]
    scores = {
        "truth": component(truth, truth, None),
        "noise": component(noise, truth, None),
        "masked": component(noise, truth, not_first),
        "whole": component(noise, truth, everywhere),
    }
    for name, values in scores.items():
        _require_array(f"score of {name}", values, np.floating, (len(truth),))
    require(not np.isnan(scores["noise"]).any(), "a step without a mask scored NaN")
    require(
        bool(np.isnan(scores["masked"][0])),
        f"an empty mask scored {scores['masked'][0]}, expected NaN",
    )
    require(
        np.allclose(scores["whole"], scores["noise"]),
        "a full mask gives another score than no mask",
    )
    sign = 1 if component.higher_is_better else -1
    require(
        bool((sign * scores["truth"] > sign * scores["noise"]).all()),
        "noise scores as well as the truth",
    )
    return scores


def trajectory_metric(component: Any, trial: Trial, context: Context) -> Outputs:
    """A number a step (NaN where undefined), no worse for the truth than for standing still."""
    times_s = trial.clip.times_s[trial.num_past :]
    truth = Trajectory(trial.futures, times_s, is_metric=True)
    still = replace(
        truth, world_from_cam=np.tile(trial.past.world_from_cam[-1], (len(truth), 1, 1))
    )
    scores = {"truth": component(truth, truth), "still": component(still, truth)}
    for name, values in scores.items():
        _require_array(f"score of {name}", values, np.floating, (len(truth),))
        finite = bool(np.isfinite(values).any()) and not np.isinf(values).any()
        require(finite, f"score of {name} is never finite or infinite somewhere: {values}")
    sign = 1 if component.higher_is_better else -1
    worse = sign * scores["truth"] < sign * scores["still"]  # False where a score is NaN
    require(not worse.any(), "standing still scores better than the truth")
    return scores


def dataset(component: Any, trial: Trial, context: Context) -> Outputs:
    """Clips, the same each time, as many as it says."""
    require(
        isinstance(component.name, str) and component.name != "", f"its name is {component.name!r}"
    )
    require(len(component) > 0, "it holds no clip")
    clip = component[0]
    _require_type("indexing", clip, Clip)
    require(component[0].name == clip.name, "clip 0 has another name the second time")
    try:
        component[len(component)]
    except IndexError:
        return {"frames": clip.frames, "times_s": clip.times_s}
    raise ContractViolation(
        f"clip {len(component)} of {len(component)} exists, expected IndexError, which ends a loop"
    )


RUN: dict[str, Callable[[Any, Trial, Context], Outputs]] = {
    "pose_sources": pose_source,
    "pose_refinements": pose_refinement,
    "odometries": odometry,
    "forecasters": forecaster,
    "depth_sources": depth_source,
    "renderers": renderer,
    "predictors": predictor,
    "inpainters": fill,
    "frame_metrics": frame_metric,
    "trajectory_metrics": trajectory_metric,
    "datasets": dataset,
}


def same_bytes(first: Outputs, second: Outputs) -> bool:
    """Whether two runs gave the same, to the last bit."""
    return first.keys() == second.keys() and all(
        first[name].shape == second[name].shape and first[name].tobytes() == second[name].tobytes()
        for name in first
    )


def views(scene: Any, world_from_cam: FloatArray, times_s: FloatArray, trial: Trial) -> Outputs:
    """The views of a scene as arrays, their shapes and depths checked."""
    seen = scene.view(world_from_cam, times_s, trial.clip.intrinsics)
    _require_type("view", seen, Views)
    _require_array("frames", seen.frames, np.uint8, (len(times_s), *trial.frames.shape[1:]))
    require(
        bool((seen.depths >= 0).all()),
        "views have depths that are negative or NaN, expected 0 where unknown",
    )
    return {"frames": seen.frames, "covered": seen.covered, "depths": seen.depths}


def _require_type(method: str, returned: Any, expected: type) -> None:
    require(
        isinstance(returned, expected),
        f"{method} gave {type(returned).__name__}, expected {expected.__name__}",
    )


def _require_past(past: Any, tracked: Any, trial: Trial) -> None:
    require(isinstance(past, Trajectory), f"the past is {type(past).__name__}, expected Trajectory")
    require(len(past) == trial.num_past, f"{len(past)} past poses for {trial.num_past} frames")
    _require_array("tracked", tracked, np.bool_, (trial.num_past,))
    seconds = trial.clip.times_s[: trial.num_past]
    require(
        np.allclose(past.times_s, seconds, rtol=0, atol=1e-6),
        "the past poses have other times than the frames",
    )


def _require_array(what: str, array: Any, kind: type, shape: tuple[int, ...]) -> None:
    require(isinstance(array, np.ndarray), f"{what}: {type(array).__name__}, expected an array")
    require(array.shape == tuple(shape), f"{what}: shape {array.shape}, expected {tuple(shape)}")
    require(np.issubdtype(array.dtype, kind), f"{what}: {array.dtype}, expected {kind.__name__}")
