"""Score files: parquet with the scores of some clips of a method; a content hash in the file name.

The metadata of a file says how its clips were scored; rows of step 0 hold facts of the clips.
"""

from __future__ import annotations

import dataclasses
import errno
import hashlib
import itertools
import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import duckdb
import numpy as np

from geovp_benchmarks.results.rows import Categorical, Rows
from geovp_classic.types import IntArray

HASH_DIGITS = 16  # in a file name


@dataclass(frozen=True)
class Part:
    """Clips of a method that were scored alike."""

    clips: tuple[str, ...]
    fingerprint: str  # of the method and the protocol
    metrics: Mapping[str, Any]  # the resolved metric behind each column
    seconds: Mapping[str, float]  # per stage, summed over the clips
    # the highest resident memory of the process while it predicted these clips; 0 where unknown
    peak_memory_mb: float
    peak_is_own: bool = False  # False: the peak of the whole process so far
    code: str = ""  # a hash of the sources that computed it; "" for rescored predictions
    # clip -> status, reason, traceback
    failures: Mapping[str, Sequence[str]] = field(default_factory=dict)
    facts: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # written, not read
    written_ns: int = 0  # set when it is written; the newest scores of a clip count
    method: str = ""  # the name of its folder

    def only(self, clips: Sequence[str]) -> Part:
        """Return the part of these clips, with their fraction of the times."""
        ratio = len(clips) / len(self.clips)
        return dataclasses.replace(
            self,
            clips=tuple(clips),
            seconds={stage: seconds * ratio for stage, seconds in self.seconds.items()},
            failures={clip: self.failures[clip] for clip in clips if clip in self.failures},
        )


@dataclass(frozen=True)
class Stored:
    """The parts of each score file that count, and their clips in order."""

    parts: Mapping[Path, Sequence[Part]]
    clips: Sequence[str]


