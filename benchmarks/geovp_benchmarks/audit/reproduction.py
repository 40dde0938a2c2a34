"""The matrix that reproduces the table of a paper."""

from collections.abc import Sequence

from geovp_benchmarks.matrix import CONFIGS
from geovp_benchmarks.matrix import schema as matrices
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.tables import published
from geovp_classic import registry
from geovp_classic.errors import BadData


def read_matrix(
    name: str, settings: Sequence[str], samples: int | None, methods: Sequence[str]
) -> Matrix:
    """Return the committed matrix of a protocol; raise BadData if it has none.

    `samples` is the largest number of samples, `methods` names the predictors that are left.
    """
    published.load(name)
    matrix = matrices.read(CONFIGS / f"{name}.toml", settings)
    predictors = {key: matrix.predictors[key] for key in methods if key in matrix.predictors}
    for key in methods:
        if key not in predictors:
            nearest = registry.nearest(key, matrix.predictors)
            raise BadData(f"--methods {key}: no method of {matrix.name}{nearest}")
    if methods:
        matrix = matrix.model_copy(
            update={"predictors": predictors, "pose_sources": {}, "renderers": {}}
        )
    if samples is None:
        return matrix
    limited = {
        key: entry.model_copy(
            update={"num_samples": min(samples, entry.num_samples or matrix.num_samples)}
        )
        for key, entry in matrix.predictors.items()
    }
    return matrix.model_copy(update={"predictors": limited})
