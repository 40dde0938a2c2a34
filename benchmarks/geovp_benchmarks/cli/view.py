"""Write a kept clip as a Rerun recording: frames, cloud, paths and sampled futures
on a time line.

It needs the extra `viz` (rerun): `pip install "geovp-classic[viz]"`.
"""

import argparse
from pathlib import Path

from geovp_benchmarks.arguments import add_results_folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which clip of which results, and which rows."""
    add_results_folder(parser)
    parser.add_argument("clip", metavar="CLIP", help="a kept clip, as the report names it")
    parser.add_argument(
        "--method", action="append", default=[], metavar="METHOD", help="only this method, or these"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.rrd", help="where to (default: DIR/recordings/CLIP.rrd)"
    )


def run(chosen: argparse.Namespace) -> int:
    """Write the file and print how to look at it."""
    from geovp_benchmarks.plots import recording
    from geovp_benchmarks.results.store import Results

    path = recording.write(Results(chosen.folder), chosen.clip, chosen.method, chosen.out)
    print(f"{path}\nlook at it with: rerun '{path}'")
    return 0
