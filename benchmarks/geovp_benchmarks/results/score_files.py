"""Score files: parquet with the scores of some clips of a method; a content hash in the file name.

A file has a row per clip, sample, step and metric. Its metadata says how the clips were scored, and
holds the facts of the clips.
"""

from __future__ import annotations

import errno
import hashlib
import json
import tempfile
import time
import uuid
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

import duckdb
import numpy as np
from pydantic import Field

from geovp_benchmarks.failure import Failure
from geovp_benchmarks.results.scores import Scores
from geovp_benchmarks.validation import adapter
from geovp_classic.types import FloatArray

Facts = dict[str, dict[str, float | str]]


@dataclass(frozen=True, eq=False)
class ScoreRecord:
    """How some clips of a method were scored; a score file holds one or more of them."""

    method: str  # the name of its folder
    clips: list[str]
    fingerprint: str  # of the method and the protocol
    metrics: dict[str, Any] = field(default_factory=dict)  # resolved, by column
    seconds: dict[str, float] = field(default_factory=dict)  # per stage, summed over the clips
    peak_memory_mb: float = 0.0  # the highest during their prediction; 0 where unknown
    code: str = ""  # a hash of the sources that computed it; "" for rescored predictions
    failures: dict[str, Failure] = field(default_factory=dict)  # by clip
    # `Prediction.shown_by` by clip, of predictors with more than one way to show it
    shown_by: dict[str, str] = field(default_factory=dict)
    written_ns: int = 0  # the newest scores of a clip count
    digests: dict[str, str] = field(default_factory=dict)  # of the content of the clips, if known
    # numbers and texts about the clips, by clip; empty when read, see `ScoreFiles.facts`
    facts: Annotated[Facts, Field(exclude=True)] = field(default_factory=dict)
    path: Annotated[Path, Field(exclude=True)] = Path()  # of the score file

    @cached_property
    def settings(self) -> str:
        """Return what clips that were scored alike have in common."""
        return json.dumps([self.fingerprint, self.metrics, self.code], sort_keys=True)


class NewestRecords(dict[str, ScoreRecord]):
    """How clips of a method were scored: the newest record of each."""

    @classmethod
    def of(cls, records: Iterable[ScoreRecord], digests: Mapping[str, str] | None = None) -> Self:
        """Return the newest record of each clip; with digests, of clips with this content."""
        newest = cls()
        for record in sorted(records, key=lambda record: record.written_ns):
            for clip in record.clips:
                if digests is None or record.digests.get(clip, "") == digests.get(clip, ""):
                    newest[clip] = record
        return newest

    def stated(self, name: str) -> dict[str, Any]:
        """Return the values of a field that records state by clip, for the clips that have one."""
        by_clip = {clip: getattr(record, name) for clip, record in self.items()}
        return {clip: values[clip] for clip, values in by_clip.items() if clip in values}

    @cached_property
    def failures(self) -> dict[str, Failure]:
        """Return why clips could not be predicted; they are scored as copies of the last frame."""
        return self.stated("failures")

    @cached_property
    def shown_by(self) -> dict[str, str]:
        """Return what clips are shown by, where a predictor states it."""
        return self.stated("shown_by")

    @property
    def seconds(self) -> dict[str, float]:
        """Return the seconds of all clips by stage."""
        total_s: defaultdict[str, float] = defaultdict(float)
        for record, num_clips in Counter(self.values()).items():
            for stage, time_s in record.seconds.items():
                total_s[stage] += time_s * num_clips / len(record.clips)
        return dict(total_s)

    @property
    def peak_memory_mb(self) -> float:
        """Return the highest peak memory of the predictions, 0 if unknown."""
        return max((record.peak_memory_mb for record in self.values()), default=0.0)

    @property
    def joined(self) -> list[ScoreRecord]:
        """Return one record for all clips that were scored alike."""
        groups: dict[str, NewestRecords] = {}
        for clip, record in self.items():
            groups.setdefault(record.settings, NewestRecords())[clip] = record
        return [
            replace(
                next(iter(group.values())),
                clips=sorted(group),
                seconds=group.seconds,
                peak_memory_mb=group.peak_memory_mb,
                failures=group.failures,
                shown_by=group.shown_by,
                digests=group.stated("digests"),
                written_ns=max(record.written_ns for record in group.values()),
            )
            for group in groups.values()
        ]


