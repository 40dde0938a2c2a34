"""The matrix that reproduces the table of a paper."""

from collections.abc import Sequence

from geovp_benchmarks.matrix import CONFIGS
from geovp_benchmarks.matrix import schema as matrices
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.tables import published
from geovp_classic import registry
from geovp_classic.errors import BadData


def read_matrix(name: str) -> Matrix:
    """Return the committed matrix of a protocol; raise BadData if it has none."""
    published.load(name)
    return matrices.read(CONFIGS / f"{name}.toml")


def chosen_rows(
    matrix: Matrix, split: str | None, samples: int | None, rows: Sequence[str] | None
) -> Matrix:
    """Return the matrix on another split, with fewer samples, or with some whole predictors alone.

    `samples` is the largest number of samples, `rows` names the predictors.
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
