"""Check a data set.

Print what is missing or damaged, and which named splits are complete.

Examples:
  geovp doctor path/to/kitti
  geovp doctor path/to/kitti --deep
"""

import argparse

from geovp_benchmarks.cli.options import LinesAndCode, add, add_flag
from geovp_benchmarks.progress import Progress, tracked


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the folder and how much of it is read."""
    text = "Folder of KITTI odometry or raw, TUM, EuRoC, COLMAP or images."
    add(parser, "root", "FOLDER", text)
    add_flag(parser, "--deep", "Decode all images. Default: check names and headers.")


def run(args: argparse.Namespace, progress: Progress) -> LinesAndCode:
    """Print the findings; return 1 if something is wrong."""
    from geovp_benchmarks.tables.formats import grid
    from geovp_classic.data.doctor import Doctor

    diagnosis = Doctor().examine(
        args.root, deep=args.deep, watch=lambda names: tracked(names, len(names), progress)
    )
    rows = [list(row.values()) for row in diagnosis.rows]
    yield from grid([list(diagnosis.rows[0]), *rows])
    yield ""
    for finding in diagnosis.findings:
        yield f"{finding.severity}: {finding}"
    yield f"complete named splits: {', '.join(diagnosis.usable_splits) or 'none'}"
    return int(not diagnosis.is_sound)
