"""Runs of a component of each role on a clip, and checks of its outputs, which are named arrays."""

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
    PrivilegedInput,
    Trajectory,
    Views,
)

Outputs = dict[str, npt.NDArray[Any]]


class ContractViolation(GeovpError):
    """Broken promise of a component's interface; the message names it."""


@dataclass(frozen=True)
class Trial:
    """Component of a role with a clip on which it is run, split into past and future."""

    role: str
    component: Any
    clip: Clip  # with poses, depths, full and right frames
    num_past: int = 6
    num_samples: int = 1

    @functools.cached_property
    def full_context(self) -> Context:
        """Return the context with all privileged inputs."""
        return self.clip.split(self.num_past, ~PrivilegedInput.NONE)[0]

    @property
    def trajectory(self) -> Trajectory:
        """Return the recorded trajectory [P + F]."""
        assert self.clip.trajectory is not None
        return self.clip.trajectory

    @functools.cached_property
    def past(self) -> Trajectory:
        """Return the recorded past [P]."""
        return self.trajectory[: self.num_past]

    @property
    def futures(self) -> FloatArray:
        """Return the recorded future poses [F, 4, 4]."""
        return self.trajectory.world_from_cam[self.num_past :]

    @property
    def times_s(self) -> FloatArray:
        """Return the future times [F]."""
        return self.clip.times_s[self.num_past :]

    @property
    def frames(self) -> ByteArray:
        """Return the real future frames [F, H, W, 3]."""
        return self.clip.frames[self.num_past :]

    def run(self, context: Context | None = None) -> Outputs:
        """Run the component on a context; by default on its privileged inputs alone."""
        needs = getattr(self.component, "needs", PrivilegedInput.NONE)
        return RUN[self.role](self, context or self.full_context.only(needs))


def require(condition: object, message: str) -> None:
    """Raise ContractViolation with the message unless the condition holds."""
    if not condition:
        raise ContractViolation(message)


def equal(first: Outputs, second: Outputs) -> bool:
    """Return whether two runs agree within 1e-6 of a value and one grey level of a pixel."""
    if first.keys() != second.keys():
        return False
    for name, array in first.items():
        other = second[name]
        tolerance = 1 if array.dtype == np.uint8 else 1e-6
        if array.shape != other.shape or not np.allclose(
            array.astype(float), other.astype(float), rtol=1e-6, atol=tolerance, equal_nan=True
        ):
            return False
    return True


def pose_source(trial: Trial, context: Context) -> Outputs:
    """Require a pose for each step, with one or the requested number of samples."""
    motion = trial.component.estimate(context, trial.num_samples)
    _require_past(motion.past, motion.tracked, trial)
    num_samples, num_steps = motion.futures.shape[:2]
    require(
        num_samples in (1, trial.num_samples) and num_steps == len(trial.frames),
        f"{num_samples} samples of {num_steps} futures, expected {trial.num_samples} (or 1 if "
        f"deterministic) of {len(trial.frames)}",
    )
    past = motion.past.world_from_cam
    return {"past": past, "futures": motion.futures, "tracked": motion.tracked}


def pose_refinement(trial: Trial, context: Context) -> Outputs:
    """Require as many poses as in the given motion."""
    recorded = Motion(trial.past, trial.futures[None], np.ones(trial.num_past, dtype=bool))
    pitch_rad = 2e-4 * np.sin(np.arange(trial.num_past))[::-1]
    noise = se3.exp(pitch_rad[:, None] * np.eye(6)[4])
    noisy = replace(trial.past, world_from_cam=trial.past.world_from_cam @ noise)
    motion = trial.component.refine(context, replace(recorded, past=noisy))
    _require_past(motion.past, motion.tracked, trial)
    _require_array("futures", motion.futures, np.floating, recorded.futures.shape)
    return {"past": motion.past.world_from_cam, "futures": motion.futures}


def odometry(trial: Trial, context: Context) -> Outputs:
    """Require the past trajectory and a mask of tracked steps."""
    past, tracked = trial.component.track(context)
    _require_past(past, tracked, trial)
    return {"past": past.world_from_cam, "tracked": tracked}


def forecaster(trial: Trial, context: Context) -> Outputs:
    """Require the requested number of rigid, finite futures."""
    futures = trial.component.forecast(trial.past, trial.times_s, trial.num_samples)
    shape = (trial.num_samples, len(trial.frames), 4, 4)
    _require_array("futures", futures, np.floating, shape)
    Motion(trial.past, futures, np.ones(trial.num_past, dtype=bool))  # BadData unless rigid
    return {"futures": futures}


def depth_source(trial: Trial, context: Context) -> Outputs:
    """Require finite inverse depths and confidences of the frames' size."""
    inverse_depths, confidence = trial.component.inverse_depths(context, trial.past)
    outputs = {"inverse_depths": inverse_depths, "confidence": confidence}
    for name, array in outputs.items():
        _require_array(name, array, np.floating, context.frames.shape[:3])
        require(np.isfinite(array).all() and (array >= 0).all(), f"{name} is negative or infinite")
    require((confidence <= 1).all(), "confidence is larger than 1")
    return outputs


def renderer(trial: Trial, context: Context) -> Outputs:
    """Require views from past and future poses, and from future poses that look backwards."""
    scene = trial.component.reconstruct(context, trial.past)
    backwards = trial.futures @ np.diag([-1.0, 1.0, -1.0, 1.0])
    poses = np.concatenate([trial.trajectory.world_from_cam, backwards])
    return views(scene, poses, np.concatenate([trial.clip.times_s, trial.times_s]), trial)


