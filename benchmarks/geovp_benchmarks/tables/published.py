"""Stored scores in the layout of a paper's table, and the published numbers in a second table.

The file of a paper declares the published rows, and the methods that reproduce them.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import replace

from geovp_benchmarks.matrix import papers
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.results.stored_facts import MARKS, title
from geovp_benchmarks.statistics.score import Score
from geovp_benchmarks.tables.notes import explained
from geovp_benchmarks.tables.table_model import Row, Table
from geovp_benchmarks.tables.tables import method_scores, table_of


def build(results: Results, name: str) -> list[Table]:
    """Return the table of stored scores, and the published one."""
    paper, stored = papers.load(name), results.protocol()
    published = paper.published
    suffixes = [f" t+{k}" for k in paper.horizons] or [""]
    headings = {
        metric + suffix: title(metric) + suffix
        for metric in paper.metrics["frame"]
        for suffix in suffixes
    }
    headings |= {metric: title(metric) for metric in paper.metrics.get("set", ())}
    methods = _measured(results, published.row, paper.horizons)
    ours = table_of(name, "measured here", headings, methods, stored, f".{published.decimals}f")
    ours = replace(ours, spread="standard-error")
    notes = [f"Protocol: {paper.title}. Differs here: {paper.differences}."]
    if paper.num_clips not in (None, len(stored["clips"])):
        notes.append(f"Not comparable yet: the protocol has {paper.num_clips} clips.")
    return [
        explained(ours, results, notes),
        Table(
            f"{name}-published",
            "Published, not measured here",
            ours.columns,
            [_published(row, suffixes) for row in published.row],
            [f"{published.source}: {published.about}."],
            {(row.name, metric) for row in published.row for metric in row.bold},
            "standard-error",
        ),
    ]


def _measured(
    results: Results, rows: Sequence[papers.PublishedRow], horizons: Sequence[int]
) -> list[Row]:
    """Return the methods that stand for published rows, in their order, then all others.

    Of several samples the best counts for each metric, as in the papers.
    """
    names = {row.method: row.name for row in rows if row.method}
    methods = {method.label: method for method in results.methods() if method.num_clips}
    measured = []
    for label in sorted(methods, key=[*names, *methods].index):
        method = methods[label]
        scores = method_scores(results, [method], horizons=horizons)[-1]
        name = names.get(label, scores.label)
        name = re.sub(r"\d+ Samples", f"{method.num_samples} Samples", name)
        measured.append(replace(scores, label=name))
    return measured


def _published(row: papers.PublishedRow, suffixes: Sequence[str]) -> Row:
    """Return a published row."""
    scores = {}
    for metric, by_horizon in row.numbers.items():
        for suffix, numbers in zip(suffixes, by_horizon, strict=False):
            mean, error = [*numbers, math.nan][:2]
            scores[metric + suffix] = Score(mean, standard_error=error)
    marks = (MARKS[name][0] for name in row.privileged_inputs)
    return Row(row.name, scores, "".join(marks))
