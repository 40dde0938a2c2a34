"""Check a data set or a results folder.

Print what is missing or damaged, and which named splits are complete. For KITTI, name the missing
archives of its official site, too; with --protocol, those that a published protocol needs.

Examples:
  geovp doctor path/to/kitti
  geovp doctor path/to/kitti --deep
  geovp doctor '{root = "path/to/images", image_bits = 12}'
  geovp doctor path/to/kitti_raw --protocol fvs20
  geovp doctor results/demo
"""

import argparse
import dataclasses

from geovp.progress import tracked
from geovp_benchmarks.cli.options import LinesAndCode, root_and_settings

ARGUMENTS = {
    "": {
        "root SPEC": (
            "Folder of KITTI, Cityscapes, TUM, EuRoC, COLMAP or images, ROS bag, results folder, "
            'or table of a data set as in TOML: {root = "...", image_bits = 12}.'
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
    from geovp_classic import registry
    from geovp_classic.data.doctor import Doctor
    from geovp_classic.data.layouts import detection

    root, settings = root_and_settings(args.root)
    if args.protocol:
        lines = completeness.missing_for_protocol(root, args.protocol)
        yield from lines or [f"{root} has all that {args.protocol} needs"]
        return int(bool(lines))
    if (root / "protocol.json").exists():
        findings = [*completeness.examine_results(root)]
        advice = "`geovp run` with the same matrix computes what is missing"
        yield from [*findings, advice if findings else "nothing is missing"]
        return int(bool(findings))
    name, dataset = detection.detect(root, is_part_allowed=bool(settings))
    settings = registry.values_of(type(dataset), settings, "datasets", name)
    diagnosis = Doctor().examine(root, settings, deep=args.deep, watch=tracked)
    rows = [list(row.values()) for row in diagnosis.rows]
    yield from grid([list(diagnosis.rows[0]), *rows])
    yield ""
    for finding in diagnosis.findings:
        yield f"{finding.severity}: {finding}"
    # the commands that predict have options for some of the settings
    for field in dataclasses.fields(dataset):
        if "_" in field.name and any(field.name in str(each) for each in diagnosis.findings):
            yield f"give settings as in: geovp doctor '{{root = \"{root}\", {field.name} = ...}}'"
            break
    yield f"complete named splits: {', '.join(diagnosis.usable_splits) or 'none'}"
    yield from completeness.missing_archives(root, name, dataset.folders())
    return int(not diagnosis.is_sound)
