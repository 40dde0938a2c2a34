"""Tables of means and their intervals with the privileged inputs of each method; `formats` turns
them into text.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from geovp_benchmarks.analysis import intervals, statistics
from geovp_benchmarks.analysis.statistics import Cube
from geovp_benchmarks.results import provenance
from geovp_benchmarks.results.score_names import ALWAYS_SCORED, COVERAGE
from geovp_benchmarks.results.store import Method, Results, Rows
from geovp_benchmarks.results.stored_facts import (
    bounds,
    higher_is_better,
    legend,
    marks,
    summary,
    title,
)
from geovp_benchmarks.tables.table_model import (
    EVERYTHING,
    MIN_EFFECTIVE,
    SIGNIFICANT,
    Choice,
    Column,
    MethodScores,
    Spread,
    Table,
    best,
    different,
)
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.types import BoolArray, FloatArray

SAMPLE_COUNTS = (2, 5, 10, 20, 50)
BOLD = (
    "Bold: no method with the same or fewer privileged inputs is significantly better (paired "
    "differences over common clips, p < .05 after Bonferroni's correction)."
)
FEW = "No value is in bold if it or a better rival has fewer than eight effective clips."
SIMULTANEOUS = "simultaneous 95 % intervals (Bonferroni) of the mean paired difference"
STAR = "*: the interval excludes zero."
EXACT = "{} has no {}: what others have is printed without a test."
BEST_OF = (
    "Oracle-selected: a best sample is selected with the real future, which is unavailable at "
    "prediction time, so such methods compete only with each other. 'best of N' selects per "
    "metric, as in the papers; 'by' a metric, one sample for all columns."
)


def build(
    results: Results,
    spread: Spread = "interval",
    *,
    strict: bool = False,
    choice: Choice = EVERYTHING,
) -> list[Table]:
    """Return the main table (whole frames and poses), then those over sets of pixels and samples.

    Clips that a method could not predict count as copies of the last frame; `strict` leaves them
    out. Of a choice of columns there is but one table, and methods compete among those chosen.
    """
    protocol, methods = results.protocol(), choice.select(results.methods())
    ran = [method for method in methods if method.status in ("done", "partial")]
    failures = {method.name: results.failures(method.name) for method in ran}
    scores = {method.name: results.scores(method.name) for method in ran}
    if strict:
        for name, rows in scores.items():
            scores[name] = rows.of_clips({*rows.clip.categories} - failures[name].keys())
    keys = _keys(scores.values())
    metrics: Mapping[str, Mapping[str, Any]] = protocol["metrics"]
    main = choice.columns(metrics, keys) or [key for key in metrics if key not in ALWAYS_SCORED]
    lines = [line for method in ran for line in _lines(method, scores[method.name], protocol)]
    table_rows = choice.rows(lines)
    headings = {key: title(key) for key in main}
    tables = [_table("scores", "whole frames and poses", headings, protocol, table_rows, methods)]
    if not choice.metrics:
        frame_metrics = [name for name in main if metrics[name]["role"] == "frame"]
        tables += _pixel_tables(frame_metrics, keys, protocol, table_rows, methods)
        tables += [table for name in main for table in _sampled(name, protocol, methods, scores)]
    excuses = [
        _excuse(method, failures[method.name], strict) for method in ran if failures[method.name]
    ]
    tables = [replace(table, spread=spread) for table in tables]
    return [
        replace(table, notes=(table.notes[0], *_used(table), *table.notes[1:], *excuses))
        for table in tables
    ]


def _pixel_tables(
    metrics: Sequence[str],
    keys: Sequence[str],
    protocol: Mapping[str, Any],
    table_rows: Sequence[MethodScores],
    methods: Sequence[Method],
) -> list[Table]:
    """Return a table per metric that was also taken over sets of pixels."""
    tables = []
    for name in metrics:
        sets = [key for key in keys if key.startswith(f"{name}@")]
        if sets:
            columns = {name: "all pixels"}
            columns |= {key: f"{key.partition('@')[2]} pixels" for key in sets}
            columns |= {COVERAGE: title(COVERAGE)} if COVERAGE in keys else {}
            heading = f"{title(name)} over sets of pixels"
            tables.append(_table(f"pixels-{name}", heading, columns, protocol, table_rows, methods))
    return tables


def _excuse(method: Method, failures: Mapping[str, str], strict: bool) -> str:
    """Return which clips a method could not predict, why, and how they count."""
    treated = (
        "left out" if strict else "scored as copies of the last frame (--strict leaves them out)"
    )
    names = ", ".join([*failures][:3]) + (" ..." if len(failures) > 3 else "")
    reasons = "; ".join(dict.fromkeys(failures.values()))
    count = f"{len(failures)} of {method.num_clips} clips could not be predicted"
    return f"{method.label}: {count}, {treated}: {names}: {reasons}."


def against(
    results: Results, name: str, *, strict: bool = False, choice: Choice = EVERYTHING
) -> Table:
    """Return paired differences of the main table's methods from one, over their common clips.

    A method with samples is compared by its mean over them.
    """
    main = build(results, strict=strict, choice=choice.including(name))[0]
    names = [method.name for method in main.rows]
    matches = (
        method
        for method in main.rows
        if method.name == name or method.name.startswith(f"{name}, mean of ")
    )
    reference = next(matches, None)
    if reference is None:
        raise BadData(f"no method is called {name!r}{registry.nearest(name, names)}")
    exact = [
        column.key
        for column in main.columns
        if column.higher_is_better is False and reference.has_no_error(column.key)
    ]
    others = [method for method in main.rows if method is not reference and method.num_clips]
    level = 1 - SIGNIFICANT / max(len(others), 1)
    clips = results.protocol()["clips"]
    rows = [_difference(method, reference, clips, exact, level) for method in others]
    columns = tuple(
        column for column in main.columns if any(column.key in row.values for row in rows)
    )
    starred = frozenset(
        (row.name, column.key)
        for column in columns
        if column.key not in exact
        for row in different(rows, column)
    )
    heading = f"{main.title.partition(':')[0]}: differences from {name}"
    table = Table("against", heading, columns, tuple(rows), (), frozenset(), starred=starred)
    kind = _used(table)[0].replace("95 % interval of the mean", SIMULTANEOUS)
    notes = [main.notes[0], kind, *[STAR] * bool(starred)]
    if exact:
        notes.append(EXACT.format(name, ", ".join(map(title, exact))))
    return replace(table, notes=tuple(notes))


def _difference(
    method: MethodScores,
    reference: MethodScores,
    clips: Sequence[str],
    exact: Sequence[str],
    level: float,
) -> MethodScores:
    """Return a method's values less those of the reference, which has no error in `exact`."""
    values = {
        key: array - reference.values[key]
        for key, array in method.values.items()
        if key in reference.values
    }
    has_both = np.isfinite(np.array([*values.values()])).any(axis=0)
    return MethodScores.of(
        method.name,
        method.marks,
        values,
        clips,
        has_both,
        method.by_truth,
        method.protocol,
        dict.fromkeys(exact, (0.0, np.inf)),
        level,
    )


