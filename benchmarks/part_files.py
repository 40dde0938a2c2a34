"""Parquet parts: the rows of some clips of a cell, what is said about them, and a checksum of the whole file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from geovp_classic import files
from geovp_classic.data.atomic import write_bytes
from geovp_classic.errors import BadData

SCORES = pa.schema(
    [
        ("clip", pa.string()),
        ("sample", pa.int32()),  # 0 .. S-1
        ("step", pa.int32()),  # horizon k = 1 .. F
        ("metric", pa.string()),  # "psnr", "psnr@covered", "psnr@moving", "translation-error", ...
        ("value", pa.float64()),  # null: not defined there, e.g. no covered pixel
    ]
)
METADATA_KEY = b"geovp"
LIMIT_BYTES = 512 * files.MIB
DAMAGES = (pa.ArrowException, OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)


@dataclass(frozen=True)
class Part:
    """The metadata of one parquet file."""

    index: int
    clips: tuple[str, ...]
    fingerprint: str  # of the cell and the protocol that it was computed with
    metrics: Mapping[str, Any]  # the resolved metric behind each column
    seconds: Mapping[str, float]  # per stage, summed over its clips
    peak_memory_mb: float  # the highest resident memory of the process while it predicted these clips; 0 where unknown
    peak_is_own: bool = False  # False in older parts: the peak of the whole process so far
    code: str = ""  # a hash of the sources that it was computed with; "" in parts of older versions
    failures: Mapping[str, Sequence[str]] = dataclasses.field(default_factory=dict)  # clip -> status, reason, traceback
    facts: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)  # of each clip, see `scoring`


def write(path: Path, rows: pa.Table, part: Part) -> None:
    """Write all rows of the part's clips at once."""
    facts = {key: value for key, value in dataclasses.asdict(part).items() if key != "index"}
    about = json.dumps({files.SEAL: files.ZEROS, **facts})
    stream = pa.BufferOutputStream()
    pq.write_table(rows.replace_schema_metadata({METADATA_KEY: about}), stream, write_page_checksum=True)
    write_bytes(path, files.sealed(stream.getvalue().to_pybytes()))


def read(path: Path) -> Part | None:
    """What is said about the rows; None where the file is damaged."""
    try:
        facts = json.loads(pq.read_metadata(_checked(path)).metadata[METADATA_KEY])
        facts.pop(files.SEAL, None)
        return Part(int(path.stem.removeprefix("part-")), **{**facts, "clips": tuple(facts["clips"])})
    except (BadData, *DAMAGES):
        return None


def rows(path: Path) -> pa.Table:
    """The rows, columns as SCORES; BadData when the file is damaged."""
    try:
        return pq.read_table(_checked(path), schema=SCORES, page_checksum_verification=True)
    except DAMAGES as problem:
        raise BadData(f"{path} is no part of results ({problem}): remove it and run again") from problem


def _checked(path: Path) -> pa.BufferReader:
    """The file whose own checksum is right; parts of older versions have none, and are taken as they are."""
    found = files.read_bytes(path, LIMIT_BYTES)
    files.check_seal(path, found)
    return pa.BufferReader(found)
