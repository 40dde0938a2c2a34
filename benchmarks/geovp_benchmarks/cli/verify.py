"""Compute a random sample of stored results again and say whether they reproduce;
writes nothing.
"""

import argparse
from pathlib import Path

from geovp_benchmarks.arguments import add_results_folder, at_least, positive
from geovp_benchmarks.progress import progress_bar, tracked
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which results, how many of them, on which data, and how close they have to be."""
    add_results_folder(parser)
    sample_help = "(method, clip) pairs, drawn at random (8); of several data sets, of each"
    parser.add_argument("--sample", type=positive, default=8, metavar="N", help=sample_help)
    parser.add_argument("--seed", type=at_least(0), default=0, metavar="S", help="of the draw (0)")
    parser.add_argument(
        "--root",
        type=Path,
        metavar="FOLDER",
        help="folder of the data set, in place of the stored one",
    )
    help_text = (
        "largest difference that still reproduces, in each metric's own unit (1e-4; 0: to the "
        "last bit)"
    )
    parser.add_argument(
        "--tolerance", type=at_least(0, float), default=1e-4, metavar="X", help=help_text
    )


def run(chosen: argparse.Namespace) -> int:
    """Print a verdict a pair; 0 when all reproduce."""
    from geovp_benchmarks.audit import verification
    from geovp_benchmarks.results.store import Results

    parts = [*Results(chosen.folder).by_dataset().values()]
    if chosen.root is not None and len(parts) > 1:
        raise BadData(
            f"--root replaces the root of one data set, and {chosen.folder} has several: give "
            "one's folder"
        )
    pairs = [
        pair for part in parts for pair in verification.sample(part, chosen.sample, chosen.seed)
    ]
    for part in parts:
        verification.check_dataset(part, chosen.root)
    with progress_bar("verify", "rows") as progress:
        verdicts = [
            verification.verify(pair, chosen.root) for pair in tracked(pairs, len(pairs), progress)
        ]
    good = sum(verdict.reproduces(chosen.tolerance) for verdict in verdicts)
    print(*(verdict.sentence(chosen.tolerance) for verdict in verdicts), sep="\n")
    versions = dict.fromkeys(line for part in parts for line in verification.other_versions(part))
    differences = verification.largest(parts[0], verdicts)
    print(*filter(None, [differences]), *versions, f"{good} of {len(verdicts)} reproduce", sep="\n")
    return int(good < len(verdicts))
