"""Tables of a results folder: means, intervals, privileged inputs, and notes that explain them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from geovp_benchmarks.results.provenance import weights_notes
from geovp_benchmarks.results.score_names import ALWAYS_SCORED, COVERAGE, UNBOUNDED
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.results.stored_facts import facts_of, labelled, legend, summary, title
from geovp_benchmarks.tables.scores import method_scores
from geovp_benchmarks.tables.table_model import (
    Column,
    MethodScores,
    Score,
    Spread,
    Table,
    best,
    selected_columns,
)
from geovp_classic.errors import BadData


def build(
    results: Results,
    spread: Spread = "interval",
    *,
    strict: bool = False,
    metrics: Sequence[str] = (),
) -> list[Table]:
    """Return the main table (whole frames and poses), then those over sets of pixels.

    Clips that a method could not predict count as copies of the last frame; `strict` leaves them
    out. With named columns there is only one table. Methods compete among those selected.
    """
    main, protocol = _main_table(results, metrics, strict), results.protocol()
    tables = [main] if metrics else [main, *_detail_tables(main, protocol)]
    notes = method_notes(results, strict)
    return [explained(replace(table, spread=spread), protocol, notes) for table in tables]


def against(
    results: Results, name: str, *, strict: bool = False, metrics: Sequence[str] = ()
) -> Table:
    """Return paired differences of the main table's methods from another, over common clips.

    A method with samples is compared by its mean over them. Intervals hold simultaneously.
    """
    main, protocol = _main_table(results, metrics, strict), results.protocol()
    reference = _main_table(results.select(name), (), strict).methods[0]
    others = [m for m in main.methods if m.label != reference.label and m.scores]
    columns = {column.key: column for column in main.columns if column.key in reference.scores}
    errors = [key for key, column in columns.items() if column.higher_is_better is False]
    exact = [key for key in errors if reference.scores[key].is_exact]
    methods, starred = [], set()
    for method in others:
        differences = {}
        for key in columns.keys() & method.scores.keys():
            values = method.scores[key].values - reference.scores[key].values
            bounds = (0.0, np.inf) if key in exact else UNBOUNDED
            level = 1 - 0.05 / len(others)  # Bonferroni
            score = Score.of(values, protocol["clips"], bounds, level)
            differences[key] = score
            if key not in exact and (score.low > 0 or score.high < 0):
                starred.add((method.label, key))
        num_clips = max((score.clips for score in differences.values()), default=0)
        methods.append(replace(method, scores=differences, num_clips=num_clips))
    notes = ["*: the interval excludes zero."] * bool(starred)
    if exact:
        names = ", ".join(map(title, exact))
        notes.append(f"{name} has no {names}, so that other methods are not tested against it.")
    heading = f"{protocol['name']}: differences from {name}"
    table = Table("against", heading, list(columns.values()), methods, starred=starred)
    return explained(table, protocol, notes)


def _main_table(results: Results, metrics: Sequence[str], strict: bool) -> Table:
    """Return the table of whole frames and poses; BadData for a selected method without scores."""
    protocol, methods = results.protocol(), []
    for method in results.methods():
        if method.status in ("done", "partial"):
            methods += method_scores(results, method, strict=strict)
        elif results.selected:
            raise BadData(f"{method.label} has no scores: {method.status}: {method.reason}")
    keys = selected_columns(metrics, [*protocol["metrics"], *_keys(methods)])
    keys = keys or [key for key in protocol["metrics"] if key not in ALWAYS_SCORED]
    headings = {key: title(key) for key in keys}
    return table_of("scores", "whole frames and poses", headings, methods, protocol)


def _detail_tables(main: Table, protocol: Mapping[str, Any]) -> list[Table]:
    """Return a table over sets of pixels for each metric that has such scores."""
    keys, tables = _keys(main.methods), []
    for name in (column.key for column in main.columns):
        pixels = {
            key: f"{key.partition('@')[2]} pixels" for key in keys if key.startswith(f"{name}@")
        }
        if pixels:
            headings = {name: "all pixels", **pixels}
            if COVERAGE in keys:
                headings[COVERAGE] = title(COVERAGE)
            heading = f"{title(name)} over sets of pixels"
            tables.append(table_of(f"pixels-{name}", heading, headings, main.methods, protocol))
    return tables


def _keys(methods: Sequence[MethodScores]) -> list[str]:
    """Return all columns that have scores."""
    return list(dict.fromkeys(key for method in methods for key in method.scores))


def table_of(
    name: str,
    heading: str,
    headings: Mapping[str, str],  # by column
    methods: Sequence[MethodScores],
    protocol: Mapping[str, Any],
) -> Table:
    """Return a table whose columns have as many decimals as their means need."""
    columns = []
    for key, words in headings.items():
        facts = facts_of(key, protocol)
        direction = facts.get("higher_is_better")
        means = [abs(method.scores[key].mean) for method in methods if key in method.scores]
        decimals = 2 if max(means, default=0) >= 10 else 3
        is_unavailable = bool(facts.get("unavailable"))
        columns.append(Column(key, labelled(words, facts), direction, decimals, is_unavailable))
    bold = best(methods, columns, protocol["clips"])
    return Table(name, f"{protocol['name']}: {heading}", columns, methods, best=bold)


def explained(table: Table, protocol: Mapping[str, Any], notes: Sequence[str]) -> Table:
    """Return the table with notes on its numbers before those on its methods."""
    kind = "[low, high]: 95 % interval of the mean over clips"
    if table.starred is not None:
        kind = "[low, high]: simultaneous 95 % intervals (Bonferroni) of the mean paired difference"
    kind += ", block bootstrap within each sequence, since neighbouring clips overlap"
    if table.spread == "standard-error":
        kind = "±: standard error of the mean over clips, as if they were independent"
    before = [f"{summary(protocol)}.", f"{kind}. A clip's value is the mean over its steps."]
    if any("(" in table.clips(method) for method in table.methods):
        before.append("(n) behind the clips: the effective sample size.")
    if table.starred is None:
        before.append(
            "Bold: no method with the same or fewer privileged inputs is significantly better "
            "(paired differences over common clips, p < .05 after Bonferroni's correction). "
            "With fewer than eight effective clips nothing is in bold."
        )
    if any(method.is_oracle_selected for method in table.methods):
        before.append(
            "Oracle-selected: the best sample is selected with the real future, which is "
            "unavailable at prediction time, so such methods compete only with each other. "
            "'best of N' selects per metric, as in the papers."
        )
    for name, facts in protocol["metrics"].items():
        about = facts["unavailable"] or facts.get("definition")
        if about and any(facts_of(column.key, protocol) is facts for column in table.columns):
            before.append(f"{title(name)}: {'unavailable: ' * bool(facts['unavailable'])}{about}.")
    return replace(table, notes=[*before, *notes])


def method_notes(results: Results, strict: bool) -> list[str]:
    """Return notes on privileged inputs, on what lacks scores and why, and on provenance."""
    methods, protocol = results.methods(), results.protocol()
    notes = legend(methods)
    treatment = (
        "left out" if strict else "scored as copies of the last frame (--strict leaves them out)"
    )
    for method in methods:
        if method.status != "done":
            count = f"{method.num_clips} of {len(protocol['clips'])} clips"
            why = method.reason or "run again"
            notes.append(f"{method.label}: {method.status}, {count}: {why}.")
        failures = results.failures(method.name)
        if failures:
            count = f"{len(failures)} of {method.num_clips} clips could not be predicted"
            names = ", ".join([*failures][:3])
            reasons = "; ".join(dict.fromkeys(failures.values()))
            notes.append(f"{method.label}: {count}, {treatment}: {names}: {reasons}.")
        if method.num_outdated:
            notes.append(f"{method.label}: computed by another version of the code, or partly.")
    return [*notes, *weights_notes(methods), f"Protocol id {protocol['id']}."]
