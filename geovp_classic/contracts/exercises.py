"""How each role is put to work on a clip, and what it must give back; outputs are plain arrays by name."""

from __future__ import annotations

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
    Grant,
    Motion,
    Prediction,
    Trajectory,
    Views,
)

Outputs = dict[str, npt.NDArray[Any]]
EVERYTHING = ~Grant.NONE
SHAKEN_RAD = 2e-4  # by how much past poses are off that a refinement is tried on


class Broken(GeovpError):
    """A component did not do what its interface promises; the message says what instead."""


@dataclass(frozen=True)
class Trial:
    """A clip to work on, cut into past and future."""

    clip: Clip  # with poses, depths, wide and right frames
    num_past: int
    num_samples: int = 1

    @functools.cached_property
    def everything(self) -> Context:
        """The past with all that can be granted."""
        return self.clip.split(self.num_past, EVERYTHING)[0]

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
    def num_future(self) -> int:
        """F."""
        return len(self.clip) - self.num_past

    @property
    def frames(self) -> ByteArray:
        """The real future frames [F, H, W, 3]."""
        return self.clip.frames[self.num_past :]


def demand(holds: bool, complaint: str) -> None:
    """Raise Broken with the complaint unless it holds."""
    if not holds:
        raise Broken(complaint)


def pose_source(component: Any, trial: Trial, context: Context) -> Outputs:
    """A motion: a pose for every step, one sample or as many as asked for."""
    motion = component.estimate(context, trial.num_samples)
    demand(isinstance(motion, Motion), f"estimate gave {type(motion).__name__}, expected Motion")
    _demand_past(motion.past, motion.tracked, trial)
    samples, steps = motion.futures.shape[:2]
    expected = f"expected {trial.num_samples} of {trial.num_future} (or one sample, when deterministic)"
    demand(
        samples in (1, trial.num_samples) and steps == trial.num_future,
        f"{samples} samples of {steps} futures, {expected}",
    )
    return {"past": motion.past.world_from_cam, "futures": motion.futures, "tracked": motion.tracked}


def pose_refinement(component: Any, trial: Trial, context: Context) -> Outputs:
    """A motion for the recorded one, registered: as many poses and futures, with what was recorded kept beside it."""
    given = Motion(trial.past, trial.futures[None], np.ones(trial.num_past, dtype=bool))
    shaken = trial.past.world_from_cam @ se3.exp(
        SHAKEN_RAD * np.sin(np.arange(trial.num_past))[::-1, None] * np.eye(6)[4]
    )
    before = given.refined(replace(trial.past, world_from_cam=shaken), given.futures)
    motion = component.refine(context, before)
    demand(isinstance(motion, Motion), f"refine gave {type(motion).__name__}, expected Motion")
    _demand_past(motion.past, motion.tracked, trial)
    demand(
        motion.futures.shape == given.futures.shape, f"futures {motion.futures.shape}, expected {given.futures.shape}"
    )
    kept = motion.unrefined is not None and (motion.unrefined.futures == given.futures).all()
    demand(kept, "what the pose source said was not kept: use Motion.refined")
    return {"past": motion.past.world_from_cam, "futures": motion.futures}


def odometry(component: Any, trial: Trial, context: Context) -> Outputs:
    """The past trajectory and which steps were tracked."""
    past, tracked = component.track(context)
    _demand_past(past, tracked, trial)
    return {"past": past.world_from_cam, "tracked": tracked}


def forecaster(component: Any, trial: Trial, context: Context) -> Outputs:
    """Rigid, finite futures, as many samples as asked for."""
    futures = component.forecast(trial.past, trial.clip.times_s[trial.num_past :], trial.num_samples)
    _demand_array("futures", futures, np.floating, (trial.num_samples, trial.num_future, 4, 4))
    Motion(trial.past, futures, np.ones(trial.num_past, dtype=bool))  # BadData unless rigid and finite
    return {"futures": futures}


