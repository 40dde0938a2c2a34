"""Figure of an error budget: the changes of `geovp budget` with their 95 % intervals."""

import argparse
from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from geovp_benchmarks.arguments import add_method, figure_file
from geovp_benchmarks.evaluation.error_budget import error_budget
from geovp_benchmarks.evaluation.variants import heading, read_method
from geovp_benchmarks.matrix import schema
from geovp_benchmarks.plots import style
from geovp_benchmarks.progress import Progress
from geovp_classic.types import PrivilegedInput


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the method, the clips and the figure."""
    add_method(parser)
    text = "File of the figure: png, pdf or svg."
    parser.add_argument("figure", type=figure_file, metavar="FILE", help=text)


def run(args: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Draw a panel per metric with a row per stage; yield the lines of the table."""
    matrix = schema.read(args.matrix).with_root(args.root)
    matrix = matrix.replace(stride=args.stride or matrix.stride)
    method = read_method(matrix, args.method, args.limit, PrivilegedInput.NONE)
    table = error_budget(method, progress)
    places = np.arange(len(table.changes))
    with mpl.style.context(style.SHEET):
        size_in = 3 * len(table.metrics), 1 + 0.3 * len(places)
        figure = Figure(figsize=size_in, dpi=style.PRINT_DPI, layout="constrained")
        panels = figure.subplots(1, len(table.metrics), sharey=True, squeeze=False)[0]
        for axes, (name, metric) in zip(panels, table.metrics.items(), strict=True):
            axes.axvline(0, color=style.FAINT, linewidth=0.8)
            axes.set_xlabel(f"change of {heading(name, metric)}")
            for number, column in enumerate(("alone", "one by one", "without")):
                changes = [table.interval(stage, column, name) for stage in table.changes]
                mean = np.array([change.mean for change in changes])
                ends = np.array([(change.low, change.high) for change in changes]).T
                axes.errorbar(
                    mean, places + 0.25 * number, xerr=abs(ends - mean), fmt="o", label=column
                )
        panels[0].set_yticks(places, list(table.changes))
        panels[0].invert_yaxis()
        panels[0].legend()
        figure.savefig(args.figure)
    yield from table.lines()
