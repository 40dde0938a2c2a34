"""Score files: parquet with the scores of some clips of a method; a content hash in the file name.

A file has a row per clip, sample, step and metric. Its metadata says how the clips were scored.
"""

from __future__ import annotations

import dataclasses
import errno
import hashlib
import itertools
import json
import os
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
from pydantic import TypeAdapter
from pydantic.dataclasses import dataclass

from geovp_benchmarks.results.scores import Scores
from geovp_classic.errors import BadData
from geovp_classic.types import FloatArray


@dataclass(frozen=True)
class Part:
    """Clips of a method that were scored alike."""

    clips: list[str]
    fingerprint: str  # of the method and the protocol
    metrics: dict[str, Any]  # the resolved metric behind each column
    seconds: dict[str, float]  # per stage, summed over the clips
    # the highest resident memory of the process while it predicted these clips; 0 where unknown
    peak_memory_mb: float
    peak_is_own: bool = False  # False: the peak of the whole process so far
    code: str = ""  # a hash of the sources that computed it; "" for rescored predictions
    failures: dict[str, list[str]] = field(default_factory=dict)  # status, reason, traceback
    facts: dict[str, dict[str, float]] = field(default_factory=dict)  # numbers of each clip
    written_ns: int = 0  # set when it is written; the newest scores of a clip count
    method: str = ""  # the name of its folder

    def only(self, clips: Sequence[str]) -> Part:
        """Return the part of these clips, with their fraction of the times."""
        ratio = len(clips) / len(self.clips)
        return dataclasses.replace(
            self,
            clips=list(clips),
            seconds={stage: seconds * ratio for stage, seconds in self.seconds.items()},
            failures={clip: self.failures[clip] for clip in clips if clip in self.failures},
            facts={clip: self.facts[clip] for clip in clips if clip in self.facts},
        )


Stored = Mapping[Path, Sequence[Part]]  # the parts of each score file


