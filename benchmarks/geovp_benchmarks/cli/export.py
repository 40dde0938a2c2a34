"""Write all scores of a results folder into one table.

Its columns are method, clip, sample, step, metric and value.

Examples:
  geovp export results/demo --out scores.csv
  geovp export results/demo --format parquet --out scores.parquet
"""

import argparse
import errno

from geovp_benchmarks.cli.options import Lines, option, shared

ARGUMENTS = {
    "": shared("folder"),
    "output": {
        "--format csv|parquet = csv": "Format.",
        "--out FILE": option("File for the table.", required=True),
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Write the file, and print its path."""
    import duckdb
    import numpy as np

    from geovp_benchmarks.results.store import Results
    from geovp_classic.atomic import atomic_write

    results = Results(args.folder)
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
