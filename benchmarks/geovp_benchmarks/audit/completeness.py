"""Completeness of data sets and results: missing archives of KITTI, missing scores."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix import protocols
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables.formats import grid
from geovp_classic.data import kitti_archives, splits
from geovp_classic.data.windows import FrameRange
from geovp_classic.errors import BadData


def needed(protocol: str) -> tuple[dict[str, Any], list[str]]:
    """Return the data set of a protocol, and the names of its sequences.

    BadData if it is not KITTI.
    """
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
    results = Results(root)
    clips = results.protocol()["clips"]
    for name in results.protocol()["methods"]:
        method = results.by_name().get(name)
        missing = [clip for clip in clips if method is None or clip not in method.scored]
        if missing and (method is None or method.status != "skipped"):
            yield (
                f"{name}: scores of {len(missing)} of {len(clips)} clips are missing, such as "
                f"{missing[0]}"
            )
    for path in results.damaged_files():
        yield f"{path} is damaged"
