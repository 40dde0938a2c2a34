"""Error budget of a method: changes of its scores with stages from ground truth."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geovp.progress import tracked
from geovp_benchmarks.error_budget.oracles import STAGES, OracleClip, Oracles, with_true_depth
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.running.scoring import Metrics
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_benchmarks.tables.notes import on_numbers
from geovp_benchmarks.tables.table_model import Column, Row, Table
from geovp_classic import registry
from geovp_classic.errors import BadData, Incompatible
from geovp_classic.interfaces import Dataset, FrameMetric
from geovp_classic.predictors.geometric import GeometricPredictor
from geovp_classic.types import FloatArray, PrivilegedInput


@dataclass(frozen=True)
class MeasuredMethod:
    """Pose source with a renderer, and the clips and metrics of its matrix."""

    label: str
    predictor: GeometricPredictor
    matrix: Matrix
    dataset: Dataset
    num_clips: int
    metrics: Mapping[str, FrameMetric]
    unavailable: Sequence[str] = ()  # metrics that cannot be computed here, with the reason

    @property
    def steps(self) -> list[int]:
        """Return the future steps that are scored, from 0."""
        return [step for step in (0, 4, 9, 14, 19) if step < self.matrix.num_future]

    def score(
        self, variants: Iterable[Oracles]
    ) -> tuple[dict[Oracles, FloatArray], list[str], list[str]]:
        """Return scores [metrics, clips] by variant, the clips, and why variants are impossible.

        Scores of an impossible variant are NaN. Raises Incompatible if all are, on all clips.
        """
        shape = len(self.metrics), self.num_clips
        scores = {variant: np.full(shape, np.nan) for variant in variants}
        names: list[str] = []
        reasons: list[str] = []
        for number in tracked(range(self.num_clips)):
            clip = self.dataset[number]
            names.append(clip.name)
            oracle = OracleClip(self.predictor, clip, self.matrix.num_past, self.steps)
            for variant, values in scores.items():
                try:
                    frames = oracle.frames(variant)
                    means = [metric(*frames, None).mean() for metric in self.metrics.values()]
                    values[:, number] = means
                except Incompatible as error:
                    reasons.append(str(error))
        if reasons and np.isnan([*scores.values()]).all():
            raise Incompatible(reasons[0])
        return scores, names, [*dict.fromkeys(reasons)]


def read_method(
    matrix: Matrix, label: str | None, limit: int | None, needs: PrivilegedInput
) -> MeasuredMethod:
    """Return a method of a matrix with the first clips; the label may be None for the only one.

    `needs` are inputs of the clips beyond those of the method. Raises BadData unless the method is
    a pose source with a renderer, and a frame metric is available.
    """
    labels = [method.label for method in matrix.methods if method.renderer]
    if label is None and len(labels) == 1:
        label = labels[0]
    if label not in labels:
        raise BadData(
            f"--method is {label or 'not given'}, expected a pose source with a renderer of the "
            f"matrix{registry.nearest(label or '', labels)}"
        )
    predictor = registry.build("predictors", matrix.predictor_spec(label), label)
    dataset = matrix.build_dataset(predictor.needs | needs)
    num_clips = len(range(len(dataset))[:limit])
    metrics = Metrics.build({"frame": matrix.metrics["frame"]}, matrix.size_px)
    unavailable = [
        f"{name} is unavailable: {reason}" for name, reason in metrics.unavailable.items()
    ]
    if not metrics.frame:
        raise BadData("; ".join(unavailable) or "no frame metric: name one in [metrics]")
    return MeasuredMethod(label, predictor, matrix, dataset, num_clips, metrics.frame, unavailable)


def error_budget(method: MeasuredMethod) -> list[Table]:
    """Return the paired changes by stage, in a table per metric.

    *Alone* replaces one stage of the forecast, *one by one* adds stages from top to bottom, so
    that the changes add up, and *without* removes one stage from the truth.
    """
    clip = method.dataset[0]
    missing = {}
    if with_true_depth(method.predictor.renderer, clip) is None:
        missing["depth"] = "recorded depth or right images (--stereo), and a renderer with a depth"
    if clip.moving is None:
        missing["dynamic objects"] = "masks of dynamic objects, as synthetic clips have"
    stages = [stage for stage in STAGES if stage not in missing]
    # The variants before and after each change, each scored once per clip.
    nothing, everything = Oracles(), Oracles(stages)
    pairs: dict[str, dict[str, tuple[Oracles, Oracles]]] = {}
    for number, stage in enumerate(stages):
        before = Oracles(stages[:number])
        pairs[stage] = {
            "alone": (nothing, Oracles({stage})),
            "one by one": (before, before | {stage}),
            "without": (everything, everything - {stage}),
        }
    variants = (variant for row in pairs.values() for pair in row.values() for variant in pair)
    scores, names, reasons = method.score(variants)
    notes = [
        *(f"{stage} is not measured: it needs {needed}" for stage, needed in missing.items()),
        *reasons,
        *method.unavailable,
    ]
    title = (
        f"{method.label}: {len(names)} clips of {method.dataset.name}, every "
        f"{method.matrix.stride} frames, horizons {', '.join(str(k + 1) for k in method.steps)}"
    )
    tables, intervals = [], Intervals()
    for number, (name, metric) in enumerate(method.metrics.items()):
        decimals = 2 if metric.unit == "dB" else 4
        columns = [Column(key, key, None, f".{decimals}f") for key in pairs[stages[0]]]
        rows = []
        for stage, row in pairs.items():
            changes = {
                key: intervals.interval(scores[after][number] - scores[before][number], names)
                for key, (before, after) in row.items()
            }
            rows.append(Row(stage, changes, num_clips=len(names)))
        forecast, truth = (np.nanmean(scores[each][number]) for each in (nothing, everything))
        heading = (
            f"{title}: change of {name.upper()} ({metric.unit or 1}), forecast "
            f"{forecast:.{decimals}f}, truth {truth:.{decimals}f}"
        )
        table = Table(name, heading, columns, rows, has_differences=True)
        tables.append(replace(table, notes=[*notes, *on_numbers(table)]))
    return tables
