"""Track the camera of sequences: pose files and drift, or errors of steps on clips."""

import argparse
from pathlib import Path
from typing import Any

from geovp_benchmarks.arguments import add_settings, at_least, positive, settings
from geovp_benchmarks.progress import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the frames, the odometry and the output."""
    parser.add_argument("root", type=Path, metavar="ROOT", help="Folder of a data set.")
    text = "Sequences or stretches of them, such as 03 or 03[0:360)."
    parser.add_argument("frames", nargs="+", metavar="FRAMES", help=text)
    text = "Name of an odometry. Default: monocular."
    parser.add_argument("--odometry", default="monocular", metavar="NAME", help=text)
    add_settings(parser)
    text = "Camera image_K or camK. Default: 2, else 0."
    parser.add_argument("--camera", type=int, metavar="K", help=text)
    text = "Setting of the data set as in TOML, such as intrinsics=[fx, fy, cx, cy]."
    parser.add_argument("--data", action="append", default=[], metavar="FIELD=VALUE", help=text)
    text = "Folder for the pose files. Default: results/poses."
    parser.add_argument("--out", type=Path, default=Path("results/poses"), metavar="DIR", help=text)
    text = "Print errors per step on clips of N frames. Default: track whole sequences."
    parser.add_argument("--clips", type=at_least(2), metavar="N", help=text)
    text = "Frames between the starts of two clips. Default: 5."
    parser.add_argument("--stride", type=positive, default=5, metavar="N", help=text)
    text = "Side of the square crops of clips. Default: 256."
    parser.add_argument("--size", type=positive, default=256, metavar="PX", help=text)


def run(args: argparse.Namespace) -> int:
    """Write poses and print their drift, or print errors per step."""
    from geovp_benchmarks.evaluation.odometry import clip_table, track_sequences
    from geovp_benchmarks.tables.formats import columns
    from geovp_classic.data import layouts

    odometry = {"name": args.odometry, **settings(args)}
    camera: dict[str, Any] = {} if args.camera is None else {"camera": args.camera}
    data = {**layouts.spec(args.root), **camera, **settings(args, "data")}
    with progress_bar("poses", "frames") as progress:
        if args.clips is not None:
            data = {**data, "stride": args.stride, "size_px": [args.size, args.size]}
            table = clip_table(data, args.frames, odometry, args.clips, progress)
            print(*columns(table), sep="\n")
            return 0
        for sequence in track_sequences(data, args.frames, odometry, progress):
            print(f"{sequence.frames}: {sequence.tracked.mean():.1%} of frames tracked")
            table = sequence.drift()
            lines = columns(table) if table else ["no recorded poses to compare with"]
            print(*(f"  {line}" for line in [*lines, *sequence.write(args.out)]), sep="\n")
    return 0
