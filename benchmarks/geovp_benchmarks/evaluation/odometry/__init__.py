"""Track whole sequences: pose files, drift, and a plot with the ground truth; or steps of many
short clips.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geovp_benchmarks.arguments import add_settings, positive, settings
from geovp_benchmarks.progress import Progress
from geovp_classic.errors import BadData


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which frames, which odometry, and whether clips are cut from them."""
    parser.add_argument(
        "root", type=Path, metavar="ROOT", help="a folder of a data set, see `geovp list datasets`"
    )
    parser.add_argument(
        "frames",
        nargs="+",
        metavar="FRAMES",
        help="sequences or stretches of them, as 03 or 03[0:360)",
    )
    parser.add_argument(
        "--odometry",
        default="monocular",
        metavar="NAME",
        help="as `geovp list odometries` shows it",
    )
    add_settings(parser)
    parser.add_argument(
        "--camera", type=int, metavar="K", help="the camera image_K (default: 2, else 0) or camK"
    )
    help_text = "a setting of the data set, written as in TOML: intrinsics=[fx, fy, cx, cy]"
    parser.add_argument(
        "--data", action="append", default=[], metavar="FIELD=VALUE", help=help_text
    )
    parser.add_argument(
        "--out", type=Path, default=Path("results/poses"), metavar="DIR", help="where files go"
    )
    parser.add_argument(
        "--clips",
        type=positive,
        metavar="N",
        help="instead: errors a step on clips of N frames each",
    )
    parser.add_argument(
        "--stride",
        type=positive,
        default=5,
        metavar="N",
        help="frames between two clips' starts (5)",
    )
    parser.add_argument(
        "--size", type=positive, default=256, metavar="PX", help="of the clips' square crops (256)"
    )


def run(chosen: argparse.Namespace, progress: Progress) -> Iterator[str]:
    """Files and their drift, or with `--clips` a table of errors a step; BadData for one frame a
    clip.
    """
    from geovp_benchmarks.evaluation.odometry import clips, paths
    from geovp_benchmarks.tables.formats import columns
    from geovp_classic.data import layouts

    spec = {"name": chosen.odometry, **settings(chosen)}
    camera: dict[str, Any] = {} if chosen.camera is None else {"camera": chosen.camera}
    data = {**layouts.spec(chosen.root), **camera, **settings(chosen, "data")}
    if chosen.clips is None:
        for tracked in list(paths.track(data, chosen.frames, spec, progress)):
            fraction = f"{tracked.tracked.mean():.1%} of {len(tracked.tracked)}"
            yield f"{tracked.frames}: {fraction} frames tracked"
            rows = tracked.rows()
            lines = columns([paths.COLUMNS, *rows]) if rows else ["no real poses to compare with"]
            yield from (f"  {line}" for line in [*lines, *paths.write(tracked, chosen.out)])
        return
    if chosen.clips < 2:
        raise BadData(f"--clips is {chosen.clips}, expected 2 frames or more: one has no motion")
    cut = {**data, "stride": chosen.stride, "size_px": [chosen.size, chosen.size]}
    found = list(clips.measure(cut, chosen.frames, spec, chosen.clips, progress))
    yield from columns([clips.COLUMNS, *(steps.row(frames) for frames, steps in found)])
