"""Track the camera of sequences.

Write pose files, and print drift; or print errors of steps on short clips.

Examples:
  geovp poses path/to/kitti '03[0:360)'
  geovp poses path/to/kitti '03[180:360)' '06[0:51)' --clips 10
  geovp poses path/to/tum 'desk[0:200)' --odometry '{name = "monocular", scale = "unit-speed"}'
"""

import argparse
from pathlib import Path
from typing import Any

from geovp_benchmarks.arguments import at_least
from geovp_benchmarks.cli.options import add, add_group
from geovp_benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the frames, the odometry and the output."""
    text = 'Folder of a data set, or its table as in TOML: {root = "...", camera = 0}.'
    add(parser, "root", "SPEC", text)
    text = "Sequences or parts of them, such as 03 or 03[0:360)."
    add(parser, "frames", "FRAMES...", text)
    group = add_group(parser, "odometry")
    text = "Name or TOML table of a component, see `geovp list odometries`. Default: monocular."
    add(group, "--odometry", "SPEC", text, "monocular")
    text = "Print errors per step on clips of N frames. Default: track whole sequences."
    add(group, "--clips", "N", text, type=at_least(2))
    group = add_group(parser, "output")
    folder = Path("results/poses")
    add(group, "--out", "DIR", f"Folder for the results. Default: {folder}.", folder)


def run(args: argparse.Namespace) -> int:
    """Write poses and print their drift, or print errors of steps."""
    from geovp_benchmarks.evaluation.odometry import clip_table, track_sequences
    from geovp_benchmarks.tables.formats import columns
    from geovp_classic.data import layouts

    table = args.root if isinstance(args.root, dict) else {"root": args.root}
    data: dict[str, Any] = {**layouts.spec(Path(table["root"])), **table}
    with progress_bar("poses", "frames") as progress:
        if args.clips is not None:
            data = {"stride": 5, "size_px": [256, 256], **data}
            errors = clip_table(data, args.frames, args.odometry, args.clips, progress)
            print(*columns(errors), sep="\n")
            return 0
        for sequence in track_sequences(data, args.frames, args.odometry, progress):
            print(f"{sequence.frames}: {sequence.tracked.mean():.1%} of frames tracked")
            drift = sequence.drift()
            lines = columns(drift) if drift else ["no recorded poses to compare with"]
            print(*(f"  {line}" for line in [*lines, *sequence.write(args.out)]), sep="\n")
    return 0
