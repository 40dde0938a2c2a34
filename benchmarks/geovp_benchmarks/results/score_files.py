"""Score files: parquet with the scores of some clips of a method; a content hash in the file name.

A file has a row per clip, sample, step and metric. Its metadata says how the clips were scored.
"""

from __future__ import annotations

import errno
import hashlib
import json
import time
import traceback
import uuid
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import duckdb
import numpy as np
from pydantic import Field, TypeAdapter

from geovp_benchmarks.results.scores import Scores
from geovp_classic.errors import BadData, Incompatible, MissingExtra
from geovp_classic.types import FloatArray


class Failure(NamedTuple):
    """The reason why a method, component or metric is skipped or failed."""

    status: str  # "skipped" or "failed"
    reason: str
    traceback: str = ""

    @classmethod
    def of(cls, error: Exception) -> Self:
        """Return "skipped" for incompatible or missing components, "failed" for other errors."""
        if isinstance(error, (Incompatible, MissingExtra)):
            return cls("skipped", str(error))
        trace = "".join(traceback.format_exception(error))
        reason = str(error) if isinstance(error, BadData) else f"{type(error).__name__}: {error}"
        return cls("failed", reason.strip().partition("\n")[0], trace)


@dataclass(frozen=True)
class ScoreRecord:
    """How some clips of a method were scored; a score file holds one or more of them."""

    method: str  # the name of its folder
    clips: list[str]
    fingerprint: str  # of the method and the protocol
    metrics: dict[str, Any] = field(default_factory=dict)  # resolved, by column
    seconds: dict[str, float] = field(default_factory=dict)  # per stage, summed over the clips
    peak_memory_mb: float = 0.0  # the highest during their prediction; 0 where unknown
    code: str = ""  # a hash of the sources that computed it; "" for rescored predictions
    failures: dict[str, Failure] = field(default_factory=dict)
    written_ns: int = 0  # the newest scores of a clip count
    path: Annotated[Path, Field(exclude=True)] = Path()  # of the score file


RECORDS = TypeAdapter(list[ScoreRecord])


