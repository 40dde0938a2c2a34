"""Error budget of one method: scores with its stages replaced by ground truth.

Differences are paired over clips. --sensitivity offsets the true poses instead.
"""

import argparse

from geovp_benchmarks.arguments import add_method
from geovp_benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the method, the clips and what is replaced."""
    add_method(parser)
    text = "Use the depth of right images as ground truth where no depth is recorded."
    parser.add_argument("--stereo", action="store_true", help=text)
    text = "Print the changes by constant offsets of the true poses instead."
    parser.add_argument("--sensitivity", action="store_true", help=text)


def run(args: argparse.Namespace) -> int:
    """Print the tables."""
    from geovp_benchmarks.evaluation.error_budget import error_budget, pose_sensitivity
    from geovp_benchmarks.evaluation.variants import read_method
    from geovp_benchmarks.matrix import schema
    from geovp_classic.types import PrivilegedInput

    matrix = schema.read(args.matrix).with_root(args.root)
    matrix = matrix.replace(stride=args.stride or matrix.stride)
    needs = PrivilegedInput.RIGHT_FRAMES if args.stereo else PrivilegedInput.NONE
    method = read_method(matrix, args.method, args.limit, needs)
    measure = pose_sensitivity if args.sensitivity else error_budget
    with progress_bar("budget", "clips") as progress:
        table = measure(method, progress)
    print(*table.lines(), sep="\n")
    return 0
