"""Figure of an error budget: the changes of `geovp budget` with their 95 % intervals."""

import argparse
from collections.abc import Iterator

import numpy as np

from geovp_benchmarks.cli.options import shared
from geovp_benchmarks.evaluation.error_budget import error_budget, read_method
from geovp_benchmarks.matrix import schema
from geovp_benchmarks.tables.formats import markdown
from geovp_classic.types import PrivilegedInput
from studies._figures import panels

ARGUMENTS = {
    "": {
        **shared("matrix", "--method", "--root", "--limit", "--set"),
        "figure FILE": "File of the figure: png, pdf or svg.",
    }
}


def run(args: argparse.Namespace) -> Iterator[str]:
    """Draw a panel per metric with a row per stage; yield the lines of the table."""
    matrix = schema.read(args.matrix, args.set).with_root(args.root)
    method = read_method(matrix, args.method, args.limit, PrivilegedInput.NONE)
    tables = error_budget(method)
    stages = [row.label for row in tables[0].methods]
    places = np.arange(len(stages))
    size_in = 3 * len(tables), 1 + 0.3 * len(stages)
    with panels(args.figure, size_in, len(tables)) as drawn:
        for axes, table in zip(drawn, tables, strict=True):
            axes.axvline(0, color="0.5", linewidth=0.8)
            axes.set_xlabel(f"change of {table.name.upper()}")
            for number, column in enumerate(table.columns):
                changes = [row.scores[column.key] for row in table.methods]
                mean = np.array([change.mean for change in changes])
                ends = np.array([(change.low, change.high) for change in changes]).T
                axes.errorbar(
                    mean, places + 0.25 * number, xerr=abs(ends - mean), fmt="o", label=column.key
                )
        drawn[0].set_yticks(places, stages)
        drawn[0].invert_yaxis()
    yield from map(markdown, tables)
