"""Matrix files with several data sets: `[protocol] datasets = [...]` in place of `dataset`.

Each data set has a matrix of its own, and a results folder below that of the file, named by the
data set's label.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import schema
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.matrix.values import FolderName, Spec, Specs, validated
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables import tables
from geovp_benchmarks.tables.table_model import MethodScores, Table
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.types import PrivilegedInput


def parse(name: str, content: Mapping[str, Any], root: Path | None = None) -> dict[str, Matrix]:
    """Return the matrices of a TOML file's content by the label of their data set.

    The label is "" if there is one data set. Each of several data sets is opened, so that none
    fails hours later.
    """
    protocol = content.get("protocol")
    if not isinstance(protocol, Mapping) or "datasets" not in protocol:
        return {"": schema.parse(name, content).with_root(root)}
    shared = dict(protocol)
    specs = validated(Specs, shared.pop("datasets"), "protocol.datasets")
    if not specs or "dataset" in shared or root is not None:
        raise BadData(
            "protocol.datasets is a list of at least one data set such as "
            '{ name = "kitti", root = "..." }, and replaces protocol.dataset and --root'
        )
    schema.check_folders(list(validated(dict[FolderName, Spec], specs, "protocol.datasets")))
    matrices = {}
    for label, spec in specs.items():
        single = {**content, "protocol": {**shared, "dataset": spec}}
        try:
            matrices[label] = schema.parse(f"{name}/{label}", single).with_root(None)
            matrices[label].build_dataset(PrivilegedInput.NONE)
        except GeovpError as problem:
            raise type(problem)(f"data set {label!r}: {problem}") from problem
    return matrices


def side_by_side(results: Results) -> Table:
    """Return one table with a group of columns for each data set."""
    columns, notes, best = [], [], set()
    methods: dict[str, MethodScores] = {}
    for label, part in results.by_dataset().items():
        table = tables.build(part)[0]
        for column in table.columns:
            key, heading = f"{label}: {column.key}", f"{label}: {column.heading}"
            columns.append(replace(column, key=key, heading=heading))
        for method in table.methods:
            scores = {f"{label}: {key}": score for key, score in method.scores.items()}
            scores |= methods.get(method.label, method).scores
            methods[method.label] = replace(method, scores=scores)
        best |= {(method, f"{label}: {key}") for method, key in table.best}
        notes += [f"{label}: {note}" for note in table.notes]
    title = f"{results.root.resolve().name}: all data sets"
    return Table("datasets", title, columns, list(methods.values()), notes, best)
