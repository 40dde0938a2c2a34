"""Matrix of a stored method, with its resolved settings."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.validation import validated


def matrix_of(
    results: Results, method: Method, root: Path | None, metrics: Mapping[str, Any] | None = None
) -> Matrix:
    """Return the matrix of one method, with the root of the data if it has another one here."""
    protocol = results.protocol()
    keys = ("name", "dataset", "num_past", "num_future", "size_px", "stride")
    fields: dict[str, Any] = {key: protocol[key] for key in keys}
    fields |= {"root": root, "num_samples": method.num_samples}
    fields["metrics"] = {"frame": {}, "trajectory": {}, "set": {}}
    for role, spec in method.components.items():
        fields[f"{role}s"] = {getattr(method, role, method.name): spec}
    for name, spec in (metrics or {}).items():
        role = protocol["metrics"][name]["role"]
        fields["metrics"][role][name] = spec
    matrix: Matrix = validated(Matrix, fields, "protocol.json")
    return matrix
