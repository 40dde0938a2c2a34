"""All measurements of speed as sections of a page, or one of them.

`PYTHONPATH=benchmarks python -m performance [--only SECTION] [--rounds N] [--kitti ROOT SEQUENCE]`
on a quiet machine. Times are CPU times of all threads, but for `live`.
"""

import argparse
from collections.abc import Sequence

from geovp_benchmarks.cli.options import add_options, option
from performance import libraries, live, splat


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the sections."""
    sections = {
        "live": lambda args: live.lines(10 * args.rounds, args.kitti),
        "rendering": lambda args: [splat.comparison().line(args.rounds)],
        "solvers": lambda args: [each.line(args.rounds) for each in libraries.problems()],
    }
    parser = argparse.ArgumentParser(
        prog="PYTHONPATH=benchmarks python -m performance",
        description="Processing time of a live prediction, and of our code next to named rivals.",
    )
    options = {
        "--only SECTION": option("Section. Default: all.", choices=sections),
        "--rounds N = 8": "Number of rounds after a warm-up.",
        "--kitti TEXT": option(
            "Root and sequence of KITTI odometry. Default: the synthetic street.", nargs=2
        ),
    }
    add_options(parser, options)
    args = parser.parse_args(arguments)
    for name in [args.only] if args.only else sections:
        print(f"## {name}\n\n```text", *sections[name](args), "```\n", sep="\n")


if __name__ == "__main__":
    main()
