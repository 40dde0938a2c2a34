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
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from geovp_benchmarks.cli.options import LinesAndCode
from geovp_benchmarks.progress import tracked

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
    from geovp_benchmarks.tables.formats import grid
    from geovp_classic.data import layouts
    from geovp_classic.data.doctor import Doctor

    if args.protocol:
        spec, sequences = needed(args.protocol)
        lines = missing_archives(args.root, spec, sequences)
        yield from lines or [f"{args.root} has all that {args.protocol} needs"]
        return int(bool(lines))
    if any((args.root / name).exists() for name in ("protocol.json", "datasets.json")):
        findings = [*examine_results(args.root)]
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
    name, dataset = layouts.detect(args.root)
    yield from missing_archives(args.root, {"name": name}, dataset.folders())
    return int(not diagnosis.is_sound)


def needed(protocol: str) -> tuple[dict[str, Any], list[str]]:
    """Return the data set of a protocol, and the names of its sequences.

    BadData if it is not KITTI.
    """
    from geovp_benchmarks.matrix import protocols
    from geovp_classic.data import splits
    from geovp_classic.data.windows import FrameRange
    from geovp_classic.errors import BadData

    loaded = protocols.load(protocol)
    if loaded.dataset is None:
        raise BadData(f"--protocol {protocol}: is measured on {loaded.data}, not on KITTI")
    spec = dict(loaded.dataset)
    if spec.get("split"):
        ranges = splits.load(spec["split"])
    else:
        ranges = tuple(map(FrameRange.parse, spec["sequences"]))
    return spec, [frames.sequence for frames in ranges]


def missing_archives(root: Path, spec: dict[str, Any], sequences: Iterable[str]) -> list[str]:
    """Return the lines about KITTI's archives that a root lacks; none for other data sets."""
    from geovp_benchmarks.tables.formats import grid
    from geovp_classic.data import kitti_archives

    missing = []
    if spec["name"] == "kitti":
        missing = kitti_archives.missing_odometry(root, sequences, spec.get("camera"))
    elif spec["name"] == "kitti-raw":
        missing = kitti_archives.missing_raw(root, sequences)
    if not missing:
        return []
    rows = [list(archive) for archive in missing]
    return [
        "",
        "missing archives of www.cvlibs.net/datasets/kitti (download them with your own account):",
        "",
        *grid([kitti_archives.COLUMNS, *rows]),
        "",
        f"unpack them so that the paths above lie in {root}",
    ]


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
