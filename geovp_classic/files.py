"""The one door for files that are read: what is no regular file, too large or damaged is refused in
one sentence.

A folder may hold SHA256SUMS as `sha256sum * > SHA256SUMS` writes it; its files must then match it.
Our own files carry a checksum of themselves: the first `"file-sha256": "<64 digits>"` in them is
that of the file with zeros in its place.
"""

import contextlib
import functools
import hashlib
import io
import json
import os
import re
import stat
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from geovp_classic.errors import BadData

MIB = 2**20
TEXT_LIMIT, IMAGE_LIMIT, ARRAYS_LIMIT = 64 * MIB, 256 * MIB, 8192 * MIB
SUMS = "SHA256SUMS"
MAX_NAME_BYTES = 255  # of one name in a path, on every file system in use
SEAL, ZEROS = (
    "file-sha256",
    "0" * 64,
)  # the key of a file's own checksum, and what stands there while it is taken
LAST = "is-sealed"  # the last key of a JSON file that has a checksum at its beginning
_SEALED = re.compile(rb'"file-sha256": ?"([^"]{64})"')
_DAMAGED = "it was damaged or edited since it was written"
_BROKEN = (
    ValueError,
    OSError,
    EOFError,
    KeyError,
    TypeError,
    RuntimeError,
    MemoryError,
    OverflowError,
    SyntaxError,
)
_BROKEN_ZIP = (*_BROKEN, zipfile.BadZipFile, zlib.error, tokenize.TokenError)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[io.BufferedReader]:
    """A regular file, open for reading; BadData says why it cannot be, or why reading it failed."""
    try:
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode):
            kind = "folder" if stat.S_ISDIR(mode) else "pipe or device"
            raise BadData(f"{path} is a {kind}, expected a file: give a file on disk")
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            yield file
    except FileNotFoundError:
        raise BadData(f"{path} cannot be read (No such file): restore it or give another") from None
    except (OSError, ValueError) as problem:  # ValueError: a NUL in the name
        reason = getattr(problem, "strerror", None) or problem
        raise BadData(
            f"{path} cannot be read ({reason}): restore it or its permissions"
        ) from problem


def read_bytes(path: Path, limit_bytes: int = IMAGE_LIMIT) -> bytes:
    """The content of a regular file of at most `limit_bytes`, which is what SHA256SUMS beside it
    says, if it does.
    """
    with opened(path) as file:
        content = file.read(limit_bytes + 1)
    if len(content) > limit_bytes:
        raise BadData(
            f"{path} has more than {limit_bytes // MIB} MiB, which none needs: give the right file"
        )
    _compare(path, lambda: hashlib.sha256(content))
    return content


def check_file(path: Path) -> None:
    """BadData unless this is a regular file that is what SHA256SUMS beside it says, if it does."""
    with opened(path) as file:
        _compare(path, lambda: hashlib.file_digest(file, "sha256"))


