"""Print and write the tables of a results folder.

Tables of a selection are printed only. --format tex needs the packages booktabs and graphicx.

Examples:
  geovp table results/demo
  geovp table results/demo --against copy-last
  geovp table results/demo --by turning --metrics psnr coverage --format tex
"""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING

from geovp_benchmarks.cli.messages import terminal_width
from geovp_benchmarks.cli.options import SELECTION, Lines, option, shared
from geovp_classic.errors import BadData

if TYPE_CHECKING:
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables.table_model import Table


ARGUMENTS = {
    "": shared("folder"),
    "selection": {
        **SELECTION,
        "--strict": "Leave out clips on which a method failed.",
        "--paper NAME": "Layout of a paper, next to its numbers, such as fvs20. Default: ours.",
    },
    "output": {
        "--format md|tex|csv": option("Format. Default: md.", "md"),
        "--spread interval|standard-error": option(
            "Uncertainty of each mean. Default: interval.", "interval"
        ),
        "--label NAME": option("Label of the first LaTeX table. Default: tab:TABLE.", ""),
        "--caption TEXT": option("Caption of the first LaTeX table. Default: its title.", ""),
        "--page FILE": (
            "Also write a page of the documentation, whose opening and notes stay. Default: none."
        ),
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Print the tables; write them if nothing was selected."""
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables import formats
    from geovp_benchmarks.tables.tables import side_by_side

    results = Results(args.folder).select(*args.methods)
    datasets = results.by_dataset().values()
    tables = [table for dataset in datasets for table in tables_of(args, dataset)]
    if len(datasets) > 1:
        tables.append(side_by_side(results))
    match args.format:
        case "csv":
            text = "\n".join(map(formats.comma_separated, tables))
        case "tex":
            first = formats.latex(tables[0], args.caption, args.label)
            text = "\n".join([first, *map(formats.latex, tables[1:])])
        case "md":
            width = None if args.page else terminal_width()
            if args.page:
                tables = formats.without_repeated_notes(tables)
            text = "\n".join(formats.markdown(table, width) for table in tables)
    yield text
    if args.page is not None:
        if args.format != "md":
            raise BadData("--page is written as md: leave --format out")
        protocol = results.protocol()
        versions = ", ".join(map(" ".join, protocol["versions"].items()))
        origin = f"`geovp table --page`; computed with {versions}"
        commands = [f"geovp run {protocol['name']}", shlex.join(["geovp", *args.words])]
        formats.write_page(args.page, protocol["name"], commands, origin, text)


def tables_of(args: argparse.Namespace, results: Results) -> list[Table]:
    """Return the selected tables of a data set; without a selection, write all of them."""
    from geovp_benchmarks.analysis import strata
    from geovp_benchmarks.tables import formats, tables

    if args.paper is not None:
        from geovp_benchmarks.tables import published

        return published.build(results, args.paper)
    groups = strata.divide(results, args.by) if args.by else [results]
    options = {"strict": args.strict, "metrics": args.metrics}
    if args.against is not None:
        return [tables.against(group, args.against, **options) for group in groups]
    built = [tables.build(group, args.spread, **options) for group in groups]
    if args.by is not None:
        return [main for main, *_ in built]
    if not (args.methods or args.metrics or args.strict):
        formats.write_all(results, built[0])
    return built[0]