class ScoreFiles:
    """The score files of a results folder, each checked and opened once."""

    def __init__(self, root: Path) -> None:
        self.root = root

    @cached_property
    def _database(self) -> duckdb.DuckDBPyConnection:
        return duckdb.connect(config={"temp_directory": str(Path(tempfile.gettempdir(), "duckdb"))})

    @cached_property
    def _paths(self) -> list[Path]:
        shared = self.root.glob("scores/part-*.parquet")  # by methods
        return sorted([*shared, *self.root.glob("*/scores/part-*.parquet")])

    @cached_property
    def damaged(self) -> list[Path]:
        """Return the files that do not have the hash in their name."""
        return [path for path in self._paths if path.stem != f"part-{_digest(path)}"]

    @cached_property
    def records(self) -> dict[str, list[ScoreRecord]]:
        """Return the records of all other files by method."""
        by_method: dict[str, list[ScoreRecord]] = {}
        paths = [path for path in self._paths if path not in self.damaged]
        for name, text in self._metadata("geovp", paths):
            for record in adapter(list[ScoreRecord]).validate_json(text):
                of_method = by_method.setdefault(record.method, [])
                of_method.append(replace(record, path=Path(name)))
        return by_method

    def facts(self, records: Iterable[ScoreRecord]) -> Facts:
        """Return numbers and texts about the clips themselves, by clip and name."""
        facts: Facts = {}
        for _, text in self._metadata("facts", {record.path for record in records}):
            for clip, of_clip in json.loads(text).items():
                facts.setdefault(clip, {}).update(of_clip)
        return facts

    def scores(
        self,
        records: Mapping[str, NewestRecords],
        clips: Sequence[str],
        steps: Sequence[int] = (),  # the first and the last; empty: all scores
    ) -> dict[str, Scores]:
        """Return all scores of these clips by method, or their means from one step to another.

        The database reduces the steps: those of many samples would fill the memory.
        """
        if not any(records.values()):
            return {}
        self._select(records, clips)
        rows = "selected"
        if steps:
            rows = (
                "(SELECT method, metric, number, sample, 1 AS step, avg(value) AS value "
                f"FROM selected WHERE step BETWEEN {steps[0]} AND {steps[1]} GROUP BY ALL)"
            )
        columns = self._database.execute(  # clip, sample and step in one number: lists are slow
            "SELECT method, metric, max(sample) + 1, max(step), "
            "list((number::BIGINT * 1000000 + sample) * 1000000 + step - 1), "
            f"list(coalesce(value, 'nan')) FROM {rows} GROUP BY ALL ORDER BY ALL"
        ).fetchnumpy()
        grid = len(clips), 10**6, 10**6
        by_method: dict[str, dict[str, FloatArray]] = {}
        for method, metric, samples, last, places, values in zip(*columns.values(), strict=True):
            scores = np.full((len(clips), samples, last), np.nan)
            scores[np.unravel_index(places, grid)] = values
            by_method.setdefault(method, {})[metric] = scores
        return {method: Scores(clips, arrays) for method, arrays in by_method.items()}

    def export(
        self,
        records: Mapping[str, NewestRecords],
        clips: Sequence[str],
        labels: Mapping[str, str],  # of methods
        path: Path,
        kind: str,  # csv or parquet
    ) -> None:
        """Write all scores of these clips into one table; OSError without room."""
        self._select(records, clips)
        label = " ".join(
            f"WHEN '{_quoted(name)}' THEN '{_quoted(text)}'" for name, text in labels.items()
        )
        query = (
            f"SELECT CASE method {label} END AS method, clip, sample, step, metric, "
            "value::DOUBLE AS value FROM selected ORDER BY method, number, metric, sample, step"
        )
        self._copy_to(path, query, f"FORMAT {kind}")

    def write(self, method: str, scored: Sequence[tuple[Scores, ScoreRecord]]) -> None:
        """Write a score file of a method; OSError without room."""
        rows = [row for scores, _ in scored for row in scores.rows()]
        self._register(rows, clip=object, sample=int, step=int, metric=object, value=float)
        query = (
            f"SELECT '{_quoted(method)}' AS method, clip::VARCHAR AS clip, "
            "sample::INTEGER AS sample, step::INTEGER AS step, metric::VARCHAR AS metric, "
            "if(isnan(value), NULL, value) AS value FROM rows"
        )
        now = time.time_ns()
        records = [replace(record, written_ns=now) for _, record in scored]
        facts = {clip: numbers for record in records for clip, numbers in record.facts.items()}
        self._copy(query, self.root / method / "scores", NewestRecords.of(records).joined, facts)

    def merge(self, method: str, fingerprint: str, digests: Mapping[str, str]) -> None:
        """Merge the score files of one fingerprint and data in the folder of a method."""
        folder = self.root / method / "scores"  # a file that methods share stays
        records = [
            record
            for record in self.records.get(method, ())
            if record.fingerprint == fingerprint and record.path.parent == folder
        ]
        others = {
            record.path
            for record in records
            if any(digests.get(clip, "") != digest for clip, digest in record.digests.items())
        }
        records = [record for record in records if record.path not in others]
        paths = {record.path for record in records}
        if len(paths) > 1:
            latest = NewestRecords.of(records)
            self._join({method: latest}, [*latest], folder, "value", paths)

    def compact(self, records: Mapping[str, NewestRecords], clips: Sequence[str]) -> None:
        """Join the scores of methods in one file, in single precision, and remove the others."""
        before = {*self._paths}
        self._join(records, clips, self.root / "scores", "value::FLOAT AS value", before)
        for folder in {path.parent for path in before}:
            with suppress(OSError):  # not that of the new file
                folder.rmdir()

    def _join(
        self,
        records: Mapping[str, NewestRecords],
        clips: Sequence[str],
        folder: Path,
        value: str,  # in SQL
        replaced: set[Path],
    ) -> None:
        """Write the scores of some clips into one file in place of others."""
        joined = [record for of_method in records.values() for record in of_method.joined]
        facts = self.facts(record for each in records.values() for record in each.values())
        self._select(records, clips)
        query = (
            f"SELECT method, clip, sample, step, metric, {value} FROM selected "
            "ORDER BY method, number, metric, sample, step"
        )
        self._database.execute("SET memory_limit = '1GB'")  # sorting goes on in temporary files
        path = self._copy(query, folder, joined, facts)
        self._database.execute("RESET memory_limit")
        for other in replaced - {path}:
            other.unlink(missing_ok=True)

    def _metadata(self, key: str, paths: Iterable[Path]) -> list[tuple[str, str]]:
        """Return the names of files, and what they hold under a key."""
        query = "SELECT file_name, value FROM parquet_kv_metadata($paths) WHERE key = $key"
        values = {"paths": [*map(str, paths)], "key": key}
        return self._database.execute(query, values).fetchall() if values["paths"] else []

    def _register(self, rows: Sequence[tuple[Any, ...]], **kinds: type) -> None:
        """Define the view `rows` with columns of these kinds; text is an object."""
        table = np.array(rows, list(kinds.items()))
        self._database.register("rows", {name: table[name].copy() for name in kinds})

    def _select(self, records: Mapping[str, NewestRecords], clips: Sequence[str]) -> None:
        """Define the view `selected` of the rows of some clips, with their `number`."""
        numbers = {clip: number for number, clip in enumerate(clips)}
        rows = [
            (str(record.path), method, clip, numbers[clip])
            for method, of_method in records.items()
            for clip, record in of_method.items()
        ]
        self._register(rows, filename=object, method=object, clip=object, number=int)
        paths = {path for path, *_ in rows}
        self._database.read_parquet([*paths], filename=True).create_view("files")
        self._database.execute(
            "CREATE OR REPLACE TABLE wanted AS SELECT filename::VARCHAR AS filename, "
            "method::VARCHAR AS method, clip::VARCHAR AS clip, number::INTEGER AS number "
            "FROM rows; CREATE OR REPLACE VIEW selected AS FROM files JOIN wanted "
            "USING (filename, method, clip)"
        )

    def _copy(self, query: str, folder: Path, joined: list[ScoreRecord], facts: Facts) -> Path:
        """Write the rows of a query into a new score file with records and facts as metadata."""
        records = adapter(list[ScoreRecord]).dump_python(joined)
        metadata = {"geovp": json.dumps(records), "facts": json.dumps(facts)}
        pairs = ", ".join(f"{key}: '{_quoted(text)}'" for key, text in metadata.items())
        folder.mkdir(parents=True, exist_ok=True)
        scratch = folder / f".{uuid.uuid4()}.part"
        settings = f"FORMAT parquet, COMPRESSION zstd, KV_METADATA {{{pairs}}}"
        try:
            self._copy_to(scratch, query, settings)
            path = folder / f"part-{_digest(scratch)}.parquet"
            scratch.rename(path)
        finally:
            scratch.unlink(missing_ok=True)
        return path

    def _copy_to(self, path: Path, query: str, settings: str) -> None:
        """Write the rows of a query into a file; OSError without room."""
        try:
            self._database.execute(
                f"COPY ({query}) TO '{_quoted(path)}' ({settings}, USE_TMP_FILE false)"
            )
        except duckdb.IOException as problem:
            raise OSError(errno.EIO, str(problem), str(path)) from problem


def _digest(path: Path) -> str:
    """Return the first digits of the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def _quoted(text: object) -> str:
    """Return a text for use between single quotes."""
    return str(text).replace("'", "''")