def predictor(trial: Trial, context: Context) -> Outputs:
    """Require frames of the past frames' size, with one or the requested number of samples."""
    prediction = trial.component.predict(context, trial.num_samples)
    num_samples = 1 if len(prediction.frames) == 1 else trial.num_samples
    shape = (num_samples, *trial.frames.shape)
    _require_array("frames", prediction.frames, np.uint8, shape)
    outputs = {"frames": prediction.frames}
    if prediction.covered is not None:
        outputs["covered"] = prediction.covered
    if prediction.motion is not None:
        _require_past(prediction.motion.past, prediction.motion.tracked, trial)
        outputs["futures"] = prediction.motion.futures
    return outputs


def inpainter(trial: Trial, context: Context) -> Outputs:
    """Require that only uncovered pixels change: a strip, and the whole last frame."""
    covered = np.ones(trial.frames.shape[:3], dtype=bool)
    covered[:, :, 30:50] = False
    covered[-1] = False
    frames = np.where(covered[..., None], trial.frames, np.uint8(0))
    given = Views(frames, covered, np.where(covered, np.float32(5), np.float32(0)))
    inpainted = trial.component.inpaint(given, trial.full_context.frames[-1])
    _require_array("inpainted frames", inpainted, np.uint8, trial.frames.shape)
    num_changed = (inpainted[covered] != trial.frames[covered]).any(axis=-1).sum()
    require(num_changed == 0, f"{num_changed} covered pixels were changed")
    return {"frames": inpainted}


def frame_metric(trial: Trial, context: Context) -> Outputs:
    """Require a value per step, better for the truth than for noise, NaN for an empty mask."""
    enlarged = trial.frames.repeat(2, axis=1)  # five scales of MS-SSIM need 161 pixels
    truth = enlarged.repeat(2, axis=2)
    noise = np.random.default_rng(0).integers(0, 256, truth.shape, dtype=np.uint8)
    mask = np.ones(truth.shape[:3], dtype=bool)
    mask[0] = False
    values = {
        "truth": trial.component(truth, truth, None),
        "noise": trial.component(noise, truth, None),
        "masked": trial.component(noise, truth, mask),
    }
    for name, array in values.items():
        _require_array(f"value of {name}", array, np.floating, (len(truth),))
    require(not np.isnan(values["noise"]).any(), "a step without a mask has the value NaN")
    require(np.isnan(values["masked"][0]), "an empty mask has a value, expected NaN")
    same = np.allclose(values["masked"][1:], values["noise"][1:])
    require(same, "a full mask differs from no mask")
    sign = 1 if trial.component.higher_is_better else -1
    gain = sign * (values["truth"] - values["noise"])
    require((gain > 0).all(), "noise is as good as the truth")
    return values


def trajectory_metric(trial: Trial, context: Context) -> Outputs:
    """Require a value per step, no worse for the truth than for a stationary camera."""
    truth = Trajectory(trial.futures, trial.times_s, is_metric=True)
    last = trial.past.world_from_cam[-1]
    still = replace(truth, world_from_cam=np.tile(last, (len(truth), 1, 1)))
    values = {"truth": trial.component(truth, truth), "still": trial.component(still, truth)}
    for name, array in values.items():
        _require_array(f"value of {name}", array, np.floating, (len(truth),))
        is_defined = np.isfinite(array).any() and not np.isinf(array).any()
        require(is_defined, f"value of {name} is infinite or never finite: {array}")
    sign = 1 if trial.component.higher_is_better else -1
    is_worse = sign * values["truth"] < sign * values["still"]  # False for NaN
    require(not is_worse.any(), "a stationary camera is better than the truth")
    return values


def dataset(trial: Trial, context: Context) -> Outputs:
    """Require as many clips as its length."""
    clip = trial.component[0]
    num_clips = len(trial.component)
    try:
        trial.component[num_clips]
    except IndexError:
        return {"frames": clip.frames, "times_s": clip.times_s}
    raise ContractViolation(
        f"clip {num_clips} of {num_clips} exists, expected IndexError, which ends a loop"
    )


RUN: dict[str, Callable[[Trial, Context], Outputs]] = {
    "pose_sources": pose_source,
    "pose_refinements": pose_refinement,
    "odometries": odometry,
    "forecasters": forecaster,
    "depth_sources": depth_source,
    "renderers": renderer,
    "predictors": predictor,
    "inpainters": inpainter,
    "frame_metrics": frame_metric,
    "trajectory_metrics": trajectory_metric,
    "datasets": dataset,
}


def views(scene: Any, world_from_cam: FloatArray, times_s: FloatArray, trial: Trial) -> Outputs:
    """Render a scene and return checked arrays."""
    rendered = scene.view(world_from_cam, times_s, trial.clip.intrinsics)
    _require_array("frames", rendered.frames, np.uint8, (len(times_s), *trial.frames.shape[1:]))
    depths = rendered.depths
    require((depths >= 0).all(), "depths are negative or NaN, expected 0 where unknown")
    return {"frames": rendered.frames, "covered": rendered.covered, "depths": depths}


def _require_past(past: Any, tracked: Any, trial: Trial) -> None:
    require(len(past) == trial.num_past, f"{len(past)} past poses for {trial.num_past} frames")
    _require_array("tracked", tracked, np.bool_, (trial.num_past,))
    require(
        np.allclose(past.times_s, trial.past.times_s, rtol=0, atol=1e-6),
        "the past poses have other times than the frames",
    )


def _require_array(name: str, array: Any, kind: type, shape: tuple[int, ...]) -> None:
    require(
        array.shape == shape and np.issubdtype(array.dtype, kind),
        f"{name}: {array.dtype} of shape {array.shape}, expected {kind.__name__} of {shape}",
    )
