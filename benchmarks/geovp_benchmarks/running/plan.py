"""Plan of a run: the clips, the records of protocol and methods, and what each method lacks."""

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geovp.provenance import versions
from geovp_benchmarks.failure import Failure
from geovp_benchmarks.matrix.components import files_of, weights_of
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results.provenance import PATHS, content_hash, protocol_id
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.running.task import BuiltMatrix, Task, build_matrix, code_of
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.types import PrivilegedInput


@dataclass(frozen=True)
class Plan:
    """Everything that is fixed before the first clip is read."""

    matrix: Matrix
    results: Results
    limit: int | None = None  # number of clips
    keep: str = "3"  # clips whose predictions are stored; see `select`
    is_fresh: bool = False  # whether to recompute what another version of the code computed
    shard: tuple[int, int] | None = None  # (part from 1, number of parts) of the clips to compute

    @cached_property
    def built(self) -> BuiltMatrix:
        """Build everything once; nothing is written."""
        build_matrix.cache_clear()  # packages or weights may have been installed
        return build_matrix(self.matrix_json)

    @cached_property
    def matrix_json(self) -> str:
        """Return the matrix as data for other processes, with the absolute root of its data."""
        root = self.matrix.data_root
        return self.matrix.override(root=root and root.resolve()).model_dump_json()

    @cached_property
    def clips(self) -> Sequence[str]:
        """Return the names of the clips; raise BadData if there are none.

        A limit takes none from a folder that has more of them.
        """
        clips = self.built.clip_names
        if self.limit is not None:
            stored = self.results.protocol()["clips"] if self.results.begun else []
            has_more = len(stored) > self.limit and stored == [*clips[: len(stored)]]
            clips = clips[: len(stored) if has_more else self.limit]
        if not clips:
            raise BadData(
                "the data set has no clip of that length: give a longer sequence or fewer frames "
                "a clip"
            )
        return clips

    @cached_property
    def own_clips(self) -> Sequence[str]:
        """Return the clips to compute, up to the limit: those of a shard share frames."""
        clips, (part, num_parts) = self.clips[: self.limit], self.shard or (1, 1)
        first = (part - 1) * len(clips) // num_parts
        return clips[first : part * len(clips) // num_parts]

    @cached_property
    def stored_clips(self) -> Set[str]:
        """Return the clips whose predictions are stored."""
        return select(self.keep, self.clips)

    @cached_property
    def protocol(self) -> dict[str, Any]:
        """Return the content of protocol.json.

        Its fingerprint is a hash of what all scores depend on except clips, method and code.
        """
        built, matrix = self.built, self.matrix
        # "" if the settings determine the frames
        split_hash = str(getattr(built.dataset, "split_hash", ""))
        fingerprint = content_hash([matrix.num_past, matrix.num_future, *matrix.size_px])
        shared = {"name", "num_past", "num_future", "size_px", "stride"}
        protocol = {
            **matrix.model_dump(include=shared),
            "dataset": registry.describe(built.dataset),
            "dataset_name": built.dataset.name,
            "split_hash": split_hash,
            "metrics": built.metrics.about,
            "methods": self._names(fingerprint),
            "clips": list(self.clips),
            "digests": self.digests,
            "fingerprint": fingerprint,
            "versions": versions(),
        }
        return {**protocol, "id": protocol_id(protocol)}

    @cached_property
    def digests(self) -> dict[str, str]:
        """Return a hash of the content of each clip.

        Data sets that cannot tell it have the hash of their settings, without paths.
        """
        dataset = self.built.dataset
        if hasattr(dataset, "clip_digest"):
            return {clip: dataset.clip_digest(index) for index, clip in enumerate(self.clips)}
        settings = registry.describe(dataset).items()
        unused = (*PATHS, "with_full", "with_right", "stride", "num_clips")  # or only add clips
        frames = {key: value for key, value in settings if key not in unused}
        digest = content_hash([frames, str(getattr(dataset, "split_hash", ""))])[:16]
        return dict.fromkeys(self.clips, digest)

    @property
    def changed(self) -> list[str]:
        """Return the clips whose content differs from that of the last run in the folder."""
        before = self.results.digests
        return [clip for clip, digest in self.digests.items() if before.get(clip, digest) != digest]

    def _names(self, fingerprint: str) -> list[str]:
        """Return the names of the methods, with those of earlier runs with other --methods."""
        names = set(self.built.predictors)
        if self.results.begun and self.results.protocol()["fingerprint"] == fingerprint:
            names.update(self.results.protocol()["methods"])
        return [method.name for method in self.matrix.select().methods if method.name in names]

    @cached_property
    def methods(self) -> list[Method]:
        """Return the records of the methods before the first clip."""
        return [self._record(method) for method in self.matrix.methods]

    def _record(self, method: Method) -> Method:
        """Return the record of a method; without a fingerprint if it cannot be built here."""
        built, specs = self.built, self.matrix.specs
        predictor, fingerprint = built.predictors[method.name], self.protocol["fingerprint"]
        asked: dict[str, Any] = {role: specs[key] for role, key in method.entries.items()}
        asked |= {"num_samples": method.num_samples, "protocol": fingerprint}
        facts: dict[str, Any] = {"asked": asked, "components": {}}
        if isinstance(predictor, Failure):
            facts |= predictor._asdict()
        else:
            components = {
                role: registry.describe(built.components[key])
                for role, key in method.entries.items()
            }
            needs = [str(each.name) for each in PrivilegedInput if each in predictor.needs]
            facts |= {
                "components": components,
                "privileged_inputs": needs,
                "fingerprint": content_hash(
                    [fingerprint, components, method.num_samples, *files_of([predictor])]
                ),
                "about": weights_of([predictor]),
                "code": code_of(predictor),
            }
        return method.model_copy(update=facts)

    def missing(self, method: Method) -> Set[str]:
        """Return the clips that failed, or that lack scores or a prediction to be kept."""
        if not method.fingerprint:
            return set()
        predicted = set(self.results.clips(self.protocol["fingerprint"]).names)
        predicted &= set(self.results.predictions(method).names)
        missing = set(self.clips)
        for clip, record in self.results.scored(
            method.name, method.fingerprint, self.digests
        ).items():
            has_failed = clip in record.failures and record.failures[clip].status == "failed"
            has_metrics = self.built.metrics.described.items() <= record.metrics.items()
            is_current = record.code == method.code or not self.is_fresh
            if has_metrics and is_current and not has_failed:
                missing.discard(clip)
        return missing | (self.stored_clips - predicted)

    def tasks(self) -> Iterator[Task]:
        """Yield a task for each clip that some methods lack."""
        matrix, root = self.matrix_json, self.results.root.resolve()
        missing = {method.name: self.missing(method) for method in self.methods}
        of_shard = set(self.own_clips)
        for index, clip in enumerate(self.clips):
            if clip not in of_shard:
                continue
            methods = [method for method in self.methods if clip in missing[method.name]]
            if methods:
                is_kept = clip in self.stored_clips
                yield Task(matrix, root, index, clip, self.digests[clip], methods, is_kept)


def select(keep: str, clips: Sequence[str]) -> set[str]:
    """Return the clips of a number, "all", or names with commas; raise BadData for other words."""
    if keep == "all":
        return set(clips)
    if keep == "1":
        return {clips[len(clips) // 2]}
    if keep.isdecimal():
        indices = np.linspace(0, len(clips) - 1, min(int(keep), len(clips))).round().astype(int)
        return {clips[index] for index in indices}
    names = set(keep.split(","))
    if unknown := names.difference(clips):
        raise BadData(
            f"--keep {keep}: expected a number, all or names of clips; {min(unknown)!r} is not "
            f"among {clips[0]} to {clips[-1]}"
        )
    return names
