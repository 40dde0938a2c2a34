"""Check a data set or a results folder.

Print what is missing or damaged, and which named splits are complete. For KITTI, name the missing
archives of its official site, too; with --protocol, those that a published protocol needs.

Examples:
  geovp doctor path/to/kitti
  geovp doctor path/to/kitti --deep
  geovp doctor path/to/kitti_raw --protocol fvs20
  geovp doctor results/demo
"""

import argparse

from geovp.progress import tracked
from geovp_benchmarks.cli.options import LinesAndCode

ARGUMENTS = {
    "": {
        "root FOLDER": (
            "Folder of KITTI, Cityscapes, TUM, EuRoC, COLMAP or images, ROS bag, or results folder."
        )
    },
    "data sets": {
        "--deep": "Decode all images. Default: check names and headers.",
        "--protocol NAME": (
            "Only name the KITTI archives that this protocol needs; see `geovp list protocols`."
        ),
    },
}


def run(args: argparse.Namespace) -> LinesAndCode:
    """Print the findings; return 1 if something is wrong."""
    from geovp_benchmarks.checks import completeness
    from geovp_benchmarks.tables.formats import grid
    from geovp_classic.data.doctor import Doctor
    from geovp_classic.data.layouts import detection

    if args.protocol:
        lines = completeness.missing_for_protocol(args.root, args.protocol)
        yield from lines or [f"{args.root} has all that {args.protocol} needs"]
        return int(bool(lines))
    if (args.root / "protocol.json").exists():
        findings = [*completeness.examine_results(args.root)]
        advice = "`geovp run` with the same matrix computes what is missing"
        yield from [*findings, advice if findings else "nothing is missing"]
        return int(bool(findings))
    diagnosis = Doctor().examine(args.root, deep=args.deep, watch=tracked)
    rows = [list(row.values()) for row in diagnosis.rows]
    yield from grid([list(diagnosis.rows[0]), *rows])
    yield ""
    for finding in diagnosis.findings:
        yield f"{finding.severity}: {finding}"
    yield f"complete named splits: {', '.join(diagnosis.usable_splits) or 'none'}"
    name, dataset = detection.detect(args.root)
    yield from completeness.missing_archives(args.root, name, dataset.folders())
    return int(not diagnosis.is_sound)
