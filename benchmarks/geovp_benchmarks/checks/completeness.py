"""Completeness of data sets and results: missing archives of KITTI, missing scores."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from geovp_benchmarks.checks import kitti_archives
from geovp_benchmarks.matrix import papers
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.tables.formats import grid
from geovp_classic.data.recordings import splits
from geovp_classic.data.recordings.windows import FrameRange
from geovp_classic.errors import BadData


def missing_for_protocol(root: Path, name: str) -> list[str]:
    """Return the lines about archives that a protocol needs and a root lacks.

    BadData if its data set is not KITTI.
    """
    paper = papers.load(name)
    dataset = paper.dataset
    if not dataset["name"].startswith("kitti"):
        raise BadData(
            f"--protocol {name}: is measured on {paper.data}, not on KITTI. Data: {paper.where}"
        )
    if "split" in dataset:
        ranges = splits.load(dataset["split"])
    else:
        ranges = tuple(map(FrameRange.parse, dataset["sequences"]))
    sequences = [frames.sequence for frames in ranges]
    return missing_archives(root, dataset["name"], sequences, dataset.get("camera"))


def missing_archives(
    root: Path, dataset: str, sequences: Iterable[str], camera: int | None = None
) -> list[str]:
    """Return the lines about KITTI's archives that a root lacks; none for other data sets."""
    missing = []
    if dataset == "kitti":
        missing = kitti_archives.missing_odometry(root, sequences, camera)
    elif dataset == "kitti-raw":
        missing = kitti_archives.missing_raw(root, sequences)
    if not missing:
        return []
    return [
        "",
        "missing archives of www.cvlibs.net/datasets/kitti (download them with your own account):",
        "",
        *grid([kitti_archives.COLUMNS, *missing]),
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
