"""Recompute a sample of stored results.

Print the largest differences of each pair; nothing is written.

Examples:
  geovp verify results/demo
  geovp verify docs/results/stored/fusion --root path/to/kitti --tolerance 0.005
"""

import argparse

from geovp.progress import tracked
from geovp_benchmarks.cli.options import LinesAndCode, number, option, shared

ARGUMENTS = {
    "": shared("folder"),
    "sample": {
        **shared("--root"),
        "--pairs N = 8": "Number of (method, clip) pairs.",
        "--seed SEED = 0": option("Random seed of the sample.", type=number(0)),
        "--tolerance X = 1e-4": option(
            "Largest difference that passes, in the unit of each metric.",
            type=number(0, kind=float),
        ),
    },
}


def run(args: argparse.Namespace) -> LinesAndCode:
    """Print a line per pair; return 0 if all metrics of all pairs are reproduced."""
    from geovp_benchmarks.checks import verification
    from geovp_benchmarks.results.store import Results

    results = Results(args.folder)
    pairs = verification.sample(results, args.pairs, args.seed, args.root)
    good = 0
    unavailable: dict[str, str] = {}
    for pair in tracked(pairs):
        verdict = verification.verify(pair, args.root, args.tolerance)
        yield verdict.sentence
        good += verdict.is_reproduced
        unavailable |= verdict.unavailable
    yield from verification.other_versions(results)
    for name, reason in unavailable.items():
        yield f"{name} cannot be compared: {reason}"
    where = " in the other metrics" if unavailable else ""
    yield f"{good} of {len(pairs)} reproduce{where}"
    return int(good < len(pairs) or bool(unavailable))
