"""Draw the figures of a results folder.

Examples:
  geovp plot results/demo
  geovp plot results/demo --by turning
  geovp plot results/demo --format pdf --width 3.3in
"""

import argparse

from geovp_benchmarks.cli.options import add, add_group, add_shared
from geovp_benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the results, what is shown of them, and the files."""
    add_shared(parser, "folder")
    add_group(parser, "selection", "--methods", "--metrics", "--by")
    output = add_group(parser, "output")
    formats = ("pdf", "svg", "png")
    add(output, "--format", "FORMAT", "pdf, svg or png. Default: png and svg.", choices=formats)
    text = "Width in a paper, such as 3.3in, 84mm or 240pt, without titles. Default: with titles."
    add(output, "--width", "LENGTH", text)


def run(args: argparse.Namespace) -> int:
    """Write the figures, and print their paths."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.plots import layout
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables.table_model import Choice

    choice = Choice(args.methods, args.metrics)
    width = None if args.width is None else layout.width_in(args.width)
    wanted = plots.Layout((args.format,) if args.format else (), width, width is None)
    for results in Results(args.folder).by_dataset().values():
        with progress_bar("plots", "figures") as progress:
            for _, files in plots.write_all(results, progress, args.by, wanted, choice):
                print(*files, sep="\n")
    return 0
