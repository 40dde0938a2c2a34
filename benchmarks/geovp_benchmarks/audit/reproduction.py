"""Our results in the layout of a paper's table, and the published numbers in a separate block."""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.matrix import CONFIGS, protocols
from geovp_benchmarks.matrix import schema as matrices
from geovp_benchmarks.matrix.protocols import Protocol
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results import provenance
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.results.stored_facts import legend, marks, summary, title
from geovp_benchmarks.tables import thesis
from geovp_benchmarks.tables.formats import grid
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray

DECIMALS = 2


def read_matrix(name: str) -> Matrix:
    """The committed matrix of a protocol; BadData names those that have one."""
    protocols.load(name)
    if name not in TABLES:
        raise BadData(
            f"protocol {name!r} cannot be reproduced by one command yet, only {', '.join(TABLES)}"
        )
    return matrices.read(CONFIGS / f"{name}.toml")


def chosen_rows(
    matrix: Matrix, split: str | None, samples: int | None, rows: Sequence[str] | None
) -> Matrix:
    """The matrix on another split, with at most so many samples, and with some of its whole
    predictors alone.
    """
    if samples is not None and samples < 2:
        raise BadData(f"--samples {samples}: one sample is there already, give 2 or more")
    for name in rows or ():
        if name not in matrix.predictors:
            raise BadData(
                f"--methods {name}: no method of {matrix.name}"
                f"{registry.nearest(name, matrix.predictors)}"
            )
    predictors = {
        name: entry for name, entry in matrix.predictors.items() if not rows or name in rows
    }
    if samples is not None:
        predictors = {
            name: entry.model_copy(
                update={"num_samples": min(samples, entry.num_samples or matrix.num_samples)}
            )
            for name, entry in predictors.items()
        }
    matrix = matrix.replace(predictors=predictors)
    matrix = matrix.replace(pose_sources={}, renderers={}) if rows else matrix
    return matrix.replace(dataset={**matrix.dataset, "split": split}) if split else matrix


def markdown(name: str, results: Results) -> str:
    """Both blocks, with notes."""
    protocol, published = protocols.load(name), thesis.published(name)
    shared = results.protocol()
    done = [method for method in results.methods() if method.num_clips]
    names = {
        method.name: f"{method.label} [{marks(method)}]"
        if method.privileged_inputs
        else method.label
        for method in done
    }
    ours = {
        names[method.name]: _values(protocol, results, method, published["scale"])
        for method in done
    }
    theirs = {
        row["name"]: [float(value) for metric in protocol.metrics for value in row.get(metric, ())]
        for row in published["row"]
    }
    parts = [
        f"## {name}: measured here",
        *_block(protocol, list(protocol.metrics), ours, shared),
        f"- {summary(shared)}; values times {published['scale']}.",
        *_notes(protocol, results),
        "",
        "## Published, not measured here",
        *_block(
            protocol,
            [key for key in protocol.metrics if key in published["row"][0]],
            theirs,
            shared,
        ),
        f"- {published['source']}: {published['about']}.",
    ]
    return "\n".join(parts) + "\n"


def first_frames_means(
    values: FloatArray,  # [N, F]
    horizons: Sequence[int],
) -> FloatArray:
    """Means over the first k frames [N, len(horizons)] of every clip; over all frames when there
    are no horizons.
    """
    return np.stack([values[:, :k].mean(axis=1) for k in horizons or (values.shape[1],)], axis=1)


def _values(protocol: Protocol, results: Results, method: Method, scale: float) -> list[float]:
    """Means over clips: of each metric, each horizon."""
    rows, values = results.scores(method.name), []
    abouts = results.protocol()["metrics"]
    for metric in protocol.metrics:
        cube = statistics.cube(rows, metric)
        reduce = (
            statistics.best_of_samples if protocol.num_samples > 1 else statistics.mean_of_samples
        )
        if len(cube.clips):
            steps = reduce(cube, bool(abouts[metric]["higher_is_better"]))
            values += (
                scale * statistics.over_clips(first_frames_means(steps, protocol.horizons)).mean
            ).tolist()
        else:
            values += [float("nan")] * max(1, len(protocol.horizons))
    return values


def _block(
    protocol: Protocol, metrics: Sequence[str], lines: Mapping[str, list[float]], shared: Any
) -> list[str]:
    """A column for every metric and horizon; no row is marked as the best, since some were shown
    the truth.
    """
    ks, heads = [f" t+{k}" for k in protocol.horizons] or [""], []
    for metric in metrics:
        is_rising = shared["metrics"][metric].get(
            "higher_is_better", not metric.startswith("lpips")
        )
        heads += [f"{title(metric)}{k} {'↑' if is_rising else '↓'}" for k in ks]
    body = [
        [name, *(f"{x:.{DECIMALS}f}" if np.isfinite(x) else "-" for x in line)]
        for name, line in lines.items()
    ]
    return ["", *grid([["Models", *heads], *body]), ""]


def _notes(protocol: Protocol, results: Results) -> list[str]:
    """What stands in the way of comparing the two blocks."""
    shared, methods = results.protocol(), results.methods()
    notes = [f"- Protocol: {protocol.paper}. Differs here: {protocol.differences}."]
    if protocol.num_clips not in (None, len(shared["clips"])):
        notes.append(
            f"- {len(shared['clips'])} clips, not the protocol's {protocol.num_clips:,}: not "
            "comparable yet."
        )
    notes += [f"- {note}" for note in legend(methods, ", unlike below")]
    for metric in protocol.metrics:
        about = shared["metrics"][metric]
        notes.append(f"- {title(metric)}: {about['unavailable'] or about['definition']}.")
    for method in methods:
        if method.status != "done" or method.num_clips < len(shared["clips"]):
            notes.append(
                f"- {method.label}: {method.status} on {method.num_clips} clips: "
                f"{method.reason or 'run again'}."
            )
    return notes + [
        f"- {note}"
        for note in (*provenance.weights_notes(methods), *provenance.id_notes(methods, shared))
    ]


# What one command writes, by the file's ending; the first is printed. The matrix is
# configs/<name>.toml.
TABLES: Mapping[str, Mapping[str, Callable[[Results], str]]] = {
    "thesis": thesis.FORMATS,
    "fvs20": {"md": functools.partial(markdown, "fvs20")},
}
