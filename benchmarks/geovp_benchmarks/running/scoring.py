"""Metrics of a matrix, and the scores of one prediction."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Self

import numpy as np

from geovp_benchmarks.failure import Failure
from geovp_benchmarks.matrix.components import build
from geovp_benchmarks.matrix.values import Specs
from geovp_benchmarks.results.score_names import CONFIDENCE, COVERAGE, FEATURES, UNBOUNDED
from geovp_benchmarks.results.store import Scores
from geovp_benchmarks.running.profiling import release_free_memory
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.interfaces import FrameMetric, SetMetric, TrajectoryMetric
from geovp_classic.metrics.clip_facts import clip_facts
from geovp_classic.metrics.strata import strata
from geovp_classic.metrics.trajectory import relative_to_last_observed
from geovp_classic.types import (
    BoolArray,
    ByteArray,
    Clip,
    Context,
    FloatArray,
    Prediction,
    PrivilegedInput,
    Target,
)


@dataclass(frozen=True)
class Metrics:
    """Metrics that can be computed here, by the names of their columns."""

    frame: dict[str, FrameMetric]
    trajectory: dict[str, TrajectoryMetric]
    set: dict[str, SetMetric] = field(default_factory=dict)
    described: dict[str, Any] = field(default_factory=dict)  # their resolved settings
    about: dict[str, Any] = field(default_factory=dict)  # of all metrics, for protocol.json

    @property
    def unavailable(self) -> dict[str, str]:
        """Return why metrics cannot be computed here."""
        reasons = {name: about["unavailable"] for name, about in self.about.items()}
        return {name: reason for name, reason in reasons.items() if reason}

    @classmethod
    def build(cls, asked: Mapping[str, Specs], size_px: tuple[int, int]) -> Self:
        """Build metrics by role, and try each network once, since its weights may be missing.

        A wrong name or setting is raised.
        """
        # The asked metrics, each tried on blank frames; why others cannot be computed is stored.
        blank = np.zeros((2, size_px[1], size_px[0], 3), np.uint8)
        metrics = cls({}, {})
        for role, specs in asked.items():
            for name, spec in specs.items():
                metrics.about[name] = about = {"role": role, "asked": spec, "unavailable": None}
                try_out = partial(_try_out, about=about, blank=blank)
                metric = build(f"{role}_metrics", name, spec, try_out)
                if isinstance(metric, Failure):
                    about["unavailable"] = metric.reason
                else:
                    getattr(metrics, role)[name] = metric
                    metrics.described[name] = registry.describe(metric)
        # What each prediction is scored by, asked or not.
        for name, definition in (
            (COVERAGE, "fraction of pixels that were not inpainted"),
            (CONFIDENCE, "coverage times the fraction of tracked frames; no probability"),
        ):
            metrics.about[name] = {
                "role": "frame",
                "unit": "",
                "bounds": [0.0, 1.0],
                "higher_is_better": None,
                "unavailable": None,
                "definition": definition,
            }
        return metrics


def _try_out(metric: Any, about: dict[str, Any], blank: ByteArray) -> None:
    """Add unit, direction, definition, bounds and device of a metric; score blank frames."""
    metric_bounds = getattr(metric, "bounds", UNBOUNDED)
    about |= {
        "unit": metric.unit,
        "higher_is_better": metric.higher_is_better,
        "definition": getattr(metric, "protocol", ""),  # which of the usual definitions it follows
        "bounds": [end if math.isfinite(end) else None for end in metric_bounds],
    }
    if hasattr(metric, "device"):  # of a network; None is the CPU
        about["device"] = metric.device or "cpu"
    if about["role"] == "frame":
        shape = np.shape(metric(blank, blank, None))
        if shape != (2,):
            raise ValueError(f"it returns values of shape {shape} for two frames, expected (2,)")
    if about["role"] == "set":
        frames = blank.repeat(4, 0)
        metric.features(frames, frames)


@dataclass(frozen=True)
class ScoredClip:
    """Clip with its truth, which is prepared once for all predictions."""

    clip: Clip
    num_past: int
    targets: dict[str, Any] = field(default_factory=dict)  # by metric, as it prepares them

    @cached_property
    def truth(self) -> tuple[Context, Target]:
        """Return the clip split with all privileged inputs."""
        return self.clip.split(self.num_past, ~PrivilegedInput.NONE)

    @cached_property
    def pixel_sets(self) -> Mapping[str, BoolArray]:
        """Return masks [F, H, W] of pixels to score apart; none without exact depth."""
        return strata(*self.truth)

    @cached_property
    def facts(self) -> dict[str, float]:
        """Return attributes of the clip: of its path and times, and fractions of future pixels."""
        fractions = {name: float(mask.mean()) for name, mask in self.pixel_sets.items()}
        interval_s = float(np.diff(self.clip.times_s).mean())
        return {"interval_s": interval_s} | clip_facts(*self.truth) | fractions

    def values(
        self, name: str, metric: Any, predicted: ByteArray, masks: Sequence[BoolArray | None]
    ) -> Sequence[FloatArray]:
        """Return the values [F] of a frame metric for each mask.

        Metrics may be faster with all masks at once, `over(predicted, target, masks)`, and with a
        target that `prepare(target)` returned for all predictions.
        """
        target = self.truth[1].frames
        if not hasattr(metric, "over"):
            return [metric(predicted, target, mask) for mask in masks]
        if hasattr(metric, "prepare"):
            if name not in self.targets:
                self.targets[name] = metric.prepare(target)
            target = self.targets[name]
        return metric.over(predicted, target, masks)


def score(clip: ScoredClip, prediction: Prediction, metrics: Metrics) -> Scores:
    """Return the scores of a prediction; raise BadData for another size or number."""
    num_samples = len(prediction.frames)
    expected = (num_samples, *clip.truth[1].frames.shape)
    if prediction.frames.shape != expected:
        raise BadData(
            f"predicted frames have shape {prediction.frames.shape}, expected (S, "
            f"{str(expected[1:])[1:]}"
        )
    num_futures = 1 if prediction.motion is None else len(prediction.motion.futures)
    if num_futures not in (1, num_samples):
        raise BadData(
            f"{num_futures} predicted futures for {num_samples} samples, expected one each or one "
            "for all"
        )
    samples: defaultdict[str, list[FloatArray]] = defaultdict(list)
    for sample in range(num_samples):
        if sample % 5 == 4:  # 100 samples of 256x256 took 1.2 GB more without this, with LPIPS
            release_free_memory()
        for name, values in _values(clip, prediction, sample, metrics):
            samples[name].append(values)
    stacked = {name: np.array(values, float)[None] for name, values in samples.items()}
    for name, values in stacked.items():
        if values.shape[1:] != expected[:2] and FEATURES not in name:
            raise BadData(
                f"{name} has values of shape {values.shape[2:]}, expected ({expected[1]},)"
            )
    return Scores([clip.clip.name], stacked)


def _values(
    clip: ScoredClip, prediction: Prediction, sample: int, metrics: Metrics
) -> Iterator[tuple[str, FloatArray]]:
    """Yield columns with the values [F] of one sample."""
    predicted = prediction.frames[sample]
    masks: dict[str, BoolArray | None] = {"": None}
    if prediction.covered is not None:
        covered = prediction.covered[sample]
        masks["@covered"] = covered
        yield COVERAGE, covered.mean(axis=(1, 2))
    if prediction.confidence is not None:
        yield CONFIDENCE, prediction.confidence[sample]
    masks |= {f"@{name}": mask for name, mask in clip.pixel_sets.items()}
    motion, (context, target) = prediction.motion, clip.truth
    futures = None  # predicted and true
    if motion is not None and context.past is not None and target.trajectory is not None:
        true_poses, times_s = target.trajectory.world_from_cam, target.trajectory.times_s
        poses = motion.futures[sample % len(motion.futures)]  # all samples may share one future
        futures = (
            relative_to_last_observed(motion.past, poses, times_s),
            relative_to_last_observed(context.past, true_poses, times_s),
        )
    for name, metric in metrics.frame.items():
        values = clip.values(name, metric, predicted, [*masks.values()])
        yield from zip((name + suffix for suffix in masks), values, strict=True)
    if futures is not None:
        for name, trajectory_metric in metrics.trajectory.items():
            yield name, trajectory_metric(*futures)
    for name, set_metric in metrics.set.items():
        if sample == 0:
            if name not in clip.targets:
                clip.targets[name] = set_metric.features(context.frames, target.frames)
            yield name + FEATURES, clip.targets[name]
        if sample < set_metric.max_samples:
            yield name + FEATURES, set_metric.features(context.frames, predicted)
