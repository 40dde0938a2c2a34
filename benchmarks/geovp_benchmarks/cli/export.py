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
import errno

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
    # All scores in one table, a method at a time.
    import duckdb
    import numpy as np

    from geovp_classic.atomic import atomic_write

    with duckdb.connect() as database, atomic_write(args.out) as scratch:
        types = "method TEXT, clip TEXT, sample INT, step INT, metric TEXT, value DOUBLE"
        database.execute(f"CREATE TABLE scores ({types})")
        for method in results.methods():
            if method.status not in ("done", "partial"):  # its scores are those of a copy
                continue
            rows = results.scores(method.name).rows()
            columns = map(np.array, zip(*((method.label, *row) for row in rows), strict=True))
            database.register("rows", dict(enumerate(columns)))
            database.execute("INSERT INTO scores SELECT * FROM rows")
        database.execute("UPDATE scores SET value = NULL WHERE isnan(value)")
        try:
            getattr(database.table("scores"), f"write_{args.format}")(str(scratch))
        except duckdb.IOException as error:
            raise OSError(errno.EIO, str(error), str(args.out)) from error
    yield str(args.out)