def read_text(path: Path, limit_bytes: int = TEXT_LIMIT) -> str:
    """The text of a file in UTF-8."""
    try:
        return read_bytes(path, limit_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise BadData(
            f"{path} cannot be read as text ({problem}): give a text in UTF-8"
        ) from problem


def read_json(path: Path) -> dict[str, Any]:
    """The object of a JSON file of ours, whose checksum, where it has one, is right."""
    content = read_bytes(path, TEXT_LIMIT)
    is_sealed = check_seal(path, content)
    try:
        read = json.loads(content)
        if not isinstance(read, dict):
            raise ValueError(f"it holds a {type(read).__name__}, expected an object")
    except (ValueError, RecursionError) as problem:  # ValueError: 5,000 digits, too
        raise BadData(f"{path} is not JSON ({problem}): mend or remove it") from problem
    if read.pop(LAST, False) and not is_sealed:
        raise BadData(
            f"{path} has lost its own checksum, {_DAMAGED}: restore it, or remove it and run again"
        )
    read.pop(SEAL, None)
    return read


def json_bytes(value: Mapping[str, Any]) -> bytes:
    """The JSON file of an object, with its own checksum, which `read_json` checks."""
    own = {key: each for key, each in value.items() if key not in (SEAL, LAST)}
    text = json.dumps(
        {SEAL: ZEROS, **own, LAST: True}, indent=2, ensure_ascii=False, allow_nan=False
    )
    try:
        return sealed(f"{text}\n".encode())
    except UnicodeEncodeError as problem:
        around = str(problem.object)[max(problem.start - 20, 0) : problem.end]
        raise BadData(
            f"...{around!r} is not text in UTF-8: give folders and files other names"
        ) from problem


def read_npz(path: Path, limit_bytes: int = ARRAYS_LIMIT) -> dict[str, npt.NDArray[Any]]:
    """The arrays of an npz file, each with the size and the checksum that the file says; never a
    pickle.
    """
    try:
        content = read_bytes(path, limit_bytes)
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            total = sum(member.file_size for member in archive.infolist())
            if total > min(limit_bytes, 1100 * len(content)):  # more than deflate can pack
                raise ValueError(f"{total / MIB:.0f} MiB once unpacked")
            if content[-22:-18] == b"PK\5\6" and len(archive.infolist()) != int.from_bytes(
                content[-12:-10], "little"
            ):
                raise ValueError(
                    "an array is lost"
                )  # zipfile does not compare the number in the file's last record
            return {name.removesuffix(".npy"): _array(archive, name) for name in archive.namelist()}
    except _BROKEN_ZIP as problem:
        raise BadData(
            f"{path} cannot be read ({_first_line(problem)}): it is no whole npz file"
        ) from problem


def finite_arrays(path: Path) -> dict[str, npt.NDArray[Any]]:
    """The arrays of an npz file of coefficients: finite numbers, and texts about them."""
    arrays = read_npz(path)
    for name, array in arrays.items():
        if array.dtype.kind not in "fiuU" or (
            array.dtype.kind == "f" and not np.isfinite(array).all()
        ):
            raise BadData(
                f"{path}: {name} ({array.dtype}) is not finite numbers: write the file anew"
            )
    return arrays


def _array(archive: zipfile.ZipFile, name: str) -> npt.NDArray[Any]:
    """One array, read to its end, where zip compares its checksum."""
    content = archive.read(name)
    if len(content) != archive.getinfo(name).file_size:
        raise ValueError(f"{name} is cut short")
    stream = io.BytesIO(content)
    array: npt.NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    if stream.read(1):
        raise ValueError(f"{name} is longer than its array")
    return array


def sealed(content: bytes) -> bytes:
    """The content of a file of ours, in which `SEAL` has `ZEROS`, with its checksum in
    their place.
    """
    found = _SEALED.search(content)
    assert found is not None
    return (
        content[: found.start(1)]
        + hashlib.sha256(content).hexdigest().encode()
        + content[found.end(1) :]
    )


def check_seal(path: Path, content: bytes) -> bool:
    """Whether the file has a checksum of itself; BadData when it is wrong."""
    found = _SEALED.search(content)
    if found is None and SEAL.encode() not in content:
        return False
    start, end = (0, 0) if found is None else found.span(1)
    unsealed = content[:start] + ZEROS.encode() + content[end:]
    if hashlib.sha256(unsealed).hexdigest().encode() != content[start:end]:
        raise BadData(
            f"{path} does not match its own checksum, {_DAMAGED}: restore it, or remove it and "
            "run again"
        )
    return True


def _compare(path: Path, digest: Callable[[], Any]) -> None:
    """BadData when SHA256SUMS beside the file says something else about it."""
    sums = path.with_name(SUMS)
    try:
        stamp = sums.stat()
    except OSError:
        return
    wanted = (
        None if path.name == SUMS else _sums(sums, stamp.st_mtime_ns, stamp.st_size).get(path.name)
    )
    if wanted is not None and digest().hexdigest() != wanted:
        raise BadData(
            f"{path} does not match {SUMS} beside it, {_DAMAGED}: restore it, or write {SUMS} anew"
        )


@functools.lru_cache(maxsize=64)
def _sums(path: Path, _mtime_ns: int, _size: int) -> dict[str, str]:
    """Digests by file name."""
    lines = (
        re.fullmatch(r"([0-9a-f]{64}) [ *](.+)", line) for line in read_text(path).splitlines()
    )
    return {line[2]: line[1] for line in lines if line}


def is_file(path: Path) -> bool:
    """Whether there is a regular file; False for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def leads_inside(name: str) -> bool:
    """Whether a path in data is one of a file inside the folder that it is about."""
    return not (Path(name).is_absolute() or ".." in Path(name).parts or "\0" in name)


def check_name(name: str, what: str) -> None:
    """BadData unless a name can be printed, stored as UTF-8, and stays inside the folder that it is
    put in.
    """
    if any("\ud800" <= letter <= "\udfff" or letter in "\0\n\r" for letter in name):
        raise BadData(f"{what} {name!r} is not text in UTF-8 on one line: rename it")
    if not leads_inside(name):
        raise BadData(f"{what} {name!r} leads out of its folder: give a path inside it")


def _first_line(problem: Exception) -> str:
    return str(problem).strip().partition("\n")[0][:200] or type(problem).__name__