class ScoreFiles:
    """The score files of a results folder, opened once and read through one database connection."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._opened: dict[Path, tuple[tuple[int, int], list[Part] | None]] = {}

    @cached_property
    def _database(self) -> duckdb.DuckDBPyConnection:
        return duckdb.connect()

    def parts(self, method: str) -> dict[Path, list[Part] | None]:
        """Return the parts of a method by file; None for a damaged file."""
        folders = (self.root / method / "scores", self.root / "scores")
        paths = [path for folder in folders for path in sorted(folder.glob("part-*.parquet"))]
        self._open(paths)
        parts = {path: self._opened[path][1] for path in paths}
        return {
            path: None if stored is None else [part for part in stored if part.method == method]
            for path, stored in parts.items()
        }

    def means(
        self, stored: Stored, clips: Sequence[str], num_steps: int | None = None
    ) -> dict[str, FloatArray]:
        """Return the means over all or the first steps [N, S] by metric; NaN: not defined."""
        if not stored:
            return {}
        steps = "" if num_steps is None else f"WHERE step <= {num_steps}"
        columns = self._query(
            f"SELECT metric, number, sample, avg(value) AS value FROM {{}} {steps} GROUP BY ALL",
            stored,
            clips,
        )
        values = np.ma.filled(columns["value"], np.nan)
        names, codes = np.unique(columns["metric"].astype(str), return_inverse=True)
        num_samples = int(columns["sample"].max(initial=-1)) + 1
        means = np.full((len(names), len(clips), num_samples), np.nan)
        means[codes, columns["number"], columns["sample"]] = values
        return dict(zip(names.tolist(), means, strict=True))

    def scores(self, stored: Stored, clips: Sequence[str]) -> Scores:
        """Return all scores of these clips; raise BadData for a score that is stored twice."""
        if not stored:
            return Scores(clips, {})
        names = self._query("SELECT DISTINCT metric FROM {}", stored, clips)
        metrics = sorted(names["metric"].tolist())
        columns = self._query(
            "SELECT list_position($metrics, metric) - 1 AS metric, number, sample, step - 1 AS "
            "step, value FROM {}",
            stored,
            clips,
            metrics=metrics,
        )
        places = [columns[name] for name in ("metric", "number", "sample", "step")]
        extents = [int(place.max(initial=-1)) + 1 for place in places[2:]]
        shape = (len(metrics), len(clips), *extents)
        if min((place.min(initial=0) for place in places), default=0) < 0:
            raise BadData(f"{self.root} has scores of a negative sample: run again")
        indices = np.ravel_multi_index(places, shape) if len(places[0]) else places[0]
        if len(indices) and np.bincount(indices).max() > 1:
            raise BadData(f"{next(iter(stored)).parent} has two scores of one frame: run again")
        values = np.full(shape, np.nan)
        values.ravel()[indices] = np.ma.filled(columns["value"], np.nan)
        return Scores(clips, dict(zip(metrics, values, strict=True)))

    def write(self, method: str, scored: Sequence[tuple[Scores, Part]]) -> None:
        """Write a score file of a method; OSError without room."""
        rows = [row for scores, _ in scored for row in scores.rows()]
        names = ("clip", "sample", "step", "metric", "value")
        kinds = (object, np.int32, np.int32, object, np.float64)
        columns = {
            name: np.array([row[place] for row in rows], kind)
            for place, (name, kind) in enumerate(zip(names, kinds, strict=True))
        }
        self._database.register("scores", columns)
        query = (
            f"SELECT '{_quoted(method)}' AS method, clip::VARCHAR AS clip, sample, step, "
            "metric::VARCHAR AS metric, if(isnan(value), NULL, value) AS value FROM scores"
        )
        now = time.time_ns()
        parts = [dataclasses.replace(part, method=method, written_ns=now) for _, part in scored]
        self._copy(query, self.root / method / "scores", parts)
        self._database.unregister("scores")

    def merge(self, method: str, fingerprint: str) -> None:
        """Merge the score files of one fingerprint in the folder of a method."""
        folder = self.root / method / "scores"  # a file that methods share stays
        stored = {
            path: parts
            for path, parts in self.parts(method).items()
            if parts and path.parent == folder and {p.fingerprint for p in parts} == {fingerprint}
        }
        if len(stored) < 2:
            return
        latest = newest(stored, None)
        parts = list(itertools.chain(*latest.values()))
        clips = [clip for part in parts for clip in part.clips]
        query = (
            f"SELECT method, clip, sample, step, metric, value FROM {self._wanted(latest, clips)} "
            "ORDER BY number, metric, sample, step"
        )
        merged = self._copy(query, folder, parts)
        for path in stored.keys() - {merged}:  # not one that another run has written since
            path.unlink(missing_ok=True)

    def _open(self, paths: Iterable[Path]) -> None:
        """Read what is new or has changed: check the hash in the name, then read the metadata."""
        sound = []
        for path in paths:
            status = path.stat()
            stamp = (status.st_mtime_ns, status.st_size)
            if path in self._opened and self._opened[path][0] == stamp:
                continue
            self._opened[path] = (stamp, None)
            if path.stem == f"part-{_digest(path)}":
                sound.append(path)
        if sound:
            adapter = TypeAdapter(list[Part])
            query = f"SELECT file_name, value FROM parquet_kv_metadata({_listed(sound)})"
            for name, value in self._database.execute(f"{query} WHERE key = 'geovp'").fetchall():
                parts = adapter.validate_json(value)
                self._opened[Path(name)] = (self._opened[Path(name)][0], parts)

    def _query(
        self, query: str, stored: Stored, clips: Sequence[str], **parameters: Any
    ) -> dict[str, Any]:
        """Return the columns of a query on the rows of some clips with their `number`."""
        source = self._wanted(stored, clips)
        rows = self._database.execute(query.format(source), parameters or None)
        columns: dict[str, Any] = rows.fetchnumpy()
        return columns

    def _wanted(self, stored: Stored, clips: Sequence[str]) -> str:
        """Return the relation of the rows of some clips with the `number` of each clip."""
        numbers = {clip: number for number, clip in enumerate(clips)}
        columns: dict[str, list[Any]] = {"filename": [], "method": [], "clip": [], "number": []}
        for path, parts in stored.items():
            for part in parts:
                columns["filename"] += [str(path)] * len(part.clips)
                columns["method"] += [part.method] * len(part.clips)
                columns["clip"] += part.clips
                columns["number"] += [numbers[clip] for clip in part.clips]
        arrays = {name: np.array(column, object) for name, column in columns.items()}
        self._database.register("entries", arrays)
        self._database.execute(
            "CREATE OR REPLACE TABLE wanted AS SELECT filename::VARCHAR AS filename, "
            "method::VARCHAR AS method, clip::VARCHAR AS clip, number::INTEGER AS number "
            "FROM entries"
        )
        return f"{_relation(stored)} JOIN wanted USING (filename, method, clip)"

    def _copy(self, query: str, folder: Path, parts: Iterable[Part]) -> Path:
        """Write the rows of a query into a new score file with its parts as metadata."""
        groups: dict[str, list[Part]] = {}
        for part in parts:
            alike = [part.method, part.fingerprint, part.metrics, part.code, part.peak_is_own]
            groups.setdefault(json.dumps(alike, sort_keys=True), []).append(part)
        records = [dataclasses.asdict(joined(group)) for group in groups.values()]
        about = json.dumps(records)
        folder.mkdir(parents=True, exist_ok=True)
        scratch = folder / f".{hashlib.sha256(about.encode()).hexdigest()[:16]}.{os.getpid()}.part"
        try:
            self._database.execute(
                f"COPY ({query}) TO '{_quoted(scratch)}' "
                f"(FORMAT parquet, USE_TMP_FILE false, KV_METADATA {{geovp: '{_quoted(about)}'}})"
            )
            path = folder / f"part-{_digest(scratch)}.parquet"
            scratch.rename(path)
        except duckdb.IOException as problem:
            full = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
            code = next((each for each in full if os.strerror(each) in str(problem)), errno.EIO)
            raise OSError(code, str(problem), str(folder)) from problem
        finally:
            scratch.unlink(missing_ok=True)
        return path


def newest(stored: Stored, clips: Sequence[str] | None) -> dict[Path, list[Part]]:
    """Return the newest parts of each clip by file, restricted to some clips."""
    latest: dict[str, Part] = {}
    for part in sorted(itertools.chain(*stored.values()), key=lambda part: part.written_ns):
        latest |= dict.fromkeys(part.clips, part)
    wanted = latest.keys() if clips is None else set(clips)
    selected: dict[Path, list[Part]] = {}
    for path, parts in stored.items():
        for part in parts:
            names = [clip for clip in part.clips if latest[clip] is part and clip in wanted]
            if names:
                whole = len(names) == len(part.clips)
                selected.setdefault(path, []).append(part if whole else part.only(names))
    return selected


def joined(parts: Sequence[Part]) -> Part:
    """Return one part for clips that were scored alike."""
    seconds: Counter[str] = Counter()
    for part in parts:
        seconds.update(part.seconds)
    return dataclasses.replace(
        parts[0],
        clips=sorted(clip for part in parts for clip in part.clips),
        seconds=dict(seconds),
        peak_memory_mb=max(part.peak_memory_mb for part in parts),
        peak_is_own=all(part.peak_is_own for part in parts),
        failures={clip: failure for part in parts for clip, failure in part.failures.items()},
        facts={clip: facts for part in parts for clip, facts in part.facts.items()},
        written_ns=max(part.written_ns for part in parts),
    )


def _relation(paths: Iterable[Path]) -> str:
    """Return the SQL relation of all rows of some files."""
    return f"read_parquet({_listed(paths)}, filename = true)"


def _listed(paths: Iterable[Path]) -> str:
    """Return paths as a list in SQL."""
    names = ", ".join(f"'{_quoted(path)}'" for path in paths)
    return f"[{names}]"


def _digest(path: Path) -> str:
    """Return the first digits of the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def _quoted(text: object) -> str:
    """Return a text for use between single quotes."""
    return str(text).replace("'", "''")
