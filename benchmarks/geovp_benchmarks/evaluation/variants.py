"""Scores of variants of one method on the same clips, and tables of their paired changes."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from geovp_benchmarks.analysis.intervals import KIND
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.progress import Progress, tracked
from geovp_benchmarks.results.score_names import UNBOUNDED
from geovp_benchmarks.tables.table_model import Column, MethodScores, Score, Table
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

    def clips(self, progress: Progress) -> Iterator[Clip]:
        """Yield the clips; report each as done when the next one is asked for."""
        clips = map(self.dataset.__getitem__, range(self.num_clips))
        return tracked(clips, self.num_clips, progress)


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

    metrics: Mapping[str, FrameMetric]
    clips: Sequence[str]  # [N]
    values: Mapping[Variant, FloatArray]  # [N, M]; NaN where a variant is impossible
    reasons: Sequence[str]  # why variants are impossible


def score(
    clips: Iterable[Clip],
    metrics: Mapping[str, FrameMetric],
    variants: Iterable[Variant],
    prepare: Callable[[Clip], Predict[Variant]],
) -> Scores[Variant]:
    """Score all variants on all clips; raise Incompatible if all are impossible."""
    values: dict[Variant, list[list[float]]] = {variant: [] for variant in variants}
    names = []
    reasons: dict[str, None] = {}
    for clip in clips:
        names.append(clip.name)
        predict = prepare(clip)
        for variant, rows in values.items():
            try:
                frames, real = predict(variant)
                rows.append([metric(frames, real, None).mean() for metric in metrics.values()])
            except Incompatible as error:
                reasons[str(error)] = None
                rows.append([np.nan] * len(metrics))
    arrays = {variant: np.array(rows) for variant, rows in values.items()}
    if np.isnan(list(arrays.values())).all():
        raise Incompatible(next(iter(reasons)))
    return Scores(metrics, names, arrays, list(reasons))


def change_tables(
    title: str,
    scores: Scores[Variant],
    levels: Mapping[str, Variant],
    changes: Mapping[str, Mapping[str, FloatArray]],  # [N, M] by row and column
    notes: Sequence[str] = (),
) -> list[Table]:
    """Return a table of paired changes per metric, with the scores of `levels` in its title."""
    tables = []
    for number, (name, metric) in enumerate(scores.metrics.items()):
        decimals = 2 if metric.unit == "dB" else 4
        columns = [Column(key, key, None, decimals) for key in next(iter(changes.values()))]
        rows = []
        for label, cells in changes.items():
            changed = {
                key: Score.of(values[:, number], scores.clips, UNBOUNDED)
                for key, values in cells.items()
            }
            rows.append(MethodScores(label, changed, num_clips=len(scores.clips)))
        means = (np.nanmean(scores.values[variant][:, number]) for variant in levels.values())
        texts = ", ".join(
            f"{label} {mean:.{decimals}f}" for label, mean in zip(levels, means, strict=True)
        )
        heading = f"{title}: change of {name.upper()} ({metric.unit or 1}), {texts}"
        all_notes = (*notes, *scores.reasons, KIND)
        tables.append(Table(name, heading, columns, rows, all_notes, starred=()))
    return tables
