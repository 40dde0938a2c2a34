"""Look after data sets and results folders."""

import argparse
import dataclasses
import json
from pathlib import Path

from geovp_benchmarks.arguments import add_json
from geovp_benchmarks.progress import progress_bar, tracked


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """`doctor`, the only verb so far."""
    actions = parser.add_subparsers(metavar="VERB", required=True)
    doctor = actions.add_parser(
        "doctor", help="what is there, and what is wrong with it, line by line"
    )
    doctor.add_argument(
        "root",
        type=Path,
        metavar="ROOT",
        help="KITTI odometry or raw, TUM, EuRoC, COLMAP, images, or a results folder",
    )
    add_json(doctor)
    doctor.add_argument("--deep", action="store_true", help="decode every image as well")


def run(chosen: argparse.Namespace) -> int:
    """Print a table of the sequences, the findings, and the splits that can be used."""
    if any((chosen.root / name).exists() for name in ("protocol.json", "datasets.json")):
        return _examine_results(chosen.root, chosen.json)
    from geovp_benchmarks.tables.formats import columns
    from geovp_classic.data.doctor import Doctor

    with progress_bar("doctor", "sequences") as progress:
        found = Doctor().examine(
            chosen.root, deep=chosen.deep, watch=lambda names: tracked(names, len(names), progress)
        )
    if chosen.json:
        print(
            json.dumps(
                dataclasses.asdict(found) | {"is_sound": found.is_sound}, indent=2, default=str
            )
        )
        return int(not found.is_sound)
    print(
        *columns([list(found.rows[0]), *(list(row.values()) for row in found.rows)]), "", sep="\n"
    )
    for finding in found.findings:
        print(f"{finding.severity}: {finding}")
    print(f"named splits whose frames are all here: {', '.join(found.usable_splits) or 'none'}")
    return int(not found.is_sound)


def _examine_results(root: Path, as_json: bool) -> int:
    """Print which scores a results folder lacks; 1 when any are missing or damaged."""
    from geovp_benchmarks.results.store import Results

    lacks = []
    for label, results in Results(root).by_dataset().items():
        protocol = results.protocol()
        for name in protocol["methods"]:
            record = results.method(name)
            if record is not None and record.status == "skipped":  # it has no scores to lack
                continue
            method = f"{label}/{name}" if label else name
            stored = {clip for part in results.parts(name) for clip in part.clips}
            missing = [clip for clip in protocol["clips"] if clip not in stored]
            if missing:
                total = len(protocol["clips"])
                lacks.append(
                    f"{method}: scores of {len(missing)} of {total} clips are missing, "
                    f"such as {missing[0]}"
                )
            lacks += [f"{path} is damaged" for path in results.damaged_parts(name)]
    if as_json:
        print(json.dumps({"is_sound": not lacks, "findings": lacks}, indent=2))
    else:
        advice = "`geovp run` with the same matrix computes what is missing"
        print(*(lacks or ["nothing is missing"]), *[advice] * bool(lacks), sep="\n")
    return int(bool(lacks))