def depth_source(component: Any, trial: Trial, context: Context) -> Outputs:
    """Inverse depths and confidences, finite, of the size of the frames."""
    inverse_depths, confidence = component.inverse_depths(context, trial.past)
    for name, array, most in (("inverse depth", inverse_depths, np.inf), ("confidence", confidence, 1.0)):
        _demand_array(name, array, np.floating, context.frames.shape[:3])
        good = np.isfinite(array) & (array >= 0) & (array <= most)
        demand(bool(good.all()), f"{name} has {(~good).sum()} values outside [0, {most}] or not finite")
    return {"inverse_depths": inverse_depths, "confidence": confidence}


def renderer(component: Any, trial: Trial, context: Context) -> Outputs:
    """Views from past and future poses, and from where nothing is to be seen; each row of its pose and time alone."""
    scene, times_s = component.reconstruct(context, trial.past), trial.clip.times_s
    poses = np.concatenate([trial.past.world_from_cam, trial.futures])
    path = _views(scene, poses, times_s, trial)
    behind = trial.futures @ np.diag([-1.0, 1.0, -1.0, 1.0])
    away = _views(scene, behind, times_s[trial.num_past :], trial)
    order = np.random.default_rng(0).permutation(len(poses))
    repeated = np.full(3, len(poses) - 1)
    for rows, how in (
        (order, "in another order"),
        (repeated, "three times"),
        *((order[k : k + 1], "alone") for k in order),
    ):
        again = _views(scene, poses[rows], times_s[rows], trial)
        same = same_bytes(again, {name: array[rows] for name, array in path.items()})
        demand(same, f"poses look different when asked {how}: a view depends on its own pose and time alone")
    return {**path, **{f"behind {name}": array for name, array in away.items()}}


def predictor(component: Any, trial: Trial, context: Context) -> Outputs:
    """Predicted frames of the size of the past ones, one sample or as many as asked for."""
    prediction = component.predict(context, trial.num_samples)
    demand(isinstance(prediction, Prediction), f"predict gave {type(prediction).__name__}, expected Prediction")
    samples = len(prediction.frames) if len(prediction.frames) == 1 else trial.num_samples
    _demand_array("frames", prediction.frames, np.uint8, (samples, trial.num_future, *context.frames.shape[1:]))
    outputs = {"frames": prediction.frames}
    if prediction.covered is not None:
        outputs["covered"] = prediction.covered
    if prediction.motion is not None:
        _demand_past(prediction.motion.past, prediction.motion.tracked, trial)
        outputs["futures"] = prediction.motion.futures
    return outputs


def fill(component: Any, trial: Trial, context: Context) -> Outputs:
    """Frames that differ from the given ones only where these are uncovered: a strip, and all of the last frame."""
    covered = np.ones(trial.frames.shape[:3], dtype=bool)
    covered[:, :, 30:50] = False
    covered[-1] = False
    depths = np.where(covered, np.linspace(2, 20, trial.clip.intrinsics.width_px), 0).astype(np.float32)
    views = Views(np.where(covered[..., None], trial.frames, np.uint8(0)), covered, depths)
    filled = component.fill(views, trial.clip.frames[trial.num_past - 1])
    _demand_array("filled frames", filled, np.uint8, trial.frames.shape)
    changed = int((filled[covered] != trial.frames[covered]).any(axis=-1).sum())
    demand(changed == 0, f"{changed} covered pixels were changed")
    return {"frames": filled}


def frame_metric(component: Any, trial: Trial, context: Context) -> Outputs:
    """A number a step, better for the truth than for noise, NaN where the mask leaves nothing."""
    truth = trial.frames
    noise = np.random.default_rng(0).integers(0, 256, truth.shape, dtype=np.uint8)
    everywhere = np.ones(truth.shape[:3], dtype=bool)
    nowhere_first = everywhere.copy()
    nowhere_first[0] = False
    scores = {
        "truth": component(truth, truth, None),
        "noise": component(noise, truth, None),
        "masked": component(noise, truth, nowhere_first),
        "whole": component(noise, truth, everywhere),
    }
    for name, values in scores.items():
        _demand_array(f"score of {name}", values, np.floating, (len(truth),))
    demand(not np.isnan(scores["noise"]).any(), "a step without a mask scored NaN")
    demand(bool(np.isnan(scores["masked"][0])), f"an empty mask scored {scores['masked'][0]}, expected NaN")
    demand(np.allclose(scores["whole"], scores["noise"]), "a mask of everything scores otherwise than no mask")
    sign = 1 if component.higher_is_better else -1
    demand(bool((sign * scores["truth"] > sign * scores["noise"]).all()), "noise scores as well as the truth")
    return scores


