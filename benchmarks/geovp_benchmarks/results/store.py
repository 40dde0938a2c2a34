"""Results on disk: the only module that knows where which file is, and writes them so that a kill
loses nothing.

    <root>/protocol.json                  data set, clip names, sizes, metrics, versions
    <root>/clips/<clip>.npz               the kept clips themselves: frames, camera, trajectory,
    depths where known
    <root>/<method>/method.json             components, privileged inputs, status, seconds per
    stage, peak memory; see Method
    <root>/<method>/scores/part-<hash>.parquet  one row per clip, sample, step and metric
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

from geovp_benchmarks.results import kept_files, records
from geovp_benchmarks.results.records import Method
from geovp_benchmarks.results.score_files import Part, ScoreFiles, Stored, newest
from geovp_benchmarks.results.scores import Scores
from geovp_classic import files
from geovp_classic.data.atomic import write_bytes
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, FloatArray, Prediction

__all__ = ["NOT_METHODS", "Method", "Part", "Results", "Scores", "check_clip_name"]

EARLIER = "earlier"
NOT_METHODS = ("clips", "scores", "tables", "plots", "recordings", EARLIER)
T = TypeVar("T")


@dataclass(frozen=True)
class Results:
    """A results folder, read and written."""

    root: Path
    subset: frozenset[str] | None = None  # of the clips, all that is read of them; None: all
    label: str = ""  # of the subset, for people

    # Reading

    def protocol(self) -> dict[str, Any]:
        """Return what all methods share; see records.Protocol."""
        if "" not in (labelled := self.by_dataset()):
            raise BadData(
                f"{self.root} holds several data sets: give one, such as "
                f"{self.root / min(labelled)}"
            )
        protocol = records.read_protocol(self.root / "protocol.json")
        if self.subset is not None:
            clips = [clip for clip in protocol["clips"] if clip in self.subset]
            name = f"{protocol['name']}, {self.label} (n = {len(clips)})"
            protocol |= {"name": name, "clips": clips}
        return protocol

    def by_dataset(self) -> dict[str, Results]:
        """Return the results of each data set by its label; of a single one by the label ""."""
        path = self.root / "datasets.json"
        labels = records.read_labels(path) if path.exists() else []
        return {label: Results(self.root / label) for label in labels} or {"": self}

    @property
    def begun(self) -> bool:
        """Return whether a protocol was written."""
        return (self.root / "protocol.json").exists()

    def methods(self) -> list[Method]:
        """Return all methods that have been begun, in the order of the matrix file."""
        return [
            method
            for name in self.protocol()["methods"]
            if (method := self.method(name)) is not None
        ]

    def method(self, name: str) -> Method | None:
        """Return a method; None if it has not been begun."""
        path = self.root / name / "method.json"
        if not path.exists():
            return None
        method = records.read_method(path)
        if self.subset is not None:
            num_clips = sum(len(part.clips) for part in self.parts(name))
            counts = {"num_clips": num_clips, "num_failed": len(self.failures(name))}
            method = method.model_copy(update=counts)
        return method

    @cached_property
    def score_files(self) -> ScoreFiles:
        """Return the score files of all methods, opened once."""
        return ScoreFiles(self.root)

    def scores(self, method: str) -> Scores:
        """Return all scores of the protocol's clips; raise BadData if a score file is damaged."""

        def read() -> Scores:
            stored = self._sound(method)
            return self.score_files.scores(stored, self._clips(stored))

        return self._reread(read)

    def means(self, method: str, num_steps: int | None = None) -> dict[str, FloatArray]:
        """Return means over all or the first steps [N, S] by metric, in the protocol's order."""

        def read() -> dict[str, FloatArray]:
            stored = self._sound(method)
            return self.score_files.means(stored, self._clips(stored), num_steps)

        return self._reread(read)

    def failures(self, method: str) -> dict[str, str]:
        """Return why clips could not be predicted; they are scored as copies of the last frame."""
        return {
            clip: reason
            for part in self.parts(method)
            for clip, (_, reason, _) in part.failures.items()
        }

    def clip_facts(self) -> dict[str, dict[str, float]]:
        """Return numbers that are known of the clips themselves, by clip and name."""

        def read() -> dict[str, dict[str, float]]:
            protocol = self.protocol()
            paths = [path for name in protocol["methods"] for path in self._stored(name)]
            facts = self.score_files.facts(paths)
            return {clip: facts[clip] for clip in protocol["clips"] if clip in facts}

        return self._reread(read)

    def predictions(self, method: str) -> list[tuple[str, Path]]:
        """Return (clip name, file) of the kept predictions of a method."""
        return _named(self.root / method / "predictions")

    def prediction(self, method: str, clip: str) -> Prediction:
        """Return a kept prediction."""
        return kept_files.read(self.root / method / "predictions" / _file(clip), Prediction)

    def clips(self) -> list[tuple[str, Path]]:
        """Return (clip name, file) of the kept clips."""
        return _named(self.root / "clips")

    def clip(self, name: str) -> Clip:
        """Return a kept clip, past and future, without full and right frames."""
        return kept_files.read(self.root / "clips" / _file(name), Clip)

    def parts(self, method: str) -> list[Part]:
        """Return how the clips of the method as it is now were scored; without damaged files."""
        stored = self._reread(lambda: self._stored(method))
        return [part for parts in stored.values() for part in parts]

    def damaged_parts(self, method: str) -> list[Path]:
        """Return the score files that are not as they were written."""
        stored = self._reread(lambda: self.score_files.parts(method))
        return [path for path, parts in stored.items() if parts is None]

    def _sound(self, method: str) -> dict[Path, list[Part]]:
        """Return the parts that count; raise BadData if a file of the method is damaged."""
        if damaged := self.damaged_parts(method):
            raise BadData(
                f"{damaged[0]} is damaged: `geovp run` sets it aside and computes it again"
            )
        return self._stored(method)

    def _stored(self, method: str, *, only_wanted: bool = True) -> dict[Path, list[Part]]:
        """Return the newest parts by file, of the protocol's or of all clips."""
        path = self.root / method / "method.json"
        fingerprint = records.read_method(path).fingerprint if path.exists() else None
        fitting = {
            path: [part for part in parts or () if part.fingerprint == fingerprint]
            for path, parts in self.score_files.parts(method).items()
        }
        return newest(fitting, self.protocol()["clips"] if only_wanted and self.begun else None)

    def _clips(self, stored: Stored) -> list[str]:
        """Return the clips of the protocol; without one, those with scores."""
        if self.begun:
            clips: list[str] = self.protocol()["clips"]
            return clips
        return [clip for parts in stored.values() for part in parts for clip in part.clips]

    def _reread(self, read: Callable[[], T], max_tries: int = 5) -> T:
        """Return what is read, again where a run has merged files meanwhile."""
        for _ in range(max_tries - 1):
            with suppress(FileNotFoundError, duckdb.IOException):
                return read()
        return read()

    @property
    def tables(self) -> Path:
        """Return the folder of written tables."""
        return self.root / "tables"

    @property
    def plots(self) -> Path:
        """Return the folder of figures."""
        return self.root / "plots"

    @property
    def report(self) -> Path:
        """Return the file of the one-page report."""
        return self.root / "report.html"

    def recording(self, clip: str) -> Path:
        """Return the file of the Rerun recording of a kept clip."""
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
        """Write the method.json of a method."""
        write_bytes(self.root / name / "method.json", files.json_bytes(record))

    def write_part(self, method: str, scores: Scores, part: Part) -> None:
        """Write all scores of the clips of a part."""
        self.score_files.write(method, [(scores, part)])

    def write_parts(self, method: str, scored: Sequence[tuple[Scores, Part]]) -> None:
        """Write the scores of several parts into one file."""
        self.score_files.write(method, scored)

    def merge(self, method: str) -> None:
        """Merge the score files of a method into one; scores of clips no longer wanted stay."""
        with suppress(Timeout, NotImplementedError), FileLock(self.root / ".merge.lock", timeout=0):
            # A file that another run writes from here on is not removed.
            stored = self.score_files.parts(method)
            folder = self.root / method / "scores"  # a file that methods share stays
            sound = [p for p, parts in stored.items() if parts is not None and p.parent == folder]
            if len(sound) > 1:
                newest_parts = self._stored(method, only_wanted=False)
                self.score_files.merge(method, newest_parts, sound)

    def write_prediction(self, method: str, clip: str, prediction: Prediction) -> None:
        """Keep a prediction."""
        kept_files.write(self.root / method / "predictions" / _file(clip), prediction)

    def write_clip(self, clip: Clip) -> None:
        """Keep a clip, so that images and new scores need no data set."""
        kept_files.write(self.root / "clips" / _file(clip.name), clip)

    def swap(self, name: str, before: str, now: str) -> None:
        """Set a method or the kept clips of a fingerprint aside; bring back those of another."""
        current = self.root / name
        aside, earlier = (self._earlier(each) / name for each in (before, now))
        if not any(path.suffix in (".parquet", ".npz") for path in current.rglob("*")):
            shutil.rmtree(current, ignore_errors=True)
        if current.exists():
            shutil.rmtree(aside, ignore_errors=True)
            aside.parent.mkdir(parents=True, exist_ok=True)
            current.rename(aside)
        if earlier.exists():
            earlier.rename(current)

    def with_rows_of(self, method: str, fingerprint: str) -> Results:
        """Return the folder with the scores of a fingerprint: this or an earlier one."""
        now = self.method(method)
        return (
            self if now and now.fingerprint == fingerprint else Results(self._earlier(fingerprint))
        )

    def with_clips_of(self, fingerprint: str) -> Results:
        """Return the folder with the kept clips of a protocol's fingerprint."""
        is_now = self.begun and self.protocol()["fingerprint"] == fingerprint
        return self if is_now else Results(self._earlier(fingerprint))

    def size_bytes(self, method: str, folder: str) -> int:
        """Return the size of a method's folder `scores` or `predictions`."""
        return sum(path.stat().st_size for path in (self.root / method / folder).glob("*"))

    def set_aside(self) -> set[Path]:
        """Return what is kept of other settings."""
        return set((self.root / EARLIER).glob("*/*"))

    def _earlier(self, fingerprint: str) -> Path:
        """Return the folder of a fingerprint that was set aside."""
        return self.root / EARLIER / (fingerprint[:16] or "unknown")

    def set_damaged_aside(self, method: str | None) -> list[Path]:
        """Rename damaged score files and predictions of a method, or of None damaged clips."""
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
    """Return a file name from which the clip's name can be recovered."""
    return quote(clip, safe="+@=, ") + ".npz"


def check_clip_name(clip: str) -> None:
    """Raise BadData for a name of a clip that its kept files cannot have."""
    files.check_name(clip, "the clip")
    max_bytes = 230  # of 255 that file systems allow: scratch files have longer names
    if len(_file(clip)) > max_bytes:
        size = (
            f"{len(_file(clip))} bytes as a file's name, where letters beyond English count 3 to 12"
        )
        raise BadData(
            f"the clip {clip[:40]!r}... takes {size}: give its sequence a name of "
            f"{max_bytes} at most"
        )


def _named(folder: Path) -> list[tuple[str, Path]]:
    """Return (clip name, file) of the npz files of a folder."""
    return [(unquote(path.stem), path) for path in sorted(folder.glob("[!.]*.npz"))]
