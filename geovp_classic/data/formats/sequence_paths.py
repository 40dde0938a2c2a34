"""Paths of results of other software, with a place for the name of a sequence."""

from pathlib import Path

from geovp_classic.errors import BadData

SEQUENCE = "{sequence}"


def check_exists(path: Path, what: str) -> None:
    """Raise BadData if a path without a place for the sequence does not exist."""
    if SEQUENCE not in str(path) and not path.exists():
        raise BadData(f"{path} is missing, expected {what}")


def of_sequence(path: Path, sequence: str) -> Path:
    """Return a path with the name of a sequence in its place."""
    return Path(str(path).replace(SEQUENCE, sequence))