def trajectory_metric(component: Any, trial: Trial, context: Context) -> Outputs:
    """A number a step (NaN where it says nothing of that step), no worse for the truth than for standing still."""
    times_s = trial.clip.times_s[trial.num_past :]
    truth = Trajectory(trial.futures, times_s, is_metric=True)
    still = replace(truth, world_from_cam=np.tile(trial.past.world_from_cam[-1], (len(truth), 1, 1)))
    scores = {"truth": component(truth, truth), "still": component(still, truth)}
    for name, values in scores.items():
        _demand_array(f"score of {name}", values, np.floating, (len(truth),))
        says = np.isfinite(values)
        demand(bool(says.any()) and not np.isinf(values).any(), f"score of {name} says nothing: {values}")
    sign = 1 if component.higher_is_better else -1
    worse = sign * scores["truth"][says] < sign * scores["still"][says]
    demand(not worse.any(), "standing still scores better than the truth")
    return scores


def dataset(component: Any, trial: Trial, context: Context) -> Outputs:
    """Clips, the same each time, as many as it says."""
    demand(isinstance(component.name, str) and component.name != "", f"its name is {component.name!r}")
    demand(len(component) > 0, "it holds no clip")
    clip = component[0]
    demand(isinstance(clip, Clip), f"clip 0 is {type(clip).__name__}, expected Clip")
    demand(component[0].name == clip.name, "clip 0 has another name the second time")
    try:
        component[len(component)]
    except IndexError:
        return {"frames": clip.frames, "times_s": clip.times_s}
    raise Broken(f"clip {len(component)} of {len(component)} exists, expected IndexError, which ends a loop")


RUN: dict[str, Callable[[Any, Trial, Context], Outputs]] = {
    "pose_sources": pose_source,
    "pose_refinements": pose_refinement,
    "odometries": odometry,
    "forecasters": forecaster,
    "depth_sources": depth_source,
    "renderers": renderer,
    "predictors": predictor,
    "fills": fill,
    "frame_metrics": frame_metric,
    "trajectory_metrics": trajectory_metric,
    "datasets": dataset,
}


def same_bytes(first: Outputs, second: Outputs) -> bool:
    """Whether two runs gave the same, to the last bit."""
    return first.keys() == second.keys() and all(
        first[name].shape == second[name].shape and first[name].tobytes() == second[name].tobytes() for name in first
    )


def _views(scene: Any, world_from_cam: FloatArray, times_s: FloatArray, trial: Trial) -> Outputs:
    views = scene.view(world_from_cam, times_s, trial.clip.intrinsics)
    demand(isinstance(views, Views), f"view gave {type(views).__name__}, expected Views")
    _demand_array("frames", views.frames, np.uint8, (len(times_s), *trial.frames.shape[1:]))
    demand(bool((views.depths >= 0).all()), "views have depths that are negative or NaN, expected 0 where unknown")
    return {"frames": views.frames, "covered": views.covered, "depths": views.depths}


def _demand_past(past: Any, tracked: Any, trial: Trial) -> None:
    demand(isinstance(past, Trajectory), f"the past is {type(past).__name__}, expected Trajectory")
    demand(len(past) == trial.num_past, f"{len(past)} past poses for {trial.num_past} frames")
    _demand_array("tracked", tracked, np.bool_, (trial.num_past,))
    seconds = trial.clip.times_s[: trial.num_past]
    demand(np.allclose(past.times_s, seconds, rtol=0, atol=1e-6), "the past poses have other times than the frames")


def _demand_array(what: str, array: Any, kind: type, shape: tuple[int, ...]) -> None:
    demand(isinstance(array, np.ndarray), f"{what}: {type(array).__name__}, expected an array")
    demand(array.shape == tuple(shape), f"{what}: shape {array.shape}, expected {tuple(shape)}")
    demand(np.issubdtype(array.dtype, kind), f"{what}: {array.dtype}, expected {kind.__name__}")
