"""Run a published protocol, and print both tables.

Learned methods use the shipped weights; nothing is trained. An interrupted run continues.

Examples:
  geovp reproduce fvs20 --root path/to/kitti_raw --limit 20
  geovp reproduce thesis --root path/to/kitti --samples 10
"""

import argparse
from pathlib import Path

from geovp_benchmarks.cli import run as run_command
from geovp_benchmarks.cli.options import LinesAndCode, option
from geovp_classic.errors import BadData

ARGUMENTS = {
    **run_command.ARGUMENTS,
    "": {"matrix NAME": option("Protocol, such as fvs20; see `geovp list protocols`.", type=Path)},
}


def run(args: argparse.Namespace) -> LinesAndCode:
    """Run the matrix of a protocol, and print and write its tables."""
    from geovp_benchmarks.matrix import papers, schema
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.tables import formats, published
    from geovp_classic.types import PrivilegedInput

    name = str(args.matrix)
    paper = papers.load(name)  # an unknown name is bad input
    try:
        matrix = schema.read(args.matrix, args.set).override(root=args.root)
        matrix.build_dataset(PrivilegedInput.NONE)
    except BadData as problem:
        raise BadData(
            f"{name} needs {paper.data}. Get it from {paper.where}. Here: {problem}"
        ) from problem
    code = yield from run_command.run(args)
    if not args.dry_run:
        results = Results(run_command.folder(args))
        tables = published.build(results, name)
        formats.write_all(results, tables)
        yield from map(formats.markdown, tables)
    return code
