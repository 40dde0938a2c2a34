"""Notes below a table: what the numbers are, and what the names of metrics and methods mean."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from geovp_benchmarks.results import stored_facts
from geovp_benchmarks.results.provenance import weights_notes
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.tables.table_model import Table


def explained(
    table: Table, results: Results, more: Sequence[str] = (), *, strict: bool = False
) -> Table:
    """Return a table with notes on its numbers and methods, and more of them after the metrics."""
    protocol, methods = results.protocol(), results.methods()
    notes = [
        f"{stored_facts.summary(protocol)}.",
        *on_numbers(table),
        *_on_metrics(table, protocol),
        *more,
    ]
    inputs = {name for method in methods for name in method.privileged_inputs}
    marks = [f"[{m}] {words}" for name, (m, words) in stored_facts.MARKS.items() if name in inputs]
    if marks:
        notes.append(f"Privileged inputs: {', '.join(marks)}.")
    if legend := stored_facts.legend(methods):
        notes.append(f"Methods: {legend}.")
    for method in methods:
        notes += _on_method(method, len(protocol["clips"]), strict=strict)
    others = [method.label for method in methods if method.name not in protocol["methods"]]
    if others:
        notes.append(
            f"Not in the matrix of the last run: {', '.join(others)} (remove a folder to leave its "
            "method out)."
        )
    notes += [*weights_notes(methods), f"Protocol id {protocol['id']}."]
    lines = "\n".join(notes).splitlines()  # reasons of failures may have several lines
    return replace(table, notes=lines)


def on_numbers(table: Table) -> Iterator[str]:
    """Yield what intervals, numbers of clips and bold numbers mean, where a table has them."""
    shown = "".join(table.texts(row, column)[1] for row in table.rows for column in table.columns)
    of_clip = "A clip's value is the mean over its steps."
    if "±" in shown:
        errors = "standard error of the mean over clips, as if they were independent"
        yield f"±: {errors}. {of_clip}"
    elif "[" in shown:
        mean = "the mean paired difference" if table.has_differences else "the mean over clips"
        way = "by block bootstrap over clips: of these drives, not of others"
        if table.is_over_drives:
            way = "by Student's t over the means of the drives"
        yield f"[low, high]: 95 % interval of {mean}, {way}. {of_clip}"
    else:
        yield of_clip
    if any("(" in table.clips(row) for row in table.rows):
        counted = "drives" if table.is_over_drives else "independent clips"
        yield f"(n) behind the clips: the effective number of {counted} in the first column."
    if table.marked and not table.has_differences:
        yield (
            "Bold: no method with the same or fewer privileged inputs is significantly better "
            "(paired differences over common clips, p < .05 after Holm's procedure). With fewer "
            "than eight effective clips or drives nothing is in bold."
        )
    if any(row.is_oracle_selected for row in table.rows):
        yield (
            "Oracle-selected: the best sample is selected with the real future, which is "
            "unavailable at prediction time, so such methods compete only with each other. "
            "'best of N' selects per metric, as in the papers."
        )


def _on_metrics(table: Table, protocol: Mapping[str, Any]) -> Iterator[str]:
    """Yield the definition of each metric, or why it is unavailable."""
    shown = {stored_facts.metric_of(column.key) for column in table.columns}
    for name, facts in protocol["metrics"].items():
        if name in shown and facts.get("unavailable"):
            yield f"{stored_facts.title(name)}: unavailable: {facts['unavailable']}."
        elif name in shown and facts.get("definition"):
            yield f"{stored_facts.title(name)}: {facts['definition']}."


def _on_method(method: Method, num_clips: int, *, strict: bool) -> Iterator[str]:
    """Yield what is missing, failed, replaced or outdated of a method."""
    label, failures = method.label, method.scored.failures
    if method.status != "done":
        scored = f"{method.status}, {method.num_clips} of {num_clips} clips"
        yield f"{label}: {scored}: {method.reason or 'run again'}."
    if failures:
        treated = "scored as copies of the last frame if readable (--strict leaves them out)"
        if strict:
            treated = "left out"
        names = ", ".join([*failures][:3])
        reasons = "; ".join(dict.fromkeys(failure.reason for failure in failures.values()))
        failed = f"{len(failures)} of {method.num_clips} clips could not be predicted"
        yield f"{label}: {failed}, {treated}: {names}: {reasons}."
    if fallbacks := stored_facts.fallbacks(method):
        yield f"{label}: {fallbacks}; the others by geometry."
    if method.num_outdated:
        yield f"{label}: computed by another version of the code, or partly."
