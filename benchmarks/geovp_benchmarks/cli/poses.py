"""Track the camera of sequences.

Print errors under several alignments, of whole sequences, with pose files, or of short clips.

Examples:
  geovp poses path/to/kitti '03[0:360)'
  geovp poses path/to/kitti '03[180:360)' '06[0:51)' --clips 10
  geovp poses path/to/kitti 03 --clips 10 --odometry '{name = "recorded", path = "03.txt"}'
  geovp poses path/to/tum 'desk[0:200)' --odometry '{name = "monocular", scale = "unit-speed"}'
"""

import argparse
from typing import Any

from geovp_benchmarks.cli.options import Lines, number, option, root_and_settings, shared

ARGUMENTS = {
    "": {
        "root SPEC": (
            'Folder of a data set, ROS bag, or its table as in TOML: {root = "...", camera = 0}.'
        ),
        "frames FRAMES...": "Sequences or parts of them, such as 03 or 03[0:360).",
    },
    "odometry": {
        "--odometry SPEC = monocular": (
            "Name or TOML table of a component, see `geovp list odometries`."
        ),
        "--clips N": option(
            "Print median errors of clips of N frames; odometries that work on clips only, such as "
            "`recorded`, need it. Default: track whole sequences.",
            type=number(3),
        ),
    },
    "frames": shared("--rate", "--every"),
    "output": {"--out DIR = results/poses": "Folder for the results."},
}


def run(args: argparse.Namespace) -> Lines:
    """Print errors of whole sequences and write their poses, or print median errors of clips."""
    from geovp_benchmarks.tables.formats import grid
    from geovp_benchmarks.trajectories.odometry import error_table, track_clips, track_sequences
    from geovp_classic.data.formats import pose_files
    from geovp_classic.data.layouts import detection

    root, settings = root_and_settings(args.root)
    data: dict[str, Any] = {**detection.spec(root), **settings}
    if args.rate_hz is not None:
        data["rate_hz"] = args.rate_hz
    if args.frame_step > 1:
        data["frame_step"] = args.frame_step
    if args.clips is not None:
        data = {"stride": 5, "size_px": [256, 256], **data}
        for name, paths in track_clips(data, args.frames, args.odometry, args.clips):
            is_tracked = sum(path.tracked.mean() for path in paths) / len(paths)
            yield f"{name}: {len(paths)} clips, {is_tracked:.1%} of frames tracked"
            yield from grid(error_table(paths))
        return
    for frames, path in track_sequences(data, args.frames, args.odometry):
        yield f"{frames}: {path.tracked.mean():.1%} of frames tracked"
        yield from grid(error_table([path]))
        stem = f"{frames.sequence}-{frames.first:06d}-{frames.last:06d}"
        yield from map(str, pose_files.write_both(args.out, stem, path.estimate))
