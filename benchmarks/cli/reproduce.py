"""Run a published protocol from nothing and print its table beside the published one."""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.arguments import positive
from benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which protocol, on which data, and where the results go."""
    parser.add_argument("name", metavar="NAME", help="a protocol, such as fvs20; `geovp list protocols` describes them")
    parser.add_argument("--root", type=Path, required=True, metavar="FOLDER", help="folder of the data set")
    parser.add_argument("--out", type=Path, metavar="DIR", help="results folder (default: results/NAME)")
    parser.add_argument("--limit", type=positive, metavar="N", help="only the first N clips")
    parser.add_argument("--workers", type=positive, default=1, metavar="N", help="processes (default: this one)")


def run(chosen: argparse.Namespace) -> int:
    """Fill what is missing, print both tables and write them."""
    from benchmarks import formats, reproduction
    from benchmarks.planning import Options
    from benchmarks.run import run as fill
    from benchmarks.store import Results
    from geovp_classic import registry
    from geovp_classic.data.atomic import write_bytes

    matrix = reproduction.read_matrix(chosen.name).with_root(chosen.root)
    results = Results(chosen.out or Path("results") / chosen.name)
    spec = {"name": "processes", "workers": chosen.workers} if chosen.workers > 1 else {"name": "serial"}
    with progress_bar(chosen.name, "predictions") as progress:
        cells = fill(matrix, results, Options(chosen.limit), registry.build("executors", spec), progress)
    text = reproduction.TABLES[chosen.name](results)
    formats.write_all(results)
    write_bytes(results.tables / f"{chosen.name}.md", text.encode())
    print(text)
    print(f"tables: {results.tables}")
    return int(any(cell.status != "done" for cell in cells))
