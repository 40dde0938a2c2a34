"""Results on disk: the only module that knows where which file is.

    <root>/protocol.json                      data set, clip names, sizes, metrics, versions
    <root>/clips/<clip>.<id>.npz              kept clips, by their content
    <root>/<method>/method.json               components, privileged inputs, status; see Method
    <root>/<method>/scores/part-<hash>.parquet  a row per clip, sample, step and metric
    <root>/<method>/predictions/<clip>.<id>.npz  kept predictions, by method and content
    <root>/tables  plots  report.html

Files are written next to their destination and renamed. Scores are stored by clip name, in one
file per batch until a run ends; the name of a score file holds a hash of its content. Files of
earlier settings stay, and count again with these settings.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import duckdb

from geovp_benchmarks.results import kept_files, records
from geovp_benchmarks.results.kept_files import KeptFiles
from geovp_benchmarks.results.records import Method
from geovp_benchmarks.results.score_files import Facts, NewestRecords, ScoreFiles, ScoreRecord
from geovp_benchmarks.results.scores import Scores
from geovp_classic import files
from geovp_classic.atomic import write_bytes
from geovp_classic.errors import BadData, nearest
from geovp_classic.types import Clip, FloatArray, Prediction

__all__ = ["Method", "Results", "ScoreRecord", "Scores"]

Item = TypeVar("Item")


def _remembered(read: Callable[..., Item]) -> Callable[..., Item]:
    """Return a method of Results that reads once, until something is written.

    It reads again where a run has merged files meanwhile.
    """

    @functools.wraps(read)
    def reader(results: Results, *args: Any) -> Item:
        key = (results, read, *args)
        for _ in range(4):
            with suppress(FileNotFoundError, duckdb.IOException):
                if key not in results.memory:
                    results.memory[key] = read(results, *args)
                value: Item = results.memory[key]
                return value
            results.memory.clear()
        return read(results, *args)

    return reader


@dataclass(frozen=True)
class Results:
    """A results folder; records and the metadata of scores are read once, until it is written."""

    root: Path
    subset: frozenset[str] | None = None  # of the clips, all that is read of them; None: all
    label: str = ""  # of the subset, for people
    selected: tuple[str, ...] = ()  # labels of methods, in this order; empty: all
    memory: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)  # what was read

    # Reading

    @_remembered
    def protocol(self) -> dict[str, Any]:
        """Return what all methods share; see records.Protocol."""
        if not self.begun:
            raise BadData(
                f"{self.root} has no protocol.json: not a results folder: give one that "
                "`geovp run` wrote"
            )
        protocol = {**records.read_protocol(self.root / "protocol.json")}
        if self.subset is not None:
            clips = [clip for clip in protocol["clips"] if clip in self.subset]
            name = f"{protocol['name']}, {self.label} (n = {len(clips)})"
            protocol |= {"name": name, "clips": clips}
        return protocol

    @property
    def begun(self) -> bool:
        """Return whether a protocol was written."""
        return (self.root / "protocol.json").exists()

    def methods(self) -> list[Method]:
        """Return the selected methods; of all that have been begun, in the matrix file's order."""
        methods = {method.label: method for method in self.by_name().values()}
        for label in self.selected:
            if label not in methods:
                raise BadData(f"no method is called {label!r}{nearest(label, methods)}")
        return [methods[label] for label in dict.fromkeys(self.selected or methods)]

    def select(self, *labels: str) -> Results:
        """Return the results of the methods with these labels; of all methods without labels."""
        return replace(self, selected=labels)

    @_remembered
    def by_name(self) -> dict[str, Method]:
        """Return all methods that have been begun, by the name of their folders."""
        protocol, methods = self.protocol(), {}
        clips, digests = protocol["clips"], protocol.get("digests", {})
        listed = protocol["methods"]
        for name in [*listed, *self._copied_methods(listed)]:
            path = self.root / name / "method.json"
            if path.exists():
                method: Method = records.read(path, Method, name=name)
                if name not in listed and method.asked.get("protocol") != protocol["fingerprint"]:
                    continue  # of another protocol
                stored = self.scored(name, method.fingerprint, digests)
                scored = NewestRecords({clip: stored[clip] for clip in clips if clip in stored})
                is_partial = method.status == "done" and len(scored) < len(clips)
                status = "partial" if is_partial else method.status
                methods[name] = method.model_copy(update={"scored": scored, "status": status})
        return methods

    def _copied_methods(self, listed: Sequence[str]) -> list[str]:
        """Return the folders of methods that the protocol does not list, such as copied ones."""
        names = (path.parent.name for path in self.root.glob("*/method.json"))
        return sorted(set(names).difference(listed))

    def scored(self, method: str, fingerprint: str, digests: Mapping[str, str]) -> NewestRecords:
        """Return how all clips of this content were scored, without damaged files."""
        records = self._records().get(method, ())
        of_method = (each for each in records if each.fingerprint == fingerprint)
        return NewestRecords.of(of_method, digests)

    @_remembered
    def _records(self) -> dict[str, list[ScoreRecord]]:
        return self._score_files.records

    @property
    def digests(self) -> dict[str, str]:
        """Return the hash of the content of each clip; empty in results of earlier versions."""
        return self.protocol().get("digests", {}) if self.begun else {}

    def scores(self, method: str, *steps: int) -> Scores:
        """Return all scores of the protocol's clips, or their means from one step to another.

        Raise BadData if a score file is damaged.
        """
        self._require_whole(method)
        return self.select()._all_scores(*steps).get(method, Scores(self.protocol()["clips"], {}))

    def means(
        self, method: str, first_step: int = 1, last_step: int | None = None
    ) -> dict[str, FloatArray]:
        """Return means over all or some steps [N, S] of the protocol's clips by metric."""
        scores = self.scores(method, first_step, last_step or 10**6)
        return {metric: values[..., 0] for metric, values in scores.values.items()}

    def export(self, path: Path, kind: str) -> None:
        """Write the scores of all selected methods, by their labels, as a csv or parquet file."""
        # the scores of other methods are those of a copy
        methods = [method for method in self.methods() if method.status in ("done", "partial")]
        for method in methods:
            self._require_whole(method.name)
        labels = {method.name: method.label for method in methods}
        records = {method.name: method.scored for method in methods}
        if not any(records.values()):
            raise BadData(f"{self.root} has no scores of these methods: run it first")
        self._score_files.export(records, self.protocol()["clips"], labels, path, kind)

    def _require_whole(self, method: str) -> None:
        """Raise BadData for a damaged score file of a method."""
        for path in self._score_files.damaged:
            if path.parent in (self.root / "scores", self.root / method / "scores"):
                raise BadData(f"{path} is damaged: `geovp run` sets it aside and computes it again")

    @_remembered
    def _all_scores(self, *steps: int) -> dict[str, Scores]:
        """Return the scores of all methods, or their means from one step to another."""
        records = {name: method.scored for name, method in self.by_name().items()}
        return self._score_files.scores(records, self.protocol()["clips"], steps)

    @_remembered
    def clip_facts(self) -> Facts:
        """Return numbers and texts about the clips themselves, by clip and name."""
        methods = self.by_name().values()
        records = (record for method in methods for record in method.scored.values())
        facts = self._score_files.facts(records)
        return {clip: facts[clip] for clip in self.protocol()["clips"] if clip in facts}

    def predictions(self, method: Method) -> KeptFiles[Prediction]:
        """Return the kept predictions of a method."""
        folder = self.root / method.name / "predictions"
        return KeptFiles(folder, method.fingerprint, Prediction, self.digests)

    def clips(self, fingerprint: str = "") -> KeptFiles[Clip]:
        """Return the kept clips, past and future, of the protocol or of another fingerprint."""
        fingerprint = fingerprint or self.protocol()["fingerprint"]
        return KeptFiles(self.root / "clips", fingerprint, Clip, self.digests)

    @_remembered
    def damaged_files(self) -> list[Path]:
        """Return the score files and kept files that are not as they were written."""
        paths = [*self.root.glob("clips/[!.]*.npz"), *self.root.glob("*/predictions/[!.]*.npz")]
        damaged = [path for path in paths if not kept_files.is_whole(path)]
        return sorted([*damaged, *self._score_files.damaged])

    @property
    def _score_files(self) -> ScoreFiles:
        files: ScoreFiles = self.memory.setdefault(self.root, ScoreFiles(self.root))
        return files

    @property
    def tables(self) -> Path:
        """Return the folder of written tables."""
        return self.root / "tables"

    @property
    def plots(self) -> Path:
        """Return the folder of figures."""
        return self.root / "plots"

    @property
    def report(self) -> Path:
        """Return the file of the one-page report."""
        return self.root / "report.html"

    # Writing

    def write_protocol(self, protocol: Mapping[str, Any]) -> None:
        """Write protocol.json."""
        self._write("protocol.json", protocol)

    def write_method(self, method: Method) -> None:
        """Write the method.json of a method."""
        self._write(f"{method.name}/method.json", method.model_dump(exclude={"name"}))

    def _write(self, file: str, content: Mapping[str, Any]) -> None:
        """Write a JSON file, and forget what was read."""
        write_bytes(self.root / file, files.json_bytes(content))
        self.memory.clear()

    def write_scores(self, scored: Sequence[tuple[Scores, ScoreRecord]]) -> None:
        """Write scores of some clips, in one file per method."""
        for method in {record.method for _, record in scored}:
            of_method = [each for each in scored if each[1].method == method]
            self._score_files.write(method, of_method)
        self.memory.clear()

    def merge(self, methods: Iterable[Method]) -> None:
        """Merge the score files of each method into one; those of other settings stay."""
        for method in methods:
            self._score_files.merge(method.name, method.fingerprint, self.digests)
        self.memory.clear()

    def compact(self) -> None:
        """Join the scores of all methods in one file."""
        records = {name: method.scored for name, method in self.by_name().items() if method.scored}
        if records:
            self._score_files.compact(records, self.protocol()["clips"])
        self.memory.clear()

    def discard(self, method: Method) -> None:
        """Remove scores and predictions of a method; those of other settings stay."""
        predictions = self.predictions(method)
        paths = {record.path for record in method.scored.values()}
        for path in paths.union(map(predictions.path, predictions.names)):
            if path.parent != self.root / "scores":  # of several methods
                path.unlink(missing_ok=True)
        self.memory.clear()
