"""The plan of a run: built components, clips, metrics, and the protocol.json that
describes them.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results.provenance import content_hash, protocol_id, versions
from geovp_benchmarks.results.store import Results, check_clip_name
from geovp_benchmarks.running.built_matrix import BuiltMatrix, build_matrix
from geovp_benchmarks.running.locking import Claim, unclaimed
from geovp_benchmarks.running.selection import Selection
from geovp_classic import registry
from geovp_classic.errors import BadData

KEPT_BY_DEFAULT = 3
# Views follow from the components' needs, and clips are stored by name.
NOT_HASHED = ("with_full", "with_right", "stride")


@dataclass(frozen=True)
class Options:
    """The options of a run."""

    limit: int | None = None  # only the first clips
    keep: int | Selection | None = (
        KEPT_BY_DEFAULT  # clips whose predictions are kept, or their number; None for all
    )
    fresh: bool = False  # recompute what another version of the code computed
    claim: Claim = unclaimed  # called before anything is written, see `locking`
    clips_per_task: int = 2


@dataclass(frozen=True)
class Plan:
    """Everything that is fixed before the first clip is read."""

    built: BuiltMatrix
    results: Results
    clips: tuple[str, ...]
    kept: frozenset[str]
    unavailable: Mapping[str, str]  # metric -> why
    shared: str  # the protocol's part of all fingerprints
    fresh: bool = False  # recompute what another version of the code computed
    selection: Selection | None = None  # the kept clips, where they were not just spread
    clips_per_task: int = 2

    @property
    def columns(self) -> tuple[str, ...]:
        """The metrics that can be computed here."""
        return tuple(name for name in self.built.metrics.built if name not in self.unavailable)


def prepare(matrix: Matrix, results: Results, options: Options) -> Plan:
    """Build everything once, choose the clips and write protocol.json."""
    plan = look(matrix, results, options)
    options.claim(content_hash([plan.shared, matrix.to_json(), plan.clips]))
    before = results.protocol() if results.begun else {}
    if before.get("fingerprint") != plan.shared:
        results.swap("clips", before.get("fingerprint", ""), plan.shared)
    results.write_protocol(_protocol(plan))
    return plan


def look(matrix: Matrix, results: Results, options: Options) -> Plan:
    """The same, but nothing is written."""
    built = build_matrix(matrix.to_json())
    clips = built.clip_names(options.limit)
    if not clips:
        raise BadData(
            "the data set has no clip of that length: give a longer sequence or fewer frames a clip"
        )
    for clip in clips:
        check_clip_name(clip)
    selection = options.keep if isinstance(options.keep, Selection) else None
    if isinstance(options.keep, Selection):
        kept = options.keep.among(clips)
    else:
        kept = spread(clips, len(clips) if options.keep is None else options.keep)
    unavailable = built.metrics.unavailable(matrix.size_px)
    plan = Plan(
        built,
        results,
        clips,
        kept,
        unavailable,
        _shared(built),
        options.fresh,
        selection,
        options.clips_per_task,
    )
    before = results.protocol() if results.begun else {}
    is_same = before.get("fingerprint") == plan.shared
    if is_same and options.limit is not None and len(before["clips"]) > len(clips):
        raise BadData(
            f"{results.root} holds {len(before['clips'])} clips, more than --limit "
            f"{options.limit} would leave: "
            "give another folder with --out"
        )
    return plan


def _protocol(plan: Plan) -> dict[str, Any]:
    matrix = plan.built.matrix
    protocol = {
        "name": matrix.name,
        "dataset": registry.describe(plan.built.dataset),
        "dataset_name": plan.built.dataset.name,
        "split_hash": _split_hash(plan.built),
        "num_past": matrix.num_past,
        "num_future": matrix.num_future,
        "size_px": list(matrix.size_px),
        "stride": matrix.stride,
        "metrics": plan.built.metrics.about(plan.unavailable),
        "methods": [method.name for method in matrix.methods],
        "clips": list(plan.clips),
        "kept": None if plan.selection is None else dataclasses.asdict(plan.selection),
        "fingerprint": plan.shared,
        "versions": versions(),
    }
    return {**protocol, "id": protocol_id(protocol)}


def spread(clips: tuple[str, ...], count: int) -> frozenset[str]:
    """`count` clips, evenly spread from the first to the last; the middle one when it is one."""
    count, last = min(count, len(clips)), len(clips) - 1
    return frozenset(
        clips[round(i * last / (count - 1)) if count > 1 else last // 2] for i in range(count)
    )


def _shared(built: BuiltMatrix) -> str:
    """A hash of everything that a row depends on except the method and the code."""
    matrix = built.matrix
    dataset = {
        key: value
        for key, value in registry.describe(built.dataset).items()
        if key not in NOT_HASHED
    }
    if "root" in dataset:
        dataset["root"] = str(Path(dataset["root"]).resolve())
    numbers = [matrix.num_past, matrix.num_future, *matrix.size_px]
    return content_hash({"dataset": dataset, "split": _split_hash(built), "numbers": numbers})


def _split_hash(built: BuiltMatrix) -> str:
    """The data set's hash of the frames it consists of, "" where its settings determine them."""
    return str(getattr(built.dataset, "split_hash", ""))
