"""Scores of variants of one method on the same clips, and tables of their paired changes."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from geovp_benchmarks.analysis.intervals import KIND, Interval, interval, sequence_of
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.interfaces import Dataset, FrameMetric
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import ByteArray, Clip, FloatArray, PrivilegedInput

Variant = TypeVar("Variant")
Predict = Callable[[Variant], tuple[ByteArray, ByteArray]]  # predicted and real [N, H, W, 3]


@dataclass(frozen=True)
class Method:
    """Pose source with a renderer, and the clips and metrics of its matrix."""

    label: str
    predictor: GeometricPredictor
    matrix: Matrix
    dataset: Dataset
    num_clips: int
    metrics: Mapping[str, FrameMetric]

    @property
    def steps(self) -> list[int]:
        """Return the future steps that are scored, from 0."""
        return [step for step in (0, 4, 9, 14, 19) if step < self.matrix.num_future]

    @property
    def title(self) -> str:
        """Return the method, the clips and the horizons in words."""
        horizons = ", ".join(str(step + 1) for step in self.steps)
        return (
            f"{self.label}: {self.num_clips} clips of {self.dataset.name}, "
            f"every {self.matrix.stride} frames, horizons {horizons}"
        )

    def clips(self) -> Iterator[tuple[str, Clip]]:
        """Yield the clips, each with the name of its sequence."""
        for index in range(self.num_clips):
            clip = self.dataset[index]
            yield sequence_of(clip.name), clip


def read_method(
    matrix: Matrix, label: str | None, limit: int | None, needs: PrivilegedInput
) -> Method:
    """Return a method of a matrix with the first clips; the label may be None for the only one.

    `needs` are inputs of the clips beyond those of the method. Raises BadData unless the method is
    a pose source with a renderer.
    """
    plans = {plan.label: plan for plan in matrix.methods if plan.kind == "geometric"}
    if label is None and len(plans) == 1:
        (label,) = plans
    if label not in plans:
        raise BadData(
            f"--method {label!r}, expected a pose source with a renderer of the matrix"
            f"{registry.nearest(label or '', plans)}"
        )
    predictor = GeometricPredictor(
        **{
            role: registry.build(key[0], matrix.specs[key], ".".join(key))
            for role, key in plans[label].components.items()
        }
    )
    dataset = matrix.build_dataset(predictor.needs | needs)
    num_clips = len(range(len(dataset))[:limit])
    metrics = {
        name: registry.build("frame_metrics", spec) for name, spec in matrix.frame_metrics.items()
    }
    if not num_clips or not metrics:
        raise BadData(
            f"{matrix.name} has {num_clips} clips and {len(metrics)} frame metrics, expected some"
        )
    return Method(label, predictor, matrix, dataset, num_clips, metrics)


@dataclass(frozen=True)
class Scores(Generic[Variant]):
    """Scores by M metrics on N clips, averaged over the scored steps."""

    values: Mapping[Variant, FloatArray]  # [N, M]; NaN where a variant is impossible
    sequences: Sequence[str]  # [N]
    reasons: Sequence[str]  # why variants are impossible


def score(
    clips: Iterable[tuple[str, Clip]],  # with the name of the sequence
    metrics: Iterable[FrameMetric],
    variants: Iterable[Variant],
    prepare: Callable[[Clip], Predict[Variant]],
) -> Scores[Variant]:
    """Score all variants on all clips; raise Incompatible if all are impossible."""
    values: dict[Variant, list[list[float]]] = {variant: [] for variant in variants}
    sequences = []
    reasons: dict[str, None] = {}
    for sequence, clip in clips:
        sequences.append(sequence)
        predict = prepare(clip)
        for variant, rows in values.items():
            try:
                frames, real = predict(variant)
                rows.append([float(metric(frames, real, None).mean()) for metric in metrics])
            except Incompatible as error:
                reasons[str(error)] = None
                rows.append([np.nan for _ in metrics])
    arrays = {variant: np.array(rows) for variant, rows in values.items()}
    if np.isnan(list(arrays.values())).all():
        raise Incompatible(next(iter(reasons)))
    return Scores(arrays, sequences, list(reasons))


@dataclass(frozen=True)
class ChangeTable:
    """Paired changes of M metrics on N clips."""

    title: str
    metrics: Mapping[str, FrameMetric]
    sequences: Sequence[str]  # [N]
    levels: Mapping[str, FloatArray]  # [N, M], scores that are stated above the tables
    changes: Mapping[str, Mapping[str, FloatArray]]  # [N, M], by row and column
    notes: Sequence[str]

    def interval(self, row: str, column: str, metric: str) -> Interval:
        """Return the mean change with its interval."""
        values = self.changes[row][column][:, list(self.metrics).index(metric)]
        return interval(values, np.array(self.sequences))

    def lines(self) -> Iterator[str]:
        """Yield a Markdown table per metric, and the notes."""
        yield self.title
        for number, (name, metric) in enumerate(self.metrics.items()):
            digits = 2 if metric.unit == "dB" else 4
            levels = [
                f"{label} {np.nanmean(values[:, number]):.{digits}f}"
                for label, values in self.levels.items()
            ]
            lines = [["", *next(iter(self.changes.values())), "clips"]]
            for row, columns in self.changes.items():
                texts = [
                    change_text(self.interval(row, column, name), digits) for column in columns
                ]
                is_finite = np.isfinite([values[:, number] for values in columns.values()])
                lines.append([row, *texts, str(is_finite.all(axis=0).sum())])
            yield from ("", f"{heading(name, metric)}: {', '.join(levels)}", "", *grid(lines))
        yield from ("", *self.notes)
        if len(self.sequences) > 2:
            yield KIND


def change_text(change: Interval, digits: int) -> str:
    """Format a change with its interval, if there is one."""
    ends = [f"{end:+.{digits}f}" for end in (change.low, change.high) if np.isfinite(end)]
    return f"{change.mean:+.{digits}f} [{', '.join(ends)}]".removesuffix(" []")


def heading(name: str, metric: FrameMetric) -> str:
    """Return the name of a metric with its unit and an arrow to better values."""
    unit = f" ({metric.unit})" if metric.unit else ""
    return f"{name.upper()}{unit} {'↑' if metric.higher_is_better else '↓'}"
