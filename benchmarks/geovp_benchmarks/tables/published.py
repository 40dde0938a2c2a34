"""Stored scores in the layout of a paper's table, and the published numbers in a second table.

Files of the folder `published` declare the published rows, and the methods that reproduce them; the
paper's protocol declares metrics and horizons.
"""

import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from geovp_benchmarks.analysis.intervals import Score
from geovp_benchmarks.matrix import protocols
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.results.stored_facts import MARKS, title
from geovp_benchmarks.tables.table_model import MethodScores, Table
from geovp_benchmarks.tables.tables import explained, method_scores, table_of
from geovp_classic.errors import BadData


def build(results: Results, name: str) -> list[Table]:
    """Return the table of stored scores, and the published one."""
    paper, protocol, stored = load(name), protocols.load(name), results.protocol()
    suffixes = [f" t+{k}" for k in protocol.horizons] or [""]
    headings = {
        metric + suffix: title(metric) + suffix
        for metric in protocol.metrics
        for suffix in suffixes
    }
    methods = _measured(results, paper["row"], protocol.horizons)
    ours = table_of(name, "measured here", headings, methods, stored, paper["decimals"])
    ours = replace(ours, spread="standard-error")
    notes = [f"Protocol: {protocol.paper}. Differs here: {protocol.differences}."]
    if protocol.num_clips not in (None, len(stored["clips"])):
        notes.append(f"Not comparable yet: the protocol has {protocol.num_clips} clips.")
    return [
        explained(ours, results, notes),
        Table(
            f"{name}-published",
            "Published, not measured here",
            ours.columns,
            [_published(row, protocol.metrics, suffixes) for row in paper["row"]],
            [f"{paper['source']}: {paper['about']}."],
            {(row["name"], metric) for row in paper["row"] for metric in row.get("bold", ())},
            "standard-error",
        ),
    ]


def load(name: str) -> Mapping[str, Any]:
    """Return the declaration of a paper's table; raise BadData for an unknown name."""
    folder = Path(__file__).parents[1] / "published"
    paths = {path.stem: path for path in sorted(folder.glob("*.toml"))}
    if name not in paths:
        raise BadData(f"no published table is called {name!r}: give one of {', '.join(paths)}")
    return tomllib.loads(paths[name].read_text("utf-8"))


def _measured(
    results: Results, rows: Sequence[Mapping[str, Any]], horizons: Sequence[int]
) -> list[MethodScores]:
    """Return the methods that stand for published rows, in their order, then all others.

    Of several samples the best counts for each metric, as in the papers.
    """
    names = {row["method"]: row["name"] for row in rows if "method" in row}
    methods = {method.label: method for method in results.methods() if method.num_clips}
    measured = []
    for label in sorted(methods, key=[*names, *methods].index):
        method = methods[label]
        scores = method_scores(results, method, horizons=horizons)[-1]
        name = names.get(label, scores.label)
        name = re.sub(r"\d+ Samples", f"{method.num_samples} Samples", name)
        measured.append(replace(scores, label=name))
    return measured


def _published(
    row: Mapping[str, Any], metrics: Iterable[str], suffixes: Sequence[str]
) -> MethodScores:
    """Return a published row; a score is a list of the mean and, if given, the standard error."""
    scores = {}
    for metric in metrics:
        for suffix, numbers in zip(suffixes, row.get(metric, ()), strict=False):
            mean, error = [*numbers, math.nan][:2]
            scores[metric + suffix] = Score(mean, standard_error=error)
    marks = (MARKS[name][0] for name in row.get("privileged_inputs", ()))
    return MethodScores(row["name"], scores, "".join(marks))