def _used(table: Table) -> list[str]:
    """Return notes on intervals, effective sample sizes and bold values, where there are any."""
    shown = [
        (row, column)
        for row in table.rows
        for column in table.columns
        if column.key in row.estimates
    ]
    behind = "".join(table.texts(row, column)[1] for row, column in shown)
    words = intervals.KIND if table.spread == "interval" else statistics.KIND
    kind = f"{words}; a" if "[" in behind or "±" in behind else "A"
    kind += " clip's value is the mean over its steps."
    if table.spread == "interval" and any(
        int(row.estimates[column.key].count) in (1, 2) for row, column in shown
    ):
        kind += " Fewer than 3 clips give no interval."
    if any("(" in table.clips(row) for row in table.rows):
        kind += " (n) behind the clips: how many independent ones they are worth."
    has_few = any(
        row.intervals[column.key].effective < MIN_EFFECTIVE
        for row, column in shown
        if column.higher_is_better is not None
    )
    return [kind, *[BOLD] * bool(table.best), *[FEW] * has_few]


def _table(
    name: str,
    heading: str,
    columns: Mapping[str, str],  # key -> words
    protocol: Mapping[str, Any],
    rows: Sequence[MethodScores],
    methods: Sequence[Method],
) -> Table:
    abouts = {key: protocol["metrics"][key.partition("@")[0]] for key in columns}
    made = tuple(_column(key, words, abouts[key], rows) for key, words in columns.items())
    shown = {key.partition("@")[0]: about for key, about in abouts.items()}
    notes, bold = tuple(_notes(protocol, shown, methods)), best(rows, made, protocol["clips"])
    return Table(name, f"{protocol['name']}: {heading}", made, tuple(rows), notes, bold)


def _column(key: str, words: str, about: Mapping[str, Any], rows: Sequence[MethodScores]) -> Column:
    means = np.array([float(row.estimates[key].mean) for row in rows if key in row.estimates])
    known = means[np.isfinite(means)]
    higher = higher_is_better(key, about)
    unit = f" ({about['unit']})" if about.get("unit") else ""
    arrow = "" if higher is None else "↑" if higher else "↓"
    decimals = 2 if np.abs(known).max(initial=0.0) >= 10 else 3
    unavailable = bool(about["unavailable"]) and not len(known)
    return Column(key, f"{words}{unit} {arrow}".strip(), higher, decimals, unavailable)


