"""Matrix files with several data sets: `[protocol] datasets = [...]` in place of `dataset`.

Each data set has a matrix of its own, and a results folder below that of the file, named by the
data set's label.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import schema
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.matrix.values import DataSets
from geovp_benchmarks.results.validation import validated
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.types import PrivilegedInput


def parse(name: str, content: Mapping[str, Any], root: Path | None = None) -> dict[str, Matrix]:
    """Return the matrices of a TOML file's content by the label of their data set.

    The label is "" if there is one data set. Each of several data sets is opened, so that none
    fails hours later.
    """
    protocol = content.get("protocol")
    if not isinstance(protocol, Mapping) or "datasets" not in protocol:
        return {"": schema.parse(name, content).override(root=root)}
    shared = dict(protocol)
    specs = validated(DataSets, shared.pop("datasets"), "protocol.datasets")
    if not specs or {"dataset", "root"} & shared.keys() or root is not None:
        raise BadData(
            "protocol.datasets is a list of at least one data set such as "
            '{ name = "kitti", root = "..." }, and replaces protocol.dataset and --root'
        )
    schema.check_folders([*specs])
    matrices = {}
    for label, spec in specs.items():
        single = {**content, "protocol": {**shared, "dataset": spec}}
        try:
            matrices[label] = schema.parse(f"{name}/{label}", single)
            matrices[label].build_dataset(PrivilegedInput.NONE)
        except GeovpError as problem:
            raise type(problem)(f"data set {label!r}: {problem}") from problem
    return matrices
