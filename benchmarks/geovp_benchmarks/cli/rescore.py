"""Score kept predictions again.

The metrics are those of the results or of a matrix file; nothing is predicted.

Examples:
  geovp rescore results/demo
  geovp rescore results/demo --matrix other-metrics.toml
"""

import argparse

from geovp_benchmarks.cli.options import LinesAndCode, shared
from geovp_classic.errors import BadData

ARGUMENTS = {
    "": shared("folder"),
    "metrics": {
        "--matrix MATRIX": "Matrix with the metrics. Default: those of the results.",
        **shared("--device"),
    },
    "output": {"--out DIR": "Folder for the results. Default: DIR-rescored."},
}


def run(args: argparse.Namespace) -> LinesAndCode:
    """Write a results folder of the kept clips, and print its table."""
    from geovp_benchmarks.cli.run import conclude
    from geovp_benchmarks.matrix import schema
    from geovp_benchmarks.matrix.components import on_device
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.running.rescore import rescore, stored_metrics
    from geovp_benchmarks.running.scoring import Metrics

    folder = args.folder.resolve()
    output = Results(args.out or folder.with_name(f"{folder.name}-rescored"))
    if output.root.resolve() == folder:
        raise BadData(f"--out {args.out} is the folder of the predictions: give another one")
    results = Results(args.folder)
    matrix = schema.read(args.matrix) if args.matrix else None
    with on_device(args.device or (matrix.device if matrix else None)):
        if matrix is None:
            metrics = stored_metrics(results)
        else:
            metrics = Metrics.build(matrix.metrics, results.protocol()["size_px"])
    rescore(results, output, metrics)
    return (yield from conclude(output))
