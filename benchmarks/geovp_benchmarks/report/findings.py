"""The numbers of the findings that open a report, from the main table."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from geovp_benchmarks.plots.material import uses_ground_truth
from geovp_benchmarks.results.stored_facts import facts_of
from geovp_benchmarks.statistics.score import Score
from geovp_benchmarks.tables.table_model import Column, Row, Table


@dataclass(frozen=True)
class Findings:
    """The best methods by the first metric with a direction, of frames if possible.

    Methods compete that are scored on all clips, without samples selected by truth.
    """

    column: Column
    unit: str
    fair: Row | None  # the best without ground truth, other than the baseline
    privileged: Row | None  # the best with ground truth, other than the baseline
    judge: Row | None  # the first of these
    gain: Score | None  # of the judge over the baseline
    is_significant: bool  # as in the table of differences from the baseline
    clip_scores: Mapping[str, float]  # of the judge


def find(
    table: Table, differences: Table | None, protocol: Mapping[str, Any], baseline: str
) -> Findings | None:
    """Return the findings of the main table; None without a metric with a direction.

    `differences` are those of all methods from the baseline, if it has scores.
    """
    columns = [column for column in table.columns if column.higher_is_better is not None]
    if not columns:
        return None
    column = min(columns, key=lambda each: facts_of(each.key, protocol)["role"] != "frame")
    key, clips = column.key, protocol["clips"]
    # Methods with scores on all clips, the best first.
    ranked = [
        method
        for method in table.rows
        if key in method.scores and method.num_clips == len(clips) and not method.is_oracle_selected
    ]
    ranked.sort(key=lambda method: method.scores[key].mean, reverse=bool(column.higher_is_better))
    # The best of each kind, other than the baseline.
    best: dict[bool, Row] = {}
    gain = None
    clip_scores: dict[str, float] = {}
    for method in ranked:
        if method.label != baseline:
            best.setdefault(uses_ground_truth(method.marks), method)
    fair, privileged = best.get(False), best.get(True)
    # The first of them orders the clips, and its gain over the baseline is stated.
    judge = fair or privileged
    if judge:
        values = judge.scores[key].values
        clip_scores = dict(zip(clips, values.tolist(), strict=True))
        for method in differences.rows if differences else ():
            if method.label == judge.label:
                gain = method.scores.get(key)
    unit = facts_of(key, protocol)["unit"]
    marked = differences.marked if differences else ()
    is_significant = judge is not None and (judge.label, key) in marked
    return Findings(column, unit, fair, privileged, judge, gain, is_significant, clip_scores)