class ScoreFiles:
    """The score files of a results folder, opened once and read through one database connection."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._read: dict[Path, tuple[tuple[int, int], list[Part] | None]] = {}

    @cached_property
    def _database(self) -> duckdb.DuckDBPyConnection:
        return duckdb.connect()

    def parts(self, method: str) -> dict[Path, list[Part] | None]:
        """Return the parts of a method by file; None for a damaged file."""
        single = sorted((self.root / method / "scores").glob("part-*.parquet"))
        shared = sorted((self.root / "scores").glob("part-*.parquet"))
        self._open([*single, *shared])
        stored = {path: self._read[path][1] for path in single}
        for path in shared:
            parts = self._read[path][1]
            stored[path] = None if parts is None else [p for p in parts if p.method == method]
        return stored

    def rows(self, stored: Stored) -> Rows:
        """Return the scores of these parts, in the order of their clips."""
        if not stored.clips:
            return Rows.of()
        source = self._source(stored)
        query = f"SELECT metric FROM {source} WHERE step > 0 GROUP BY metric"
        found = self._database.execute(f"{query} ORDER BY min(file_row_number)").fetchall()
        metrics = [metric for (metric,) in found]
        self._enumerate("metrics", metrics)
        columns = self._database.execute(
            "SELECT enum_code(clip::clips) AS clip, sample, step, "
            f"enum_code(metric::metrics) AS metric, value FROM {source} WHERE step > 0"
        ).fetchnumpy()
        clip = columns["clip"].astype(np.int32)
        value = np.ma.filled(columns["value"], np.nan)
        rows = Rows(
            Categorical.coded(stored.clips, clip),
            columns["sample"],
            columns["step"],
            Categorical.coded(metrics, columns["metric"].astype(np.int32)),
            value,
        )
        if (clip[1:] >= clip[:-1]).all():
            return rows
        order: IntArray = np.argsort(clip, kind="stable")
        return rows.where(order)

    def facts(self, methods: Sequence[str]) -> dict[str, dict[str, float]]:
        """Return the facts of the clips by name."""
        paths = {path for name in methods for path, parts in self.parts(name).items() if parts}
        facts: dict[str, dict[str, float]] = {}
        if paths:
            query = f"SELECT clip, metric, value FROM {_files(sorted(paths))} WHERE step = 0"
            for clip, name, value in self._database.execute(query).fetchall():
                facts.setdefault(clip, {})[name] = value
        return facts

    def write(self, method: str, rows: Rows, part: Part) -> None:
        """Write a score file of a method; OSError without room."""
        facts = [
            (clip, 0, 0, name, value)
            for clip, values in part.facts.items()
            for name, value in values.items()
        ]
        if facts:
            rows = Rows.concatenated([rows, Rows.of(*zip(*facts, strict=True))])
        columns = {"clip": rows.clip.values(), "sample": rows.sample, "step": rows.step}
        columns |= {"metric": rows.metric.values(), "value": rows.value}
        query = (
            f"SELECT '{_quoted(method)}' AS method, clip::VARCHAR AS clip, sample, step, "
            "metric::VARCHAR AS metric, if(isnan(value), NULL, value) AS value FROM scores"
        )
        self._database.register("scores", columns)
        part = dataclasses.replace(part, method=method, written_ns=time.time_ns())
        self._copy(query, self.root / method / "scores", [part])
        self._database.unregister("scores")

    def merge(self, method: str, stored: Stored, replaced: Sequence[Path]) -> None:
        """Write the rows of these parts of a method into one file in place of others."""
        source = self._source(stored)
        query = (
            f"SELECT method, clip, sample, step, metric, value FROM {source} "
            "ORDER BY clip::clips, file_row_number"
        )
        merged = self._copy(query, self.root / method / "scores", _grouped(stored))
        for path in replaced:
            if path != merged:
                path.unlink(missing_ok=True)

    def _open(self, paths: Sequence[Path]) -> None:
        """Read what is new or has changed: check the hash in the name, then read the metadata."""
        sound = []
        for path in paths:
            status = path.stat()
            stamp = (status.st_mtime_ns, status.st_size)
            if path in self._read and self._read[path][0] == stamp:
                continue
            self._read[path] = (stamp, None)
            if path.stem == f"part-{_digest(path)}":
                sound.append(path)
        if sound:
            names = ", ".join(f"'{_quoted(path)}'" for path in sound)
            query = f"SELECT file_name, value FROM parquet_kv_metadata([{names}])"
            for name, value in self._database.execute(f"{query} WHERE key = 'geovp'").fetchall():
                records = json.loads(value)
                parts = [Part(**{**record, "clips": tuple(record["clips"])}) for record in records]
                self._read[Path(name)] = (self._read[Path(name)][0], parts)

    def _source(self, stored: Stored) -> str:
        """Return the relation of the rows of these parts; `clips` becomes the type of its clips."""
        self._enumerate("clips", stored.clips)
        files = _files([*stored.parts])
        num_stored = sum(
            len(part.clips) for path in stored.parts for part in self._read[path][1] or ()
        )
        if num_stored == len(stored.clips):  # all that is in the files
            return files
        entries = [
            (str(path), part.method, clip)
            for path, parts in stored.parts.items()
            for part in parts
            for clip in part.clips
        ]
        paths, methods, clips = (np.array(column, object) for column in zip(*entries, strict=True))
        self._database.register("wanted", {"filename": paths, "method": methods, "clip": clips})
        return f"{files} SEMI JOIN wanted USING (filename, method, clip)"

    def _enumerate(self, kind: str, names: Sequence[str]) -> None:
        numbered = {"name": np.array(names, object), "number": np.arange(len(names))}
        self._database.register("numbered", numbered)
        self._database.execute(f"DROP TYPE IF EXISTS {kind}")
        ordered = "SELECT name::VARCHAR FROM numbered ORDER BY number"
        self._database.execute(f"CREATE TYPE {kind} AS ENUM ({ordered})")

    def _copy(self, query: str, folder: Path, parts: Sequence[Part]) -> Path:
        records = [dataclasses.asdict(dataclasses.replace(part, facts={})) for part in parts]
        about = _quoted(json.dumps(records))
        folder.mkdir(parents=True, exist_ok=True)
        name = hashlib.sha256(about.encode()).hexdigest()[:HASH_DIGITS]
        scratch = folder / f".{name}.{os.getpid()}.part"
        try:
            self._database.execute(
                f"COPY ({query}) TO '{_quoted(scratch)}' "
                f"(FORMAT parquet, USE_TMP_FILE false, KV_METADATA {{geovp: '{about}'}})"
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


def newest(stored: Mapping[Path, Sequence[Part]], order: Sequence[str] | None) -> Stored:
    """Return the newest parts of each clip; `order` names the clips, None means all."""
    latest: dict[str, Part] = {}
    for part in sorted(itertools.chain(*stored.values()), key=lambda part: part.written_ns):
        for clip in part.clips:
            latest[clip] = part
    clips = [*latest] if order is None else [clip for clip in order if clip in latest]
    by_part: dict[int, list[str]] = {}
    for clip in clips:
        by_part.setdefault(id(latest[clip]), []).append(clip)
    kept = {
        path: [part.only(by_part[id(part)]) for part in parts if id(part) in by_part]
        for path, parts in stored.items()
    }
    return Stored({path: parts for path, parts in kept.items() if parts}, clips)


def _grouped(stored: Stored) -> list[Part]:
    """Return one part for all that were scored alike."""
    groups: dict[str, list[Part]] = {}
    for part in itertools.chain(*stored.parts.values()):
        alike = [part.method, part.fingerprint, part.metrics, part.code, part.peak_is_own]
        groups.setdefault(json.dumps(alike, sort_keys=True), []).append(part)
    return [
        dataclasses.replace(
            parts[0],
            clips=tuple(clip for part in parts for clip in part.clips),
            seconds={
                stage: sum(part.seconds.get(stage, 0.0) for part in parts)
                for stage in dict.fromkeys(stage for part in parts for stage in part.seconds)
            },
            peak_memory_mb=max(part.peak_memory_mb for part in parts),
            failures={clip: why for part in parts for clip, why in part.failures.items()},
            written_ns=max(part.written_ns for part in parts),
        )
        for parts in groups.values()
    ]


def _files(paths: Sequence[Path]) -> str:
    names = ", ".join(f"'{_quoted(path)}'" for path in paths)
    return f"read_parquet([{names}], filename = true, file_row_number = true)"


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:HASH_DIGITS]


def _quoted(text: object) -> str:
    """Return a text for use between single quotes."""
    return str(text).replace("'", "''")
