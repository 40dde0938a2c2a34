"""Results on disk: the only module that knows where which file is.

    <root>/protocol.json                      data set, clip names, sizes, metrics, versions
    <root>/clips/<clip>.<id>.npz              kept clips, by the id of the protocol's fingerprint
    <root>/<method>/method.json               components, privileged inputs, status; see Method
    <root>/<method>/scores/part-<hash>.parquet  a row per clip, sample, step and metric
    <root>/<method>/predictions/<clip>.<id>.npz  kept predictions, by the method's fingerprint
    <root>/tables  plots  report.html

Files are written next to their destination and renamed. Scores are stored by clip name, in one
file per batch until a run ends; the name of a score file holds a hash of its content. Files of
earlier settings stay, and count again with these settings.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote, unquote

import duckdb

from geovp_benchmarks.results import kept_files, records
from geovp_benchmarks.results.records import Method
from geovp_benchmarks.results.score_files import ScoreFiles, ScoreRecord, newest, seconds
from geovp_benchmarks.results.scores import Scores
from geovp_classic import files
from geovp_classic.data.atomic import write_bytes
from geovp_classic.errors import BadData, nearest
from geovp_classic.types import Clip, Prediction

__all__ = ["Method", "Results", "ScoreRecord", "Scores"]

Item = TypeVar("Item")


def _remembered(read: Callable[..., Item]) -> Callable[..., Item]:
    """Return a method of Results that reads once, until something is written.

    It reads again where a run has merged files meanwhile.
    """

    @functools.wraps(read)
    def reader(results: Results, *args: Any) -> Item:
        key = (results, read.__name__, *args)
        num_tries = 0
        while key not in results.memory:
            try:
                results.memory[key] = read(results, *args)
            except (FileNotFoundError, duckdb.IOException):
                num_tries += 1
                if num_tries == 5:
                    raise
                results.memory.clear()
        value: Item = results.memory[key]
        return value

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
        protocol: dict[str, Any] = records.read(self.root / "protocol.json", records.Protocol)
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
        begun = map(self.method, self.protocol()["methods"])
        methods = {method.label: method for method in begun if method is not None}
        for label in self.selected:
            if label not in methods:
                raise BadData(f"no method is called {label!r}{nearest(label, methods)}")
        return [methods[label] for label in self.selected or methods]

    def select(self, *labels: str) -> Results:
        """Return the results of the methods with these labels; of all methods without labels."""
        return replace(self, selected=labels)

    @_remembered
    def _method(self, name: str) -> Method | None:
        path = self.root / name / "method.json"
        return records.read(path, Method, name=name) if path.exists() else None

    @_remembered
    def method(self, name: str) -> Method | None:
        """Return a method with the sums over its scores; None if it has not been begun."""
        method = self._method(name)
        if method is None:
            return None
        scored = self.score_records(name)
        num_clips = sum(len(record.clips) for record in scored)
        sums: dict[str, Any] = {
            "num_clips": num_clips,
            "num_failed": sum(len(record.failures) for record in scored),
            "num_outdated": sum(len(each.clips) for each in scored if each.code != method.code),
            "seconds": {stage: round(time_s, 3) for stage, time_s in seconds(scored).items()},
            "peak_memory_mb": max((record.peak_memory_mb for record in scored), default=0.0),
        }
        if method.status == "done" and num_clips < len(self.protocol()["clips"]):
            sums["status"] = "partial"
        return method.model_copy(update=sums)

    def scores(self, method: str) -> Scores:
        """Return all scores of the protocol's clips; raise BadData if a score file is damaged."""
        scores = self.select()._all_scores()
        for path in self._score_files.damaged:
            if path.parent in (self.root / "scores", self.root / method / "scores"):
                raise BadData(f"{path} is damaged: `geovp run` sets it aside and computes it again")
        return scores.get(method, Scores(self.protocol()["clips"], {}))

    @_remembered
    def _all_scores(self) -> dict[str, Scores]:
        """Return the scores of all methods; one query reads methods that share their files."""
        groups: dict[frozenset[Path], list[ScoreRecord]] = {}
        for name in self.protocol()["methods"]:
            records = self.score_records(name)
            paths = frozenset(record.path for record in records)
            groups.setdefault(paths, []).extend(records)
        scores: dict[str, Scores] = {}
        for records in groups.values():
            scores |= self._score_files.scores(records, self.protocol()["clips"])
        return scores

    def failures(self, method: str) -> dict[str, str]:
        """Return why clips could not be predicted; they are scored as copies of the last frame."""
        return {
            clip: failure.reason
            for record in self.score_records(method)
            for clip, failure in record.failures.items()
        }

    @_remembered
    def clip_facts(self) -> dict[str, dict[str, float]]:
        """Return numbers that are known of the clips themselves, by clip and name."""
        protocol = self.protocol()
        scored = [each for name in protocol["methods"] for each in self.score_records(name)]
        facts = self._score_files.facts(scored)
        return {clip: facts[clip] for clip in protocol["clips"] if clip in facts}

    def predictions(self, method: str, fingerprint: str = "") -> list[str]:
        """Return the names of the clips whose predictions by a method are kept."""
        return _names(self._prediction(method, "*", fingerprint))

    def prediction(self, method: str, clip: str) -> Prediction:
        """Return a kept prediction."""
        return kept_files.read(self._prediction(method, clip), Prediction)

    def clips(self, fingerprint: str = "") -> list[str]:
        """Return the names of the kept clips."""
        return _names(self._clip("*", fingerprint))

    def clip(self, name: str) -> Clip:
        """Return a kept clip, past and future, without full and right frames."""
        return kept_files.read(self._clip(name), Clip)

    @_remembered
    def score_records(self, method: str, fingerprint: str = "") -> list[ScoreRecord]:
        """Return how the protocol's clips were scored, without damaged files.

        Those of the method as it is now, or of another fingerprint.
        """
        fingerprint = fingerprint or self._fingerprint(method)
        records = self._score_files.records.get(method, ())
        fitting = [record for record in records if record.fingerprint == fingerprint]
        return newest(fitting, self.protocol()["clips"] if self.begun else ())

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

    def _fingerprint(self, method: str) -> str:
        """Return the fingerprint of a method as it is now."""
        stored = self._method(method)
        return stored.fingerprint if stored else ""

    def _prediction(self, method: str, clip: str, fingerprint: str = "") -> Path:
        """Return the file of a prediction of the method as it is now or of a fingerprint."""
        file = f"{quoted(clip)}.{(fingerprint or self._fingerprint(method))[:8]}.npz"
        return self.root / method / "predictions" / file

    def _clip(self, name: str, fingerprint: str = "") -> Path:
        """Return the file of a clip of the protocol as it is now or of a fingerprint."""
        if not fingerprint and self.begun:
            fingerprint = str(self.protocol().get("fingerprint", ""))
        return self.root / "clips" / f"{quoted(name)}.{fingerprint[:8]}.npz"

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
        """Write the method.json of a method, without the sums over its scores."""
        sums = {"num_clips", "num_failed", "num_outdated", "seconds", "peak_memory_mb"}
        self._write(f"{method.name}/method.json", method.model_dump(exclude={"name", *sums}))

    def _write(self, file: str, content: Mapping[str, Any]) -> None:
        """Write a JSON file, and forget what was read."""
        write_bytes(self.root / file, files.json_bytes(content))
        self.memory.clear()

    def write_scores(self, scored: Iterable[tuple[Scores, ScoreRecord]]) -> None:
        """Write scores of some clips, in one file per method."""
        by_method: dict[str, list[tuple[Scores, ScoreRecord]]] = {}
        for scores, record in scored:
            by_method.setdefault(record.method, []).append((scores, record))
        for method, of_method in by_method.items():
            self._score_files.write(method, of_method)
        self.memory.clear()

    def merge(self, *methods: str) -> None:
        """Merge the score files of each method into one; those of other settings stay."""
        for method in methods:
            self._score_files.merge(method, self._fingerprint(method))
        self.memory.clear()

    def write_prediction(self, method: str, clip: str, prediction: Prediction) -> None:
        """Keep a prediction."""
        kept_files.write(self._prediction(method, clip), prediction)

    def write_clip(self, clip: Clip) -> None:
        """Keep a clip, so that images and new scores need no data set."""
        kept_files.write(self._clip(clip.name), clip)

    def discard(self, method: str) -> None:
        """Remove scores and predictions of a method as it is now; those of other settings stay."""
        folder = self._prediction(method, "*")
        paths = {record.path for record in self.score_records(method)}
        for path in paths.union(folder.parent.glob(folder.name)):
            if path.parent != self.root / "scores":  # of several methods
                path.unlink(missing_ok=True)
        self.memory.clear()


def quoted(clip: str) -> str:
    """Return the part of a file name from which the name of a clip can be recovered; * stays."""
    return quote(clip, safe="+@=, *")


def _names(pattern: Path) -> list[str]:
    """Return the names of the clips whose files match a pattern such as "*.npz"."""
    end = pattern.name.removeprefix("*")
    files = sorted(path.name for path in pattern.parent.glob(pattern.name))
    return [unquote(name.removesuffix(end)) for name in files if not name.startswith(".")]
