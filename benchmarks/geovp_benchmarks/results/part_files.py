"""Parquet parts: the rows of some clips of a cell, what is said about them, and a checksum of the
whole file.
"""

import contextlib
import dataclasses
import errno
import functools
import hashlib
import json
import os
import re
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import duckdb
import numpy as np

from geovp_benchmarks.results.rows import Rows
from geovp_classic import files
from geovp_classic.data.atomic import write_bytes
from geovp_classic.errors import BadData, GeovpError

CHECKSUM = "file-sha256"  # in the metadata, since DuckDB neither writes nor checks those of pages
BLANK = "0" * 64  # in its place while it is computed
LIMIT_BYTES = 512 * files.MIB
LIMIT_ROWS, ROWS_AT_ONCE = (
    2**24,
    2**18,
)  # 0.4 GB in memory, and twice that while they are put together
LIMIT_NAME_BYTES = 1000  # of a clip or a metric, 0.5 GB in the rows that are read at once
NAME = (
    f"if(strlen({{0}}) > {LIMIT_NAME_BYTES}, error('a name of more than {LIMIT_NAME_BYTES} "
    f"bytes'), {{0}}::VARCHAR)"
)
STORED = (
    f"{NAME.format('clip')}, sample::INTEGER, step::INTEGER, {NAME.format('metric')}, value::DOUBLE"
)
OPEN_FILES = "/dev/fd"  # this process's own, by their numbers
NO_EXTENSIONS = (
    "autoinstall_known_extensions",
    "autoload_known_extensions",
    "allow_community_extensions",
)
ALONE = threading.Lock()
DAMAGES = (duckdb.Error, ValueError, LookupError, TypeError, AttributeError, RecursionError)


@dataclass(frozen=True)
class Part:
    """The metadata of one parquet file."""

    index: int
    clips: tuple[str, ...]
    fingerprint: str  # of the cell and the protocol that it was computed with
    metrics: Mapping[str, Any]  # the resolved metric behind each column
    seconds: Mapping[str, float]  # per stage, summed over its clips
    # the highest resident memory of the process while it predicted these clips; 0 where unknown
    peak_memory_mb: float
    peak_is_own: bool = False  # False: the peak of the whole process so far
    code: str = ""  # a hash of the sources that computed it; "" for rescored predictions
    failures: Mapping[str, Sequence[str]] = dataclasses.field(
        default_factory=dict
    )  # clip -> status, reason, traceback
    facts: Mapping[str, Mapping[str, float]] = dataclasses.field(
        default_factory=dict
    )  # of each clip, see `scoring`


def write(path: Path, rows: Rows, part: Part) -> None:
    """Write all rows of the part's clips at once; equal rows and facts give equal bytes. OSError
    without room.
    """
    facts = {key: value for key, value in dataclasses.asdict(part).items() if key != "index"}
    about = json.dumps({CHECKSUM: BLANK, **facts}).replace("'", "''")
    columns = {"clip": rows.clip.values(), "sample": rows.sample, "step": rows.step}
    columns |= {"metric": rows.metric.values(), "value": rows.value}
    with _database() as (database, file, place):
        database.register("scores", columns)
        try:
            database.execute(
                "COPY (SELECT clip::VARCHAR AS clip, sample, step, metric::VARCHAR AS metric, "
                "if(isnan(value), NULL, value) AS value FROM scores) "
                f"TO {place} (FORMAT parquet, USE_TMP_FILE false, KV_METADATA {{geovp: '{about}'}})"
            )
        except duckdb.IOException as problem:
            raise OSError(errno.EIO, str(problem), tempfile.gettempdir()) from problem
        file.seek(0)
        content = file.read()
    digest = hashlib.sha256(content).hexdigest()
    write_bytes(path, content.replace(_entry(BLANK), _entry(digest), 1))


def read(path: Path) -> Part | None:
    """What is said about the rows; None where the file is damaged."""
    try:
        with _checked(path) as (database, place):
            found = database.execute(
                f"SELECT value FROM parquet_kv_metadata({place}) WHERE key = 'geovp'"
            ).fetchall()
        facts = json.loads(found[0][0])
        facts.pop(CHECKSUM, None)
        return Part(
            int(path.stem.removeprefix("part-")), **{**facts, "clips": tuple(facts["clips"])}
        )
    except (BadData, *DAMAGES):
        return None


