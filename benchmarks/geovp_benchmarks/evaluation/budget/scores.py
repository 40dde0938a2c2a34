"""Variants of one row of a matrix, scored on all its clips; shared by the error budget and the
sensitivity curves.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Self, TypeVar

import numpy as np

from geovp_benchmarks.analysis import intervals
from geovp_benchmarks.analysis.intervals import Interval
from geovp_benchmarks.matrix import schema
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.progress import Progress
from geovp_classic import registry
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.interfaces import Dataset, FrameMetric
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import ByteArray, Clip, FloatArray, PrivilegedInput

SCORED_STEPS = (0, 4, 9, 14, 19)  # of the future frames
Variant = TypeVar("Variant")
Predict = Callable[
    [Variant], tuple[ByteArray, ByteArray]
]  # predicted and real frames [N, H, W, 3] of one clip


@dataclass(frozen=True)
class Subject:
    """A row of a matrix file, the clips, and the metrics."""

    label: str
    predictor: GeometricPredictor
    matrix: Matrix
    dataset: Dataset
    num_clips: int
    first: Clip  # what it has, all have
    metrics: Mapping[str, FrameMetric]

    @classmethod
    def read(cls, chosen: argparse.Namespace, needs: PrivilegedInput) -> Self:
        """The subject of a command line; BadData for a row that is no pose source with a
        renderer.
        """
        read = schema.read(chosen.matrix).with_root(chosen.root)
        read = read.replace(stride=chosen.stride or read.stride)
        label, predictor = find_method(read, chosen.method)
        dataset = read.build_dataset(predictor.needs | needs)
        num_clips = min(len(dataset), chosen.limit or len(dataset))
        metrics = {
            name: registry.build("frame_metrics", spec) for name, spec in read.frame_metrics.items()
        }
        if not num_clips or not metrics:
            raise BadData(
                f"{chosen.matrix} gives {num_clips} clips and {len(metrics)} frame metrics: "
                "expected some"
            )
        return cls(label, predictor, read, dataset, num_clips, dataset[0], metrics)

    @property
    def steps(self) -> tuple[int, ...]:
        """The future frames that are scored."""
        return tuple(step for step in SCORED_STEPS if step < self.matrix.num_future)

    @property
    def about(self) -> str:
        """What is measured, for the head of tables and figures."""
        frames = ", ".join(str(step + 1) for step in self.steps)
        clips = f"{self.num_clips} clip{'s' * (self.num_clips != 1)}"
        return (
            f"{clips} of {self.dataset.name}, every {self.matrix.stride} frames, horizons {frames}"
        )


def find_method(read: Matrix, label: str | None) -> tuple[str, GeometricPredictor]:
    """The row's label and its built components."""
    plans = {plan.label: plan for plan in read.methods}
    geometric = [plan.label for plan in read.methods if plan.kind == "geometric"]
    wanted = label or (geometric[0] if len(geometric) == 1 else "")
    if wanted not in plans:
        raise BadData(
            f"--method {label!r} is no method of the matrix, expected one of "
            f"them{registry.nearest(wanted, plans)}"
        )
    components = {
        role: registry.build(*key[:1], read.specs[key], ".".join(key))
        for role, key in plans[wanted].components.items()
    }
    predictor: Any = components.get("predictor") or GeometricPredictor(**components)
    if not isinstance(predictor, GeometricPredictor):
        raise BadData(
            f"{wanted!r} is no pose source with a renderer: it has no stage that the truth "
            "could replace"
        )
    return wanted, predictor


@dataclass(frozen=True)
class Scores(Generic[Variant]):
    """What every variant scored on every clip."""

    values: Mapping[Variant, FloatArray]  # [N, metrics]; NaN where it could not be made
    reasons: Mapping[Variant, str]  # why not
    subject: Subject
    sequences: Sequence[str]  # [N]

    def level(self, variant: Variant, metric: str) -> Interval:
        """The mean score."""
        return self._interval(self._of(variant, metric))

    def change(self, variants: Sequence[Variant], reference: Variant, metric: str) -> Interval:
        """The paired difference to the reference; of several variants, of their mean."""
        mean = np.mean([self._of(variant, metric) for variant in variants], axis=0)
        return self._interval(mean - self._of(reference, metric))

    def count(self, *variants: Variant) -> int:
        """The clips that all of them could be made of."""
        return int(np.isfinite([self.values[one] for one in variants]).all(axis=(0, 2)).sum())

    @property
    def have_intervals(self) -> bool:
        """Whether any is of the three clips that an interval needs."""
        return max(map(self.count, self.values)) > 2

    def _of(self, variant: Variant, metric: str) -> FloatArray:
        return self.values[variant][:, list(self.subject.metrics).index(metric)]

    def _interval(self, values: FloatArray) -> Interval:
        return intervals.interval(values, np.array(self.sequences))


def score(
    subject: Subject,
    variants: Sequence[Variant],
    prepare: Callable[[Subject, Clip], Predict[Variant]],
    progress: Progress,
) -> Scores[Variant]:
    """All variants on all clips, as means over the scored frames; Incompatible where none can be
    made of any clip.
    """
    values: dict[Variant, list[list[float]]] = {variant: [] for variant in variants}
    reasons: dict[Variant, str] = {}
    sequences: list[str] = []
    for clip in map(subject.dataset.__getitem__, range(subject.num_clips)):
        predict = prepare(subject, clip)
        sequences.append(intervals.sequence_of(clip.name))
        for number, variant in enumerate(variants, 1):
            try:
                frames = predict(variant)
                values[variant].append(
                    [float(one(*frames, None).mean()) for one in subject.metrics.values()]
                )
            except Incompatible as error:
                reasons.setdefault(variant, str(error))
                values[variant].append([np.nan] * len(subject.metrics))
            progress(
                (len(sequences) - 1) * len(variants) + number, subject.num_clips * len(variants)
            )
    scores = Scores(
        {one: np.array(rows) for one, rows in values.items()}, reasons, subject, sequences
    )
    if not any(scores.count(variant) for variant in variants):
        raise Incompatible(next(iter(reasons.values())))
    return scores


def text(interval: Interval, metric: FrameMetric) -> str:
    """A change with its interval, if it has one, in as many digits as the metric's
    unit deserves.
    """
    digits = 2 if metric.unit == "dB" else 4
    limits = (
        f" [{interval.low:+.{digits}f}, {interval.high:+.{digits}f}]"
        if np.isfinite(interval.low)
        else ""
    )
    return f"{interval.mean:+.{digits}f}{limits}"


def heading(name: str, metric: FrameMetric) -> str:
    """A metric's name with its unit and the direction of better."""
    unit = f" ({metric.unit})" if metric.unit else ""
    return f"{name.upper()}{unit} {'↑' if metric.higher_is_better else '↓'}"
