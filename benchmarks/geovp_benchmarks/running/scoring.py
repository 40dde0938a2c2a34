"""Score one prediction against one clip: the rows that go into a parquet part."""

import hashlib
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

from geovp_benchmarks.results.score_names import CONFIDENCE, COVERAGE
from geovp_benchmarks.results.store import Rows
from geovp_benchmarks.running.profiling import release_free_memory
from geovp_classic.errors import BadData
from geovp_classic.interfaces import FrameMetric, TrajectoryMetric
from geovp_classic.metrics.clip_facts import clip_facts
from geovp_classic.metrics.stabilised import Stabilised, turned
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
    Trajectory,
)

EVERYTHING = ~PrivilegedInput.NONE
SAMPLES_PER_RELEASE = (
    5  # of free memory; without, 100 samples of 256x256 take 1.2 GB more (measured with LPIPS)
)


@dataclass(frozen=True)
class Metrics:
    """The metrics of a run, by the names of the columns."""

    frame: Mapping[str, FrameMetric]
    trajectory: Mapping[str, TrajectoryMetric]


@runtime_checkable
class ManyMasks(Protocol):
    """A frame metric that takes several masks at once, for less than it takes one
    after the other.
    """

    def over(
        self, predicted: ByteArray, target: ByteArray, masks: Sequence[BoolArray | None]
    ) -> Sequence[FloatArray]:
        """The metric's values for each of the masks."""
        ...


@runtime_checkable
class PreparesTarget(Protocol):
    """A frame metric that computes something of the target once for many predictions."""

    def prepare(self, target: ByteArray) -> Any:
        """Return what `over` takes in place of the target frames [F, H, W, 3]."""
        ...


@dataclass(frozen=True)
class ScoringContext:
    """A clip with its ground truth for scoring predictions of it; equal predictions are scored
    once.
    """

    clip: Clip
    num_past: int
    scored: dict[Hashable, Sequence[FloatArray]] = field(default_factory=dict)
    prepared_targets: dict[FrameMetric, Any] = field(default_factory=dict)

    @cached_property
    def truth(self) -> tuple[Context, Target]:
        """Return the clip split with all privileged inputs, for scoring alone."""
        return self.clip.split(self.num_past, EVERYTHING)

    @cached_property
    def pixel_sets(self) -> Mapping[str, BoolArray]:
        """Masks [F, H, W] of pixels that are scored apart; none for a clip without exact depth."""
        return strata(*self.truth)

    @cached_property
    def facts(self) -> Mapping[str, float]:
        """The clip's numbers by which results are divided: of its path, and shares of the future's
        pixels.
        """
        return clip_facts(*self.truth) | {
            name: float(mask.mean()) for name, mask in self.pixel_sets.items()
        }

    @cached_property
    def future(self) -> Trajectory | None:
        """The true future relative to the last observed camera, where poses are known."""
        context, target = self.truth
        if context.past is None or target.trajectory is None:
            return None
        return relative_to_last_observed(
            context.past, target.trajectory.world_from_cam, target.trajectory.times_s
        )

    def target_for(self, metric: FrameMetric) -> Any:
        """Return the target frames as the metric takes them, prepared once a clip."""
        frames = self.truth[1].frames
        if not isinstance(metric, PreparesTarget):
            return frames
        if metric not in self.prepared_targets:
            self.prepared_targets[metric] = metric.prepare(frames)
        return self.prepared_targets[metric]


def check(context: ScoringContext, prediction: Prediction) -> None:
    """Raise BadData unless the prediction has the clip's size and a future for each sample or one
    for all.
    """
    expected = context.truth[1].frames.shape
    if prediction.frames.shape[1:] != expected:
        raise BadData(
            f"predicted frames have shape {prediction.frames.shape}, expected (S, "
            f"{str(expected)[1:]}"
        )
    if prediction.motion is not None and len(prediction.motion.futures) not in (
        1,
        len(prediction.frames),
    ):
        futures = len(prediction.motion.futures)
        raise BadData(
            f"{futures} predicted futures for {len(prediction.frames)} samples, expected one "
            "each or one for all"
        )


def score(context: ScoringContext, prediction: Prediction, metrics: Metrics) -> Rows:
    """All rows of one clip, ordered by sample, metric and step; BadData when the prediction is of
    another size.
    """
    check(context, prediction)
    rows: list[tuple[str, int, int, str, float]] = []
    for sample in range(len(prediction.frames)):
        if (
            sample + 1
        ) % SAMPLES_PER_RELEASE == 0:  # scores lie scattered among the memory that metrics freed
            release_free_memory()
        for name, values in _values(context, prediction, sample, metrics):
            rows += [
                (context.clip.name, sample, step, name, value)
                for step, value in enumerate(values, 1)
            ]
    return Rows.of(*zip(*rows, strict=True))


def _values(
    context: ScoringContext, prediction: Prediction, sample: int, metrics: Metrics
) -> Iterator[tuple[str, FloatArray]]:
    """(column, one number per step [F]) of one sample."""
    predicted = prediction.frames[sample]
    covered = None if prediction.covered is None else prediction.covered[sample]
    masks: dict[str, BoolArray | None] = {"": None}
    if covered is not None:
        masks["@covered"] = covered
        yield COVERAGE, covered.mean(axis=(1, 2))
    if prediction.confidence is not None:
        yield CONFIDENCE, prediction.confidence[sample]
    masks.update({f"@{name}": mask for name, mask in context.pixel_sets.items()})
    images = hashlib.sha256(
        predicted.tobytes() + (b"" if covered is None else covered.tobytes())
    ).digest()
    for name, frame_metric in metrics.frame.items():
        if isinstance(frame_metric, Stabilised):
            continue
        if (name, images) not in context.scored:
            context.scored[name, images] = _over(
                context, frame_metric, predicted, list(masks.values())
            )
        for suffix, values in zip(masks, context.scored[name, images], strict=True):
            yield name + suffix, values
    future = _future(context, prediction, sample)
    if future is not None and context.future is not None:
        stabilised = {
            name: metric for name, metric in metrics.frame.items() if isinstance(metric, Stabilised)
        }
        if stabilised:
            frames, seen = turned(predicted, context.clip.intrinsics, future, context.future)
            for name, metric in stabilised.items():
                yield name, _over(context, metric.metric, frames, [seen])[0]
        for name, trajectory_metric in metrics.trajectory.items():
            yield name, trajectory_metric(future, context.future)


def _over(
    context: ScoringContext,
    metric: FrameMetric,
    predicted: ByteArray,
    masks: Sequence[BoolArray | None],
) -> Sequence[FloatArray]:
    target = context.target_for(metric)
    if isinstance(metric, ManyMasks):
        return metric.over(predicted, target, masks)
    return [metric(predicted, target, mask) for mask in masks]


def _future(context: ScoringContext, prediction: Prediction, sample: int) -> Trajectory | None:
    """The predicted future relative to the predicted last observed camera; all samples may share
    one future.
    """
    if prediction.motion is None:
        return None
    futures = prediction.motion.futures
    times_s = context.truth[0].times_s[context.num_past :]
    return relative_to_last_observed(
        prediction.motion.past, futures[sample % len(futures)], times_s
    )
