"""The bytes of a parquet part: its rows, what is said about them, and a checksum of the whole file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from geovp_classic import files
from geovp_classic.errors import BadData

METADATA_KEY = b"geovp"
LIMIT_BYTES = 512 * files.MIB


def content(rows: pa.Table, facts: Mapping[str, Any]) -> bytes:
    """The file of a part."""
    about = json.dumps({files.SEAL: files.ZEROS, **facts})
    stream = pa.BufferOutputStream()
    pq.write_table(rows.replace_schema_metadata({METADATA_KEY: about}), stream, write_page_checksum=True)
    return files.sealed(stream.getvalue().to_pybytes())


def facts(path: Path) -> dict[str, Any]:
    """What is said about the rows; BadData when the file is damaged."""
    try:
        read = json.loads(pq.read_metadata(_checked(path)).metadata[METADATA_KEY])
        return {key: value for key, value in read.items() if key != files.SEAL}
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as problem:
        raise BadData(f"{path} is no part of results ({problem}): remove it and run again") from problem


def rows(path: Path, schema: pa.Schema) -> pa.Table:
    """The rows; BadData when the file is damaged."""
    try:
        return pq.read_table(_checked(path), schema=schema, page_checksum_verification=True)
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as problem:
        raise BadData(f"{path} is no part of results ({problem}): remove it and run again") from problem


def _checked(path: Path) -> pa.BufferReader:
    """The file whose own checksum is right; parts of older versions have none, and are taken as they are."""
    found = files.read_bytes(path, LIMIT_BYTES)
    files.check_seal(path, found)
    return pa.BufferReader(found)
