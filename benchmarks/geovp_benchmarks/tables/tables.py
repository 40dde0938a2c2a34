"""Tables of a results folder: means, intervals, privileged inputs, and notes that explain them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypedDict, Unpack

import numpy as np

from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.score_names import ALWAYS_SCORED, COVERAGE, FEATURES, UNBOUNDED
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.statistics.intervals import Intervals, holm
from geovp_benchmarks.statistics.samples import mean_of_samples, reductions
from geovp_benchmarks.statistics.score import Score
from geovp_benchmarks.tables.notes import explained
from geovp_benchmarks.tables.table_model import (
    Column,
    Row,
    Table,
    best,
    selected_columns,
)
from geovp_classic.errors import BadData, nearest
from geovp_classic.metrics.frechet import frechet_distances
from geovp_classic.types import BoolArray, FloatArray


class Selection(TypedDict, total=False):
    """What of the scores a table shows."""

    metrics: Sequence[str]  # columns; empty: all
    steps: Sequence[int]  # each metric has a column for each of them, in place of their mean
    strict: bool  # leaves out clips that a method could not predict, else copies of the last frame
    has_seeds: bool  # averages methods that differ by the number of a training seed


def build(
    results: Results, spread: str = "interval", **selection: Unpack[Selection]
) -> list[Table]:
    """Return the main table (whole frames and poses), then those over sets of pixels.

    With named columns or steps there is only one table. Methods compete among those selected.
    """
    tables = [_main_table(results, **selection)]
    if not (selection.get("metrics") or selection.get("steps")):
        tables += _detail_tables(tables[0], results.protocol())
    strict = selection.get("strict", False)
    return [explained(replace(table, spread=spread), results, strict=strict) for table in tables]


def against(
    results: Results, name: str, spread: str = "interval", **selection: Unpack[Selection]
) -> Table:
    """Return paired differences of the main table's methods from another, over common clips.

    A method with samples is compared by its mean over them. Stars mark what `holm` finds.
    """
    # The reference is a method, or the mean of its training seeds.
    protocol, has_seeds = results.protocol(), selection.get("has_seeds")
    if results.selected and not has_seeds:
        results = results.select(*results.selected, name)  # notes are on the reference, too
    main = _main_table(results, **selection)
    others = results.select() if has_seeds else results.select(name)
    selection["metrics"] = ()  # the reference may lack some
    references = _main_table(others, **selection).rows
    named = {name: references[0]}
    if has_seeds:
        named = {row.label.partition(" (")[0]: row for row in references}
    if name not in named:
        raise BadData(f"no method is called {name!r}{nearest(name, named)}")
    reference = named[name]
    columns = [column for column in main.columns if column.key in reference.scores]
    methods = [row for row in main.rows if row.scores and row.label != reference.label]
    differences: dict[str, dict[str, Score]] = {method.label: {} for method in methods}
    exact: list[str] = []  # titles of columns in which the reference has no error
    starred = set[tuple[str, str]]()
    for column in columns:
        key, of_reference = column.key, reference.scores[column.key]
        scored = [method for method in methods if key in method.scores]
        pairs = [(method.scores[key], of_reference) for method in scored]
        is_exact = column.higher_is_better is False and of_reference.is_exact
        bounds = (0.0, np.inf) if is_exact else UNBOUNDED
        gaps = Intervals().differences(pairs, protocol["clips"], bounds)
        for method, gap, is_significant in zip(scored, gaps, holm(gaps), strict=True):
            differences[method.label][key] = gap
            if is_significant and not is_exact:
                starred.add((method.label, key))
        if is_exact:  # a positive error always differs from none: no test is needed
            exact.append(stored_facts.title(key))
    rows = []
    for method in methods:
        gaps_of_method = differences[method.label]
        num_clips = max((gap.clips for gap in gaps_of_method.values()), default=0)
        rows.append(replace(method, scores=gaps_of_method, num_clips=num_clips))
    notes = []
    if starred:
        notes.append("*: p < .05 after Holm's procedure over the methods.")
    if any(gap.has_few_clips for row in rows for gap in row.scores.values()):
        notes.append("Differences on fewer than eight effective clips are not tested.")
    if exact:
        names = ", ".join(exact)
        notes.append(f"{name} has no {names}, so that other methods are not tested against it.")
    heading = f"{protocol['name']}: differences from {name}"
    table = Table(
        "against", heading, columns, rows, (), starred, spread=spread, has_differences=True
    )
    return explained(table, results, notes, strict=selection.get("strict", False))


def _main_table(
    results: Results,
    *,
    metrics: Sequence[str] = (),
    steps: Sequence[int] = (),
    strict: bool = False,
    has_seeds: bool = False,
) -> Table:
    """Return the table of whole frames and poses; BadData for a selected method without scores."""
    # A row for each method with scores
    protocol = results.protocol()
    methods = method_scores(results, scored_methods(results), strict=strict, steps=steps)
    if has_seeds:
        methods = _over_seeds(methods, protocol)
    # Columns: those asked for, or all that differ and of which some method has scores
    with_scores = _keys(methods)
    keys = selected_columns(metrics, [*protocol["metrics"], *with_scores])
    keys = keys or _different(
        [
            key
            for key, facts in protocol["metrics"].items()
            if key not in ALWAYS_SCORED and (key in with_scores or facts.get("unavailable"))
        ],
        methods,
    )
    headings = {key: stored_facts.title(key) for key in keys}
    # With steps, one for each of them
    if unknown := [step for step in steps if not 1 <= step <= protocol["num_future"]]:
        raise BadData(f"--steps {unknown[0]}: give steps from 1 to {protocol['num_future']}")
    if steps:
        headings = {
            f"{key} at {step}": f"{title}, step {step}"
            for key, title in headings.items()
            for step in steps
        }
    return table_of("scores", "whole frames and poses", headings, methods, protocol)


def scored_methods(results: Results) -> list[Method]:
    """Return the methods with scores; raise BadData for a selected method without scores."""
    scored = []
    for method in results.methods():
        if method.status in ("done", "partial"):
            scored.append(method)
        elif results.selected:
            raise BadData(f"{method.label} has no scores: {method.status}: {method.reason}")
    return scored


def _over_seeds(rows: Sequence[Row], protocol: Mapping[str, Any]) -> list[Row]:
    """Return one row for methods whose names differ by the number of their training seed alone."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(re.sub(r"-\d+(?=$| \+ |, )", "", row.label, count=1), []).append(row)
    means = []
    for label, group in groups.items():
        if len(group) == 1:
            means += group
            continue
        scores = {}
        for key in (key for key in group[0].scores if all(key in row.scores for row in group)):
            seeds = np.stack([row.scores[key].values for row in group])
            bounds = stored_facts.bounds(stored_facts.facts_of(key, protocol))
            scores[key] = Intervals().over_seeds(seeds, protocol["clips"], bounds)
        num_clips = min(row.num_clips for row in group)
        label = f"{label} ({len(group)} seeds)"
        means.append(replace(group[0], label=label, scores=scores, num_clips=num_clips))
    return means


