"""Check a data set or a results folder.

Print what is missing or damaged, and which named splits are complete.

Examples:
  geovp doctor path/to/kitti
  geovp doctor path/to/kitti --deep
  geovp doctor results/demo
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

from geovp_benchmarks.cli.options import LinesAndCode, add, add_flag, add_group
from geovp_benchmarks.progress import Progress, tracked


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the folder and how much of it is read."""
    text = "Folder of KITTI, Cityscapes, TUM, EuRoC, COLMAP or images, ROS bag, or results folder."
    add(parser, "root", "FOLDER", text)
    group = add_group(parser, "data sets")
    add_flag(group, "--deep", "Decode all images. Default: check names and headers.")


def run(args: argparse.Namespace, progress: Progress) -> LinesAndCode:
    """Print the findings; return 1 if something is wrong."""
    from geovp_benchmarks.tables.formats import grid
    from geovp_classic.data.doctor import Doctor

    if any((args.root / name).exists() for name in ("protocol.json", "datasets.json")):
        findings = [*examine_results(args.root)]
        advice = "`geovp run` with the same matrix computes what is missing"
        yield from [*findings, advice if findings else "nothing is missing"]
        return int(bool(findings))
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


def examine_results(root: Path) -> Iterator[str]:
    """Yield which scores a results folder lacks, and its damaged files."""
    from geovp_benchmarks.results.store import Results

    for label, results in Results(root).by_dataset().items():
        clips = results.protocol()["clips"]
        for name in results.protocol()["methods"]:
            method = results.method(name)
            stored = {clip for record in results.score_records(name) for clip in record.clips}
            missing = [clip for clip in clips if clip not in stored]
            if missing and (method is None or method.status != "skipped"):
                yield (
                    f"{Path(label, name)}: scores of {len(missing)} of {len(clips)} clips are "
                    f"missing, such as {missing[0]}"
                )
        for path in results.damaged_files():
            yield f"{path} is damaged"
