"""Write all scores of a results folder into one table, or views of a method for a generator.

The columns of the table are method, clip, sample, step, metric and value. With --format conditions,
a method is recomputed, and its views, coverage masks, depths, poses and intrinsics are written as
the conditions of a video generator, one npz file per clip.

Examples:
  geovp export results/demo --out scores.csv
  geovp export results/demo --format parquet --out scores.parquet
  geovp export results/demo --format conditions --method "gt-3d + fusion" --out conditions
"""

import argparse

from geovp_benchmarks.cli.options import Lines, option, shared

ARGUMENTS = {
    "": shared("folder"),
    "output": {
        "--format csv|parquet|conditions = csv": "Format.",
        "--out FILE": option("File for the table, or folder for conditions.", required=True),
    },
    "selection": {
        "--method METHOD": "Method, by its name in tables. Default: all; of conditions the only."
    },
    "conditions": shared("--root", "--limit"),
}


def run(args: argparse.Namespace) -> Lines:
    """Write the file or files, and print their paths."""
    from geovp_benchmarks.results.store import Results
    from geovp_classic.errors import BadData

    results = Results(args.folder).select(*filter(None, [args.method]))
    # Conditions of a video generator, computed again from the stored settings.
    if args.format == "conditions":
        from geovp_benchmarks.matrix.stored import matrix_of
        from geovp_benchmarks.running.conditions import write_conditions

        if len(results.methods()) != 1:
            labels = ", ".join(method.label for method in results.methods())
            raise BadData(f"--format conditions needs one --method: give one of {labels}")
        matrix = matrix_of(results, results.methods()[0], args.root)
        yield from map(str, write_conditions(matrix, args.out, args.limit))
        return
    if args.root or args.limit:
        raise BadData("--root and --limit are those of --format conditions: leave them out")
    from geovp_classic.atomic import atomic_write

    with atomic_write(args.out) as scratch:
        results.export(scratch, args.format)
    yield str(args.out)
