"""Score the kept predictions again, with the metrics as they are now."""

import argparse
import os
from pathlib import Path

from geovp_benchmarks.arguments import add_device, add_json, add_results_folder
from geovp_benchmarks.cli.run import conclude
from geovp_benchmarks.progress import progress_bar
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which predictions, with which metrics, and where to."""
    add_results_folder(parser)
    parser.add_argument(
        "--metrics", type=Path, metavar="MATRIX.toml", help="take [metrics] from this file"
    )
    add_json(parser)
    add_device(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to (default: DIR-rescored)")


def run(chosen: argparse.Namespace) -> int:
    """Write a results folder of the kept clips alone."""
    from geovp_benchmarks.matrix import schema as matrices
    from geovp_benchmarks.matrix.components import on_device
    from geovp_benchmarks.results.store import Results
    from geovp_benchmarks.running.rescore import rescore, stored_metrics
    from geovp_benchmarks.running.scoring import Metrics

    folder = Path(os.path.realpath(chosen.folder))
    results = Results(chosen.folder)
    into = Results(chosen.out or folder.with_name(f"{folder.name}-rescored"))
    if os.path.realpath(into.root) == os.path.realpath(results.root):
        raise BadData(
            f"--out {into.root} is the folder that is scored: give another one, stored methods "
            "stay as they are"
        )
    matrix = (
        None if chosen.metrics is None else matrices.read(chosen.metrics).with_device(chosen.device)
    )
    with on_device(chosen.device if matrix is None else matrix.device):
        if matrix is None:
            metrics = stored_metrics(results)
        else:
            metrics = Metrics.build(
                matrix.frame_metrics, matrix.trajectory_metrics, results.protocol()["size_px"]
            )
    with progress_bar("score", "methods") as progress:
        methods = rescore(results, into, metrics, progress)
    return conclude(into, methods, with_report=False, as_json=chosen.json)