def rows(path: Path) -> Rows:
    """The rows; BadData when the file is damaged."""
    try:
        with _checked(path) as (database, place):
            found = Rows.concatenated(_blocks(database, place))
        if found.sample.min(initial=0) < 0 or found.step.min(initial=1) < 1:
            raise ValueError("a negative sample or step")
    except DAMAGES as problem:
        reason = f"{problem}".partition("\n")[0][:200]
        raise BadData(
            f"{path} is no part of results ({reason}): remove it and run again"
        ) from problem
    return found


def _blocks(database: duckdb.DuckDBPyConnection, place: str) -> list[Rows]:
    """The rows, so many at once: a name per row takes much memory, its number little."""
    blocks: list[Rows] = []
    while (done := len(blocks) * ROWS_AT_ONCE) == sum(map(len, blocks)):
        if done > LIMIT_ROWS:
            raise ValueError(f"more than {LIMIT_ROWS} rows")
        query = f"SELECT {STORED} FROM read_parquet({place}) LIMIT {ROWS_AT_ONCE} OFFSET {done}"
        clip, sample, step, metric, value = database.execute(query).fetchnumpy().values()
        if any(map(np.ma.is_masked, (clip, sample, step, metric))):
            raise ValueError("a row without a clip, sample, step or metric")
        blocks.append(Rows.of(clip, sample, step, metric, np.ma.filled(value, np.nan)))
    return blocks


@contextlib.contextmanager
def _checked(path: Path) -> Iterator[tuple[duckdb.DuckDBPyConnection, str]]:
    """Yield the database and the place of its copy of a file with the right checksum."""
    content = files.read_bytes(path, LIMIT_BYTES)
    _check(path, content)
    with _database() as (database, file, place):
        file.write(content)
        file.flush()
        del content
        yield database, place


def _check(path: Path, content: bytes) -> None:
    """Raise BadData if the SHA-256 in the metadata is not that of the file without it."""
    stored = re.search(_entry('([^"]*)'), content)
    if stored is None:
        return
    blank = content.replace(stored[0], _entry(BLANK), 1)
    if hashlib.sha256(blank).hexdigest().encode() != stored[1]:
        raise BadData(f"{path} does not match its checksum: remove it and run again")


def _entry(digest: str) -> bytes:
    """Return the checksum's entry in the metadata."""
    return f'"{CHECKSUM}": "{digest}"'.encode()


@contextlib.contextmanager
def _database() -> Iterator[tuple[duckdb.DuckDBPyConnection, IO[bytes], str]]:
    """The database, and an empty nameless file, which no kill leaves behind, with its place for the
    database.
    """
    with ALONE:
        database, file = _memory(os.getpid())
        try:
            with database.cursor() as cursor:
                yield cursor, file, f"'{OPEN_FILES}/{file.fileno()}'"
        except duckdb.PermissionException as problem:  # no damage of a file
            raise GeovpError(
                f"DuckDB {duckdb.__version__} refuses a file: install another version"
            ) from problem
        except duckdb.Error:
            _memory.cache_clear()  # an internal error is the end of a database
            raise
        finally:
            file.seek(0)
            file.truncate()


@functools.cache
def _memory(_process: int) -> tuple[duckdb.DuckDBPyConnection, IO[bytes]]:
    """An empty database without extensions and network, and a file for it; a fork of the process
    needs its own.
    """
    off = dict.fromkeys(NO_EXTENSIONS, False)
    database = duckdb.connect(
        ":memory:", config={"threads": 1, "memory_limit": "512MB", "temp_directory": "", **off}
    )
    with tempfile.TemporaryDirectory() as folder:
        file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - as long as the database
    seen = ", ".join(
        "'{}'".format(one.replace("'", "''")) for one in (OPEN_FILES, os.path.realpath(folder))
    )
    database.execute(
        f"SET allowed_directories = [{seen}]"
    )  # DuckDB 2.0.1 asks where an open file was before it lost its name
    return database.execute(
        "SET enable_external_access = false; SET lock_configuration = true"
    ), file
