"""The schemas of protocol.json, cell.json, datasets.json and the kept npz files: what is not so is refused by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from geovp_classic import files
from geovp_classic.errors import BadData

TEXTS, NUMBER = "a list of texts", (int, float)
PROTOCOL: dict[str, Any] = {"cells": TEXTS, "clips": TEXTS, "name": str, "metrics": dict, "num_past": int}
PROTOCOL |= {"num_future": int, "stride": int, "size_px": list, "dataset": dict, "versions": dict, "fingerprint": str}
PROTOCOL |= {"id": str, "dataset_name": str, "split_hash": str}
CELL: dict[str, Any] = {"label": str, "kind": str, "status": str, "grants": TEXTS, "num_samples": int}
CELL |= {"num_clips": int, "seconds": dict, "fingerprint": str, "components": dict}
CELL_MAY_HAVE: dict[str, Any] = {"reason": str, "num_failed": int, "num_outdated": int, "code": str}
CELL_MAY_HAVE |= {"peak_memory_mb": NUMBER, "peak_is_own": bool}
POSES = {"world_from_cam": ("f", 3), "past": ("f", 3), "futures": ("f", 4)}
TIMES = {"times_s": ("f", 1), "past_times_s": ("f", 1), "is_metric": ("b", 0)}
PREDICTION = {"frames": ("u1", 5), "covered": ("b", 4), "tracked": ("b", 1), **POSES, **TIMES}
PREDICTION |= {"scale_uncertainty": ("f", 0)}
CLIP = {"frames": ("u1", 4), "intrinsics": ("f", 1), "depths": ("f", 3), "moving": ("b", 3), **POSES, **TIMES}
CLIP |= {"camera_height_m": ("f", 0)}


class Record(dict[str, Any]):
    """A JSON object whose missing keys are named, with their file, when they are asked for."""

    def __init__(self, path: Path, content: Mapping[str, Any]) -> None:
        """The content of a file."""
        super().__init__(content)
        self.path = path

    def __missing__(self, key: str) -> Any:
        """BadData instead of KeyError."""
        raise BadData(f"{self.path} has no {key!r}: restore it, or remove it and run again")


def protocol(path: Path) -> dict[str, Any]:
    """The content of a protocol.json."""
    if not path.exists():
        raise BadData(f"{path.parent} has no {path.name}: not a results folder: give one that `geovp run` wrote")
    content = _read(path, {"cells": TEXTS}, PROTOCOL)
    for name in content["cells"]:
        files.check_name(name, f"{path}: the cell")
    return content


def cell(path: Path) -> dict[str, Any]:
    """The content of a cell.json."""
    return _read(path, CELL, CELL_MAY_HAVE)


def labels(path: Path) -> list[str]:
    """The labels in a datasets.json."""
    found: list[str] = _read(path, {"datasets": TEXTS}, {})["datasets"]
    for label in found:
        files.check_name(label, f"{path}: the data set")
    return found


def arrays(path: Path, kinds: Mapping[str, tuple[str, int]], *needed: str) -> dict[str, Any]:
    """The arrays of a kept clip or prediction."""
    if not path.exists():
        raise BadData(f"{path} does not exist: only the predictions of a few clips are kept, see --keep")
    found = files.read_npz(path)
    for name, array in found.items():
        kind, axes = kinds.get(name, ("", 0))
        own = "f" if array.dtype.kind in "fiu" and kind == "f" else array.dtype.kind
        right = kind in (own, array.dtype.str[1:]) and array.ndim == axes
        if not right or (kind == "f" and name != "depths" and not np.isfinite(array).all()):
            expected = f"{kind} with {axes} axes, finite" if kind else f"one of {', '.join(kinds)}"
            raise BadData(f"{path}: {name} is {array.dtype} {array.shape}, expected {expected}: remove it, run again")
    given = [name for name in ("past", "past_times_s", "futures", "tracked") if name in found]
    lacking = [name for name in needed if name not in found]
    if lacking or len(given) not in (0, 4) or (len(given) == 4 or "world_from_cam" in found) != ("is_metric" in found):
        raise BadData(f"{path} holds {', '.join(found) or 'nothing'} and lacks the rest: remove it and run again")
    if len(found.get("intrinsics", range(6))) != 6:
        raise BadData(f"{path}: {len(found['intrinsics'])} intrinsics, expected 6: remove it and run again")
    return found


def is_whole(path: Path) -> bool:
    """Whether a kept npz file is as it was written."""
    try:
        files.read_npz(path)
    except BadData:
        return False
    return True


def _read(path: Path, needed: Mapping[str, Any], known: Mapping[str, Any]) -> Record:
    content = Record(path, files.read_json(path))
    for key, kind in {**known, **needed}.items():
        if key in needed or key in content:
            _check(path, key, content[key], kind)
    return content


def _check(path: Path, key: str, value: Any, kind: Any) -> None:
    if kind == TEXTS:
        right = isinstance(value, list) and all(isinstance(each, str) for each in value)
    else:
        right = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
    if not right:
        expected = kind if isinstance(kind, str) else getattr(kind, "__name__", "a number")
        raise BadData(f"{path}: {key} is {str(value)[:60]!r}, expected {expected}: restore it, or remove it, run again")