def _different(keys: Sequence[str], rows: Sequence[Row]) -> list[str]:
    """Return the columns without those that repeat an earlier one, such as two names of a mean."""
    different: dict[Any, str] = {}
    for key in keys:
        scores = (row.scores.get(key) for row in rows)
        means = tuple(f"{score.mean:.5g}" if score else "" for score in scores)
        different.setdefault(means if any(means) else key, key)
    return [*different.values()]


def method_scores(
    results: Results,
    methods: Iterable[Method],
    *,
    strict: bool = False,
    horizons: Sequence[int] = (),
    steps: Sequence[int] = (),
) -> list[Row]:
    """Return the scores of methods; of those with several samples, also those of the best sample.

    `strict` leaves out clips that a method could not predict. For each of the horizons there is a
    column of means over the first steps, such as "psnr t+5"; for each of the steps one of it alone,
    such as "psnr at 5".
    """
    protocol = results.protocol()
    clips = protocol["clips"]
    # first and last step, by the suffix of the column
    spans: dict[str, tuple[int, int | None]] = {"": (1, None)}
    spans |= {f" t+{num_steps}": (1, num_steps) for num_steps in horizons}
    spans |= {f" at {step}": (step, step) for step in steps}
    rows: list[Row] = []
    columns: list[tuple[dict[str, Score], str]] = []  # a row's scores and the key of one of them
    values: list[FloatArray] = []  # [N] by clip, of these columns
    for method in methods:
        samples = {
            key + suffix: of_samples  # [N, S]
            for suffix, span in spans.items()
            for key, of_samples in results.means(method.name, *span).items()
            if FEATURES not in key
        }
        # Failed clips are copies of the last frame, which count unless `strict`.
        left_out = np.isin(clips, [*method.scored.failures]) & strict
        of_sets = _set_scores(results, method, left_out)
        # Of samples the mean, and the best one by the real future; some methods have only one
        num_samples = max((of_samples.shape[1] for of_samples in samples.values()), default=1)
        for suffix, reduce in reductions(num_samples).items():
            scores = {**of_sets}
            row = Row(
                method.label + suffix,
                scores,
                stored_facts.marks(method),
                method.num_clips - int(left_out.sum()),
                reduce is not mean_of_samples,
                protocol["id"],
            )
            rows.append(row)
            for key, of_samples in samples.items():
                is_better = stored_facts.facts_of(key, protocol).get("higher_is_better")
                by_clip = reduce(of_samples[..., None], is_better)[:, 0]
                by_clip = np.where(left_out, np.nan, by_clip)
                if np.isfinite(by_clip).any():
                    columns.append((scores, key))
                    values.append(by_clip)
    # All intervals at once take a fraction of the time of one after the other.
    bounds = [stored_facts.bounds(stored_facts.facts_of(key, protocol)) for _, key in columns]
    means = Intervals().intervals(np.array(values), clips, bounds)
    for (scores, key), mean in zip(columns, means, strict=True):
        scores[key] = mean
    return rows


