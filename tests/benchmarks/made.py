"""What tests of the harness are made of: matrix files, runs of toy components, stored rows, and
cameras.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import street

from geovp.display.source import Source
from geovp_benchmarks.matrix import schema
from geovp_benchmarks.results.store import Method, Results, ScoreRecord, Scores
from geovp_benchmarks.running.executors import Executor, Serial
from geovp_benchmarks.running.plan import Plan
from geovp_benchmarks.running.run import run
from geovp_classic.data.recordings.windows import Recording
from geovp_classic.types import ByteArray, FloatArray

METRICS = {"frame": ["toy-difference"], "trajectory": ["toy-gap"]}
STILL = {"still": {"name": "toy-still"}}


def content(
    dataset: dict[str, Any] | None = None, metrics: Any = METRICS, **tables: Any
) -> dict[str, Any]:
    """The tables of a matrix of toys: three frames of 8x8 are seen, the next two predicted."""
    own = {"name": "toy-road", **(dataset or {})}
    protocol = {"dataset": own, "num_past": 3, "num_future": 2, "size_px": [8, 8], "stride": 1}
    return {"protocol": protocol, "metrics": metrics, **tables}


def crossed(log: Path, step_m: float = 1.0) -> dict[str, Any]:
    """Two pose sources and two renderers that note what they do."""
    sources = {
        name: {"name": "toy-steady", "step_m": step_m, "log": str(log)} for name in ("a", "b")
    }
    renderers = {name: {"name": "toy-slide", "log": str(log)} for name in ("r", "q")}
    return {"pose_sources": sources, "renderers": renderers}


def toml(value: Any) -> str:
    """A value as a matrix file has it."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {toml(each)}' for key, each in value.items())} }}"
    return f"[{', '.join(map(toml, value))}]" if isinstance(value, list) else json.dumps(value)


def write_matrix(path: Path, tables: dict[str, Any]) -> Path:
    """A matrix file of these tables."""
    lines = [
        line
        for name, table in tables.items()
        for line in (f"[{name}]", *(f"{k} = {toml(v)}" for k, v in table.items()))
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def go(
    root: Path,
    tables: dict[str, Any],
    executor: Executor | None = None,
    selected: tuple[str, ...] = (),
    **options: Any,
) -> dict[str, Method]:
    """Run a matrix; its methods by name."""
    parsed = schema.parse("m", tables).select(*selected)
    return {
        method.name: method
        for method in run(Plan(parsed, Results(root), **options), executor or Serial())
    }


def rows(root: Path, method: str) -> list[dict[str, Any]]:
    """All stored rows of a method."""
    return dicts(Results(root).scores(method))


def dicts(scores: Scores) -> list[dict[str, Any]]:
    """Return each score by the names of the columns, without those that are not defined."""
    names = ("clip", "sample", "step", "metric", "value")
    return [dict(zip(names, row, strict=True)) for row in scores.rows() if row[-1] == row[-1]]


def values(root: Path, method: str, metric: str) -> list[float]:
    """The stored values of one metric."""
    return [row["value"] for row in rows(root, method) if row["metric"] == metric]


def scores(rows: Iterable[Sequence[Any]]) -> Scores:
    """Return the scores in rows (clip, sample, step, metric, value)."""
    rows = list(rows)
    clips = list(dict.fromkeys(clip for clip, *_ in rows))
    num_samples = max((row[1] for row in rows), default=-1) + 1
    num_steps = max((row[2] for row in rows), default=0)
    values: dict[str, FloatArray] = {}
    for clip, sample, step, metric, value in rows:
        empty = np.full((len(clips), num_samples, num_steps), np.nan)
        values.setdefault(metric, empty)[clips.index(clip), sample, step - 1] = value
    return Scores(clips, values)


def write_row(
    results: Results,
    name: str,
    lines: Iterable[tuple[str, int, int, str, float | None]] = (),
    facts: Any = None,
    shown_by: Any = None,
    **record: Any,
) -> None:
    """Store a method that is done, with its rows in one file; facts are those of clips."""
    lines = list(lines)
    clips = list(dict.fromkeys(clip for clip, *_ in lines))
    own = {
        "label": name.replace("--", " + "),
        "status": "done",
        "privileged_inputs": [],
        "num_samples": 1,
    }
    own |= {"components": {}, "fingerprint": "f"}
    results.write_method(Method(name=name, **{**own, **record}))
    if lines:
        own_record = ScoreRecord(name, clips, "f", facts=facts or {}, shown_by=shown_by or {})
        results.write_scores([(scores(lines), own_record)])


def write_protocol(
    results: Results, methods: Iterable[str], clips: Iterable[str], **more: Any
) -> None:
    """Store a protocol called demo, of ten frames seen and twenty predicted."""
    shared = {
        "name": "demo",
        "id": "d3m0",
        "dataset_name": "road",
        "dataset": {"name": "road"},
        "num_past": 10,
        "num_future": 20,
        "stride": 5,
        "split_hash": "",
        "metrics": {},
        "versions": {},
        "fingerprint": "",
    }
    results.write_protocol(
        {**shared, "size_px": [64, 48], "methods": [*methods], "clips": [*clips], **more}
    )


def rows_of(lines: list[str]) -> dict[str, list[str]]:
    """Return the cells of the rows of Markdown tables by their first cell; the first table wins."""
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if "|" in line]
    return {first: rest for first, *rest in reversed(cells)}


def write_images(folder: Path, frames: ByteArray, digits: int = 6) -> None:
    """Frames [T, H, W, 3] as numbered PNG files."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{number:0{digits}d}.png"), frame[..., ::-1])


class Frames:
    """Frames in memory, read like files."""

    def __init__(self, frames: ByteArray) -> None:
        self.frames = frames

    def __len__(self) -> int:
        return len(self.frames)

    def read(self, index: int) -> ByteArray:
        """Return one frame [H, W, 3]."""
        return self.frames[index]

    def digest(self, index: int) -> bytes:
        """Return the content of a frame."""
        return self.frames[index].tobytes()


def street_source(frames: ByteArray, times_s: FloatArray | None = None) -> Source:
    """Return a recording of the small street's camera for `geovp display`, by default at 10 Hz."""
    clip = street.clip()
    if times_s is None:
        times_s = 20 + 0.1 * np.arange(len(frames))
    recording = Recording(
        "street",
        Frames(frames),
        times_s,
        clip.intrinsics,
        camera_height_m=clip.camera_height_m,
    )
    return Source(recording, range(len(frames)), frames.shape[2:0:-1])