class ScoreFiles:
    """The score files of a results folder, each checked and opened once."""

    def __init__(self, root: Path) -> None:
        self.root = root

    @cached_property
    def _database(self) -> duckdb.DuckDBPyConnection:
        return duckdb.connect()

    @cached_property
    def _is_sound(self) -> dict[Path, bool]:
        """Return whether each file has the hash in its name."""
        patterns = ("scores/part-*.parquet", "*/scores/part-*.parquet")
        paths = [path for pattern in patterns for path in sorted(self.root.glob(pattern))]
        return {path: path.stem == f"part-{_digest(path)}" for path in paths}

    @property
    def damaged(self) -> list[Path]:
        """Return the files that are not as they were written."""
        return [path for path, is_sound in self._is_sound.items() if not is_sound]

    @cached_property
    def records(self) -> dict[str, list[ScoreRecord]]:
        """Return the records of all other files by method."""
        by_method: dict[str, list[ScoreRecord]] = {}
        paths = [path for path, is_sound in self._is_sound.items() if is_sound]
        for name, text in self._metadata(paths):
            for record in RECORDS.validate_json(text):
                of_method = by_method.setdefault(record.method, [])
                of_method.append(replace(record, path=Path(name)))
        return by_method

    def scores(self, records: Sequence[ScoreRecord], clips: Sequence[str]) -> dict[str, Scores]:
        """Return all scores of these clips by method."""
        if not records:
            return {}
        self._select(records, clips)
        self._database.execute(  # all scores in one array: where those of a method and metric end
            "CREATE OR REPLACE TABLE extents AS WITH sizes AS ("
            "SELECT method, metric, max(max(sample) + 1) OVER (PARTITION BY method) AS samples, "
            "max(max(step)) OVER (PARTITION BY method) AS steps, "
            "($clips * samples * steps)::BIGINT AS size FROM selected GROUP BY 1, 2) "
            "SELECT *, (sum(size) OVER (ORDER BY method, metric))::BIGINT AS stop FROM sizes",
            {"clips": len(clips)},
        )
        extents = self._database.execute("FROM extents ORDER BY stop").fetchall()
        columns = self._database.execute(
            "SELECT stop - size + (number * samples + sample) * steps + step - 1 AS place, "
            "coalesce(value, 'nan') AS value FROM selected JOIN extents USING (method, metric)"
        ).fetchnumpy()
        values = np.full(sum(size for *_, size, _ in extents), np.nan)
        values[columns["place"]] = columns["value"]
        by_method: dict[str, dict[str, FloatArray]] = {}
        for method, metric, samples, steps, size, stop in extents:
            shaped = values[stop - size : stop].reshape(len(clips), samples, steps)
            by_method.setdefault(method, {})[metric] = shaped
        return {method: Scores(clips, arrays) for method, arrays in by_method.items()}

    def facts(self, records: Iterable[ScoreRecord]) -> dict[str, dict[str, float]]:
        """Return the facts of all clips in the files of some records; see Scores."""
        facts: dict[str, dict[str, float]] = {}
        for _, text in self._metadata({record.path for record in records}):
            for record in json.loads(text):
                facts |= record.get("facts", {})
        return facts

    def write(self, method: str, scored: Sequence[tuple[Scores, ScoreRecord]]) -> None:
        """Write a score file of a method; OSError without room."""
        rows = [row for scores, _ in scored for row in scores.rows()]
        kinds = {"clip": object, "sample": int, "step": int, "metric": object, "value": float}
        table = np.array(rows, list(kinds.items()))
        self._database.register("scores", {name: table[name].copy() for name in kinds})
        query = (
            f"SELECT '{_quoted(method)}' AS method, clip::VARCHAR AS clip, "
            "sample::INTEGER AS sample, step::INTEGER AS step, metric::VARCHAR AS metric, "
            "if(isnan(value), NULL, value) AS value FROM scores"
        )
        now = time.time_ns()
        facts = {clip: numbers for scores, _ in scored for clip, numbers in scores.facts.items()}
        self._copy(query, method, [replace(record, written_ns=now) for _, record in scored], facts)

    def merge(self, method: str, fingerprint: str) -> None:
        """Merge the score files of one fingerprint in the folder of a method."""
        folder = self.root / method / "scores"  # a file that methods share stays
        records = [
            record
            for record in self.records.get(method, ())
            if record.fingerprint == fingerprint and record.path.parent == folder
        ]
        paths = {record.path for record in records}
        if len(paths) < 2:
            return
        latest = newest(records, {clip for record in records for clip in record.clips})
        self._select(latest, [clip for record in latest for clip in record.clips])
        query = (
            "SELECT method, clip, sample, step, metric, value FROM selected "
            "ORDER BY number, metric, sample, step"
        )
        merged = self._copy(query, method, latest, self.facts(latest))
        for path in paths - {merged}:
            path.unlink(missing_ok=True)

    def _metadata(self, paths: Collection[Path]) -> list[tuple[str, str]]:
        """Return the names and the records of files, as they are stored."""
        query = "SELECT file_name, value FROM parquet_kv_metadata($paths) WHERE key = 'geovp'"
        values = {"paths": [*map(str, paths)]}
        return self._database.execute(query, values).fetchall() if paths else []

    def _select(self, records: Sequence[ScoreRecord], clips: Sequence[str]) -> None:
        """Define the view `selected` of the rows of some clips, with their `number`."""
        numbers = {clip: number for number, clip in enumerate(clips)}
        names = [clip for record in records for clip in record.clips]
        counts = [len(record.clips) for record in records]
        columns: dict[str, Any] = {
            "filename": np.array([str(record.path) for record in records], object).repeat(counts),
            "method": np.array([record.method for record in records], object).repeat(counts),
            "clip": np.array(names, object),
            "number": np.array([numbers[clip] for clip in names]),
        }
        self._database.register("entries", columns)
        paths = {str(record.path) for record in records}
        self._database.read_parquet([*paths], filename=True).create_view("files")
        self._database.execute(
            "CREATE OR REPLACE TABLE wanted AS SELECT filename::VARCHAR AS filename, "
            "method::VARCHAR AS method, clip::VARCHAR AS clip, number::INTEGER AS number "
            "FROM entries; CREATE OR REPLACE VIEW selected AS FROM files JOIN wanted "
            "USING (filename, method, clip)"
        )

    def _copy(
        self, query: str, method: str, records: Iterable[ScoreRecord], facts: Mapping[str, Any]
    ) -> Path:
        """Write the rows of a query into a new score file with its records as metadata."""
        stored = RECORDS.dump_python(_joined(records))
        for record in stored:
            record["facts"] = {clip: facts[clip] for clip in record["clips"] if clip in facts}
        about = json.dumps(stored)
        folder = self.root / method / "scores"
        folder.mkdir(parents=True, exist_ok=True)
        scratch = folder / f".{uuid.uuid4()}.part"
        try:
            self._database.execute(
                f"COPY ({query}) TO '{_quoted(scratch)}' "
                f"(FORMAT parquet, USE_TMP_FILE false, KV_METADATA {{geovp: '{_quoted(about)}'}})"
            )
            path = folder / f"part-{_digest(scratch)}.parquet"
            scratch.rename(path)
        except duckdb.IOException as problem:
            raise OSError(errno.EIO, str(problem), str(folder)) from problem
        finally:
            scratch.unlink(missing_ok=True)
        return path


def newest(records: Sequence[ScoreRecord], clips: Collection[str]) -> list[ScoreRecord]:
    """Return the newest records of some clips, with their fraction of the times."""
    latest: dict[str, ScoreRecord] = {}
    for record in sorted(records, key=lambda record: record.written_ns):
        latest |= dict.fromkeys(record.clips, record)
    wanted, selected = set(clips), []
    for record in records:
        names = [clip for clip in record.clips if latest[clip] is record and clip in wanted]
        if names:
            ratio = len(names) / len(record.clips)
            times_s = {stage: ratio * time_s for stage, time_s in record.seconds.items()}
            failures = {clip: record.failures[clip] for clip in names if clip in record.failures}
            selected.append(replace(record, clips=names, seconds=times_s, failures=failures))
    return selected


def _joined(records: Iterable[ScoreRecord]) -> list[ScoreRecord]:
    """Return one record for all clips that were scored alike."""
    groups: dict[str, list[ScoreRecord]] = {}
    for record in records:
        alike = json.dumps([record.fingerprint, record.metrics, record.code], sort_keys=True)
        groups.setdefault(alike, []).append(record)
    joined = []
    for group in groups.values():
        joined.append(
            replace(
                group[0],
                clips=sorted(clip for record in group for clip in record.clips),
                seconds=seconds(group),
                peak_memory_mb=max(record.peak_memory_mb for record in group),
                failures={clip: why for record in group for clip, why in record.failures.items()},
                written_ns=max(record.written_ns for record in group),
            )
        )
    return joined


def seconds(records: Iterable[ScoreRecord]) -> dict[str, float]:
    """Return the sum of the seconds of records, by stage."""
    return dict(sum((Counter(record.seconds) for record in records), Counter()))


def _digest(path: Path) -> str:
    """Return the first digits of the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def _quoted(text: object) -> str:
    """Return a text for use between single quotes."""
    return str(text).replace("'", "''")