def _lines(method: Method, rows: Rows, protocol: Mapping[str, Any]) -> list[MethodScores]:
    """Return the scores of a method; with several samples also those of the best ones."""
    keys = _keys([rows])
    cubes = {key: statistics.cube(rows, key) for key in keys}
    abouts = {key: protocol["metrics"].get(key.partition("@")[0], {}) for key in keys}
    higher = {key: higher_is_better(key, about) for key, about in abouts.items()}
    ends = {key: bounds(key, about) for key, about in abouts.items()}
    clips, lines = protocol["clips"], []
    scored = _is_among(clips, rows.clip.categories)
    for suffix, reduce in _reductions(cubes, higher, protocol).items():
        values = {
            key: _aligned(cube, reduce(cube, higher[key]), clips) for key, cube in cubes.items()
        }
        by_truth, own = (
            reduce is not statistics.mean_of_samples,
            provenance.method_id(method, protocol),
        )
        lines.append(
            MethodScores.of(
                method.label + suffix, marks(method), values, clips, scored, by_truth, own, ends
            )
        )
    return lines


def _is_among(clips: Sequence[str], scored: Sequence[str]) -> BoolArray:
    """Return which clips [N] a method has scores of."""
    names = set(scored)
    return np.array([clip in names for clip in clips], bool)


def _aligned(cube: Cube, values: FloatArray, clips: Sequence[str]) -> FloatArray:
    """Return the means over steps of values [n, F] in the order of all clips [N], NaN for those
    that the cube lacks.
    """
    steps = statistics.over_steps(values)
    if cube.clips == tuple(clips):
        return steps
    means = dict(zip(cube.clips, steps.tolist(), strict=True))
    return np.array([means.get(clip, np.nan) for clip in clips])


def _reductions(
    cubes: Mapping[str, Cube], higher: Mapping[str, bool | None], protocol: Mapping[str, Any]
) -> dict[str, statistics.Reduction]:
    """Return the reductions over samples, by the suffix of the method's name."""
    count = max((cube.values.shape[1] for cube in cubes.values()), default=1)
    if count == 1:
        return {"": statistics.mean_of_samples}
    reductions: dict[str, statistics.Reduction] = {
        f", mean of {count}": statistics.mean_of_samples,
        f", best of {count}": statistics.best_of_samples,
    }
    for judge in protocol["metrics"]:
        rises = higher.get(judge)
        if rises is not None:
            reductions[f", best of {count} by {title(judge)}"] = statistics.best_by(
                cubes[judge], rises
            )
            break
    return reductions


def _sampled(
    name: str, protocol: Mapping[str, Any], methods: Sequence[Method], rows: Mapping[str, Rows]
) -> list[Table]:
    """Return the expected best of k samples in one metric, where a method has several samples."""
    about = protocol["metrics"][name]
    higher = higher_is_better(name, about)
    if higher is None:
        return []
    many = [method for method in methods if method.name in rows and method.num_samples > 1]
    curves = [
        statistics.expected_best(statistics.cube(rows[method.name], name), higher)
        for method in many
    ]
    most = max((curve.shape[1] for curve in curves), default=1)
    if most < 2:
        return []
    counts = sorted({1, most, *(count for count in SAMPLE_COUNTS if count < most)})
    clips, lines = protocol["clips"], []
    for method, curve in zip(many, curves, strict=True):
        cube = statistics.cube(rows[method.name], name)
        values = {
            f"{name} of {k}": _aligned(cube, curve[:, k - 1 : k], clips)
            for k in counts
            if k <= curve.shape[1]
        }
        ends, own = (
            dict.fromkeys(values, bounds(name, about)),
            provenance.method_id(method, protocol),
        )
        scored = _is_among(clips, cube.clips)
        lines.append(
            MethodScores.of(
                method.label, marks(method), values, clips, scored, protocol=own, bounds=ends
            )
        )
    columns = tuple(_column(f"{name} of {k}", f"best of {k}", about, lines) for k in counts)
    heading = (
        f"{protocol['name']}: {title(name)} of the best of k samples, on average over all sets of k"
    )
    notes, bold = tuple(_notes(protocol, {name: about}, many)), best(lines, columns, clips)
    return [Table(f"samples-{name}", heading, columns, tuple(lines), notes, bold)]


def _notes(
    protocol: Mapping[str, Any], shown: Mapping[str, Any], methods: Sequence[Method]
) -> list[str]:
    notes = [f"{summary(protocol)}."]
    if any(method.num_samples > 1 for method in methods):
        notes.append(BEST_OF)
    notes += legend(methods)
    for name, about in shown.items():
        if about["unavailable"]:
            notes.append(f"{title(name)}: unavailable: {about['unavailable']}.")
        elif about.get("definition"):
            notes.append(f"{title(name)}: {about['definition']}.")
    for method in methods:
        if method.status == "partial":
            notes.append(
                f"{method.label}: partial: {method.num_clips} of {len(protocol['clips'])} clips; "
                "run again."
            )
        elif method.status != "done":
            notes.append(f"{method.label}: {method.status}: {method.reason}.")
    outdated = [method.label for method in methods if method.num_outdated]
    if outdated:
        notes.append(
            f"Computed by another version of the code, in whole or in part: {', '.join(outdated)}."
        )
    return [*notes, *provenance.weights_notes(methods), *provenance.id_notes(methods, protocol)]


def _keys(tables: Iterable[Rows]) -> list[str]:
    """Return all columns that have scores, in their order."""
    return list(dict.fromkeys(key for rows in tables for key in rows.metric.categories))
