"""Results on disk: the only module that knows where which file is, and writes them so that a kill
loses nothing.

    <root>/protocol.json                  data set, clip names, sizes, metrics, versions
    <root>/clips/<clip>.npz               the kept clips themselves: frames, camera, trajectory,
    depths where known
    <root>/<method>/method.json             components, privileged inputs, status, seconds per
    stage, peak memory; see Method
    <root>/<method>/scores/part-<hash>.parquet  one row per clip, sample, step and metric; see Rows
    <root>/<method>/predictions/<clip>.npz  the kept predictions
    <root>/earlier/<fingerprint>/         methods and clips of other settings, which come back with
    these
    <root>/tables  plots  recordings  report.html     views of the above
    <root>/datasets.json                  of several data sets: their labels, each with a folder
    <root>/<label> as above

Files are written next to their destination and renamed. Scores are stored by clip name, in one
file per task until a run ends; the name of a score file holds a hash of its content.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote, unquote

import duckdb
from filelock import FileLock, Timeout

from geovp_benchmarks.results import kept_files, record_files
from geovp_benchmarks.results.record_files import Method
from geovp_benchmarks.results.rows import Rows
from geovp_benchmarks.results.score_files import Part, ScoreFiles, Stored, newest
from geovp_classic import files
from geovp_classic.data.atomic import write_bytes
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Prediction

__all__ = ["EARLIER", "NOT_METHODS", "Method", "Part", "Results", "Rows", "check_clip_name"]

EARLIER = "earlier"
MAX_NAME_BYTES = 230  # of 255 that file systems allow: scratch files have longer names
NOT_METHODS = ("clips", "scores", "tables", "plots", "recordings", EARLIER)


MAX_TRIES = 5  # to read files that a run is merging
T = TypeVar("T")


@dataclass(frozen=True)
class Results:
    """A results folder, read and written."""

    root: Path

    # Reading

    def protocol(self) -> dict[str, Any]:
        """What all methods share: name, dataset, clips (names, in order), num_past, num_future,
        size_px, stride, metrics.

        `metrics` maps each name to {role: "frame" | "trajectory", unit, higher_is_better (null:
        neither), bounds [low, high] (null: none), unavailable: why or null}; a stored row's metric
        is such a name, or one with a pixel set behind it: "psnr@covered".
        """
        if "" not in (apart := self.by_dataset()):
            raise BadData(
                f"{self.root} holds several data sets: give one, such as {self.root / min(apart)}"
            )
        return record_files.protocol(self.root / "protocol.json")

    def by_dataset(self) -> dict[str, Results]:
        """The results of each data set by its label; of one alone, these with the label ""."""
        path = self.root / "datasets.json"
        labels = record_files.labels(path) if path.exists() else []
        return {label: Results(self.root / label) for label in labels} or {"": self}

    @property
    def begun(self) -> bool:
        """Whether a protocol was written."""
        return (self.root / "protocol.json").exists()

    def methods(self) -> list[Method]:
        """All methods that have been begun, in the order of the matrix file."""
        return [
            method
            for name in self.protocol()["methods"]
            if (method := self.method(name)) is not None
        ]

    def method(self, name: str) -> Method | None:
        """One method, None when it has not been begun."""
        path = self.root / name / "method.json"
        return record_files.method(path) if path.exists() else None

    @cached_property
    def score_files(self) -> ScoreFiles:
        """The score files of all methods, opened once."""
        return ScoreFiles(self.root)

    def scores(self, method: str) -> Rows:
        """The rows of one method; BadData when a score file is damaged."""
        return self._reread(lambda: self._scores(method))

    def _scores(self, method: str) -> Rows:
        if damaged := self.damaged_parts(method):
            raise BadData(
                f"{damaged[0]} is damaged: `geovp run` sets it aside and computes it again"
            )
        return self.score_files.rows(self._stored(method))

    def failures(self, method: str) -> dict[str, str]:
        """Why clips could not be predicted, by the clip's name; their rows are those of a copy of
        the last frame.
        """
        return {
            clip: reason
            for part in self.parts(method)
            for clip, (_, reason, _) in part.failures.items()
        }

    def clip_facts(self) -> dict[str, dict[str, float]]:
        """What is known of the clips themselves: numbers by name, by clip."""
        names = [method.name for method in self.methods()]
        return self._reread(lambda: self.score_files.facts(names))

    def predictions(self, method: str) -> list[tuple[str, Path]]:
        """(clip name, file) of the predictions that were kept of one method."""
        return _named(self.root / method / "predictions")

    def prediction(self, method: str, clip: str) -> Prediction:
        """One kept prediction: frames [S, F, H, W, 3], covered [S, F, H, W] or None, motion or
        None.
        """
        return kept_files.read_prediction(self.root / method / "predictions" / _file(clip))

    def clips(self) -> list[tuple[str, Path]]:
        """(clip name, file) of the clips that were kept."""
        return _named(self.root / "clips")

    def clip(self, name: str) -> Clip:
        """One kept clip, past and future: frames, camera, trajectory, depths, moving; never wide or
        right frames.
        """
        return kept_files.read_clip(self.root / "clips" / _file(name), name)

    def parts(self, method: str) -> list[Part]:
        """How the clips of the method as it is now were scored; a damaged file counts as absent."""
        stored = self._reread(lambda: self._stored(method))
        return [part for parts in stored.parts.values() for part in parts]

    def damaged_parts(self, method: str) -> list[Path]:
        """The score files that are not as they were written."""
        stored = self._reread(lambda: self.score_files.parts(method))
        return [path for path, parts in stored.items() if parts is None]

    def _stored(self, method: str, *, only_wanted: bool = True) -> Stored:
        """The newest scores of the protocol's clips; without a protocol, of all clips."""
        now, clips = self.method(method), None
        if only_wanted and self.begun:
            clips = record_files.protocol(self.root / "protocol.json").get("clips")
        fingerprint = None if now is None else now.fingerprint
        fitting = {
            path: [part for part in parts or () if part.fingerprint == fingerprint]
            for path, parts in self.score_files.parts(method).items()
        }
        return newest(fitting, clips)

    def _reread(self, read: Callable[[], T]) -> T:
        """Return what is read, again where a run has merged files meanwhile."""
        for _ in range(MAX_TRIES - 1):
            with suppress(FileNotFoundError, duckdb.IOException):
                return read()
        return read()

    @property
    def tables(self) -> Path:
        """The folder of written tables."""
        return self.root / "tables"

    @property
    def plots(self) -> Path:
        """The folder of figures."""
        return self.root / "plots"

    @property
    def report(self) -> Path:
        """The one-page report."""
        return self.root / "report.html"

    def recording(self, clip: str) -> Path:
        """The Rerun recording of a kept clip."""
        return self.root / "recordings" / f"{_file(clip).removesuffix('.npz')}.rrd"

    # Writing

    def write_datasets(self, labels: Sequence[str]) -> None:
        """Write the labels of several data sets; of one, remove what was written of several."""
        if any(labels):
            write_bytes(self.root / "datasets.json", files.json_bytes({"datasets": list(labels)}))
        else:
            (self.root / "datasets.json").unlink(missing_ok=True)

    def write_protocol(self, protocol: Mapping[str, Any]) -> None:
        """Write protocol.json."""
        write_bytes(self.root / "protocol.json", files.json_bytes(protocol))

    def write_method(self, name: str, record: Mapping[str, Any]) -> None:
        """Write a method's method.json."""
        write_bytes(self.root / name / "method.json", files.json_bytes(record))

    def write_part(self, method: str, rows: Rows, part: Part) -> None:
        """Write all rows of the part's clips at once."""
        self.score_files.write(method, rows, part)

    def merge(self, method: str) -> None:
        """Merge the score files of a method into one; scores of clips no longer wanted stay."""
        with suppress(Timeout, NotImplementedError), FileLock(self.root / ".merge.lock", timeout=0):
            # A file that another run writes from here on is not removed.
            stored = self.score_files.parts(method)
            folder = self.root / method / "scores"  # a file that methods share stays
            sound = [
                path
                for path, parts in stored.items()
                if parts is not None and path.parent == folder
            ]
            if len(sound) > 1:
                self.score_files.merge(method, self._stored(method, only_wanted=False), sound)

    def write_prediction(self, method: str, clip: str, prediction: Prediction) -> None:
        """Keep a prediction."""
        kept_files.write_prediction(self.root / method / "predictions" / _file(clip), prediction)

    def write_clip(self, clip: Clip) -> None:
        """Keep a clip, so that images and new scores need no data set."""
        kept_files.write_clip(self.root / "clips" / _file(clip.name), clip)

    def swap(self, name: str, before: str, now: str) -> None:
        """Set a method or the kept clips of one fingerprint aside, and bring those of another back
        if there are any.
        """
        current, aside, kept = (
            self.root / name,
            self._earlier(before) / name,
            self._earlier(now) / name,
        )
        if not any(path.suffix in (".parquet", ".npz") for path in current.rglob("*")):
            shutil.rmtree(current, ignore_errors=True)
        if current.exists():
            shutil.rmtree(aside, ignore_errors=True)
            aside.parent.mkdir(parents=True, exist_ok=True)
            current.rename(aside)
        if kept.exists():
            kept.rename(current)

    def with_rows_of(self, method: str, fingerprint: str) -> Results:
        """The folder that holds a method's rows of a fingerprint: this one, or that of earlier
        settings.
        """
        now = self.method(method)
        return (
            self if now and now.fingerprint == fingerprint else Results(self._earlier(fingerprint))
        )

    def with_clips_of(self, fingerprint: str) -> Results:
        """The folder that holds the kept clips of a protocol's fingerprint: this one, or that of
        earlier settings.
        """
        is_now = self.begun and self.protocol()["fingerprint"] == fingerprint
        return self if is_now else Results(self._earlier(fingerprint))

    def size_bytes(self, method: str, folder: str) -> int:
        """What the files of a method take in its folder `scores` or `predictions`."""
        return sum(path.stat().st_size for path in (self.root / method / folder).glob("*"))

    def set_aside(self) -> set[Path]:
        """What is kept of other settings."""
        return set((self.root / EARLIER).glob("*/*"))

    def _earlier(self, fingerprint: str) -> Path:
        return self.root / EARLIER / (fingerprint[:16] or "unknown")

    def set_damaged_aside(self, method: str | None) -> list[Path]:
        """Rename a method's damaged parts and predictions, or of None the damaged clips: they are
        computed again.
        """
        kept = self.clips() if method is None else self.predictions(method)
        parts = [] if method is None else self.damaged_parts(method)
        damaged = [*parts, *(path for _, path in kept if not kept_files.is_whole(path))]
        for path in damaged:
            path.rename(path.with_name(f"{path.name}.damaged"))
        return damaged

    def remove_method(self, method: str) -> None:
        """Remove a method with all its rows and predictions."""
        shutil.rmtree(self.root / method, ignore_errors=True)


def _file(clip: str) -> str:
    """A file name from which the clip's name can be recovered."""
    return quote(clip, safe="+@=, ") + ".npz"


def check_clip_name(clip: str) -> None:
    """BadData for a name of a clip that its kept files cannot have."""
    files.check_name(clip, "the clip")
    if len(_file(clip)) > MAX_NAME_BYTES:
        size = (
            f"{len(_file(clip))} bytes as a file's name, where letters beyond English count 3 to 12"
        )
        raise BadData(
            f"the clip {clip[:40]!r}... takes {size}: give its sequence a name of "
            f"{MAX_NAME_BYTES} at most"
        )


def _named(folder: Path) -> list[tuple[str, Path]]:
    return [(unquote(path.stem), path) for path in sorted(folder.glob("[!.]*.npz"))]
