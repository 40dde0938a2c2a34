"""Figure of an error budget: the changes of `geovp budget` with their 95 % intervals."""

import argparse
from collections.abc import Iterator

import numpy as np

from geovp_benchmarks.cli import budget
from geovp_benchmarks.tables.formats import markdown
from studies._figures import panels

ARGUMENTS = {
    **budget.ARGUMENTS,
    "figure": {"figure FILE": "File of the figure: png, pdf or svg."},
}


def run(args: argparse.Namespace) -> Iterator[str]:
    """Draw a panel per metric with a row per stage; yield the lines of the table."""
    tables = budget.tables(args)
    stages = [row.label for row in tables[0].rows]
    places = np.arange(len(stages))
    size_in = 3 * len(tables), 1 + 0.3 * len(stages)
    with panels(args.figure, size_in, len(tables)) as drawn:
        for axes, table in zip(drawn, tables, strict=True):
            axes.axvline(0, color="0.5", linewidth=0.8)
            axes.set_xlabel(f"change of {table.name.upper()}")
            for number, column in enumerate(table.columns):
                changes = [row.scores[column.key] for row in table.rows]
                numbers = [(change.mean, change.low, change.high) for change in changes]
                mean, low, high = np.transpose(numbers)
                errors = mean - low, high - mean
                axes.errorbar(mean, places + 0.25 * number, xerr=errors, fmt="o", label=column.key)
        drawn[0].set_yticks(places, stages)
        drawn[0].invert_yaxis()
    yield from map(markdown, tables)