def _set_scores(results: Results, method: Method, left_out: BoolArray) -> dict[str, Score]:
    """Return the Frechet distances of a method, the mean over sets of one sample per clip.

    A set has no best sample, so that the distance is the same for all lines of the method.
    """
    protocol, scores = results.protocol(), {}
    for key, about in protocol["metrics"].items():
        stored = results.scores(method.name).values if about["role"] == "set" else {}
        if (features := stored.get(key + FEATURES)) is None:
            continue
        is_known = np.isfinite(features).all(axis=(1, 2)) & ~left_out
        values = np.full(len(features), np.nan)
        if is_known.sum() > 1:
            real, *samples = features[is_known].swapaxes(0, 1)
            values[is_known] = np.mean(
                [frechet_distances(real, sample) for sample in samples], axis=0
            )
        scores[key] = Intervals().interval(values, protocol["clips"], (0.0, np.inf))
    return scores


def _detail_tables(main: Table, protocol: Mapping[str, Any]) -> list[Table]:
    """Return a table over sets of pixels for each metric that has such scores."""
    keys, tables = _keys(main.rows), []
    for name in (column.key for column in main.columns):
        pixels = [key for key in keys if key.startswith(f"{name}@")]
        if pixels:
            words = {key: f"{key.partition('@')[2]} pixels" for key in pixels}
            headings = {name: "all pixels", **words}
            if COVERAGE in keys:
                headings[COVERAGE] = stored_facts.title(COVERAGE)
            heading = f"{stored_facts.title(name)} over sets of pixels"
            tables.append(table_of(f"pixels-{name}", heading, headings, main.rows, protocol))
    return tables


def _keys(methods: Sequence[Row]) -> list[str]:
    """Return all columns that have scores."""
    return list(dict.fromkeys(key for method in methods for key in method.scores))


def table_of(
    name: str,
    heading: str,
    headings: Mapping[str, str],  # by column
    methods: Sequence[Row],
    protocol: Mapping[str, Any],
    digits: str = "",  # format of numbers; "": as the means of each column need it
) -> Table:
    """Return a table with the best means in bold."""
    columns = []
    for key, words in headings.items():
        facts = stored_facts.facts_of(key, protocol)
        means = [abs(method.scores[key].mean) for method in methods if key in method.scores]
        columns.append(
            Column(
                key,
                stored_facts.labelled(words, facts),
                facts.get("higher_is_better"),
                digits=digits or _digits(max(means, default=0)),
                missing="unavailable" if facts.get("unavailable") else "-",
            )
        )
    bold = best(methods, columns, protocol["clips"])
    return Table(name, f"{protocol['name']}: {heading}", columns, methods, marked=bold)


def _digits(mean: float) -> str:
    """Return the format of a column by its largest mean; below 1e-9 are rounding errors."""
    if 1e-9 < mean < 1e-4 or mean >= 1e6:
        return ".4g"
    return ".2f" if mean >= 10 else ".3f"
