"""Draw the figures of a results folder.

Examples:
  geovp plot results/demo
  geovp plot results/demo --methods copy-last "vo+prior + fusion" --metrics psnr
  geovp plot results/demo --against copy-last
  geovp plot results/demo --by turning
  geovp plot results/demo --format pdf --width 3.3in
"""

import argparse
import re

from geovp_benchmarks.cli.options import SELECTION, Lines, option, shared


def length_in(text: str) -> float:
    """Parse a length such as "3.3in", "84mm" or "240pt" into inches."""
    units_in = {"in": 1.0, "cm": 1 / 2.54, "mm": 1 / 25.4, "pt": 1 / 72.27, "": 1.0}
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)", text)
    if not match or match[2] not in units_in:
        raise argparse.ArgumentTypeError(f"{text!r} is not a length such as 3.3in or 84mm")
    length = float(match[1]) * units_in[match[2]]
    if length < 2.5:
        raise argparse.ArgumentTypeError(f"{text} is too narrow for labels: give 2.5in or more")
    return length


ARGUMENTS = {
    "": shared("folder"),
    "selection": SELECTION,
    "output": {
        "--format pdf|svg|png": "Format. Default: png and svg.",
        "--width LENGTH": option(
            "Width in a paper, such as 3.3in, 84mm or 240pt, without titles. Default: with titles.",
            type=length_in,
        ),
    },
}


def run(args: argparse.Namespace) -> Lines:
    """Write the figures, and print their paths."""
    from geovp_benchmarks import plots
    from geovp_benchmarks.results.store import Results

    formats = (args.format,) if args.format else ()
    options = plots.Options(args.metrics, args.by, args.against, formats, args.width)
    for results in Results(args.folder).select(*args.methods).by_dataset().values():
        for _, paths in plots.write_all(results, options):
            yield from map(str, paths)
