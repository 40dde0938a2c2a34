"""Results on disk: the only module that knows where which file is.

    <root>/protocol.json                      data set, clip names, sizes, metrics, versions
    <root>/clips/<clip>.<id>.npz              kept clips, by the id of the protocol's fingerprint
    <root>/<method>/method.json               components, privileged inputs, status; see Method
    <root>/<method>/scores/part-<hash>.parquet  a row per clip, sample, step and metric
    <root>/<method>/predictions/<clip>.<id>.npz  kept predictions, by the method's fingerprint
    <root>/tables  plots  recordings  report.html
    <root>/datasets.json                      of several data sets: their labels
    <root>/<label>/                           of several data sets: each as above

Files are written next to their destination and renamed. Scores are stored by clip name, in one
file per batch until a run ends; the name of a score file holds a hash of its content. Files of
earlier settings stay, and count again with these settings.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote, unquote

import duckdb
from filelock import FileLock, Timeout

from geovp_benchmarks.results import kept_files, records
from geovp_benchmarks.results.records import Method
from geovp_benchmarks.results.score_files import Part, ScoreFiles, newest
from geovp_benchmarks.results.scores import Scores
from geovp_classic import files
from geovp_classic.data.atomic import write_bytes
from geovp_classic.errors import BadData, nearest
from geovp_classic.types import Clip, FloatArray, Prediction

__all__ = ["NOT_METHODS", "Method", "Part", "Results", "Scores", "check_clip_name"]

NOT_METHODS = ("clips", "scores", "tables", "plots", "recordings")
T = TypeVar("T")


@dataclass(frozen=True)
class Results:
    """A results folder, read and written."""

    root: Path
    subset: frozenset[str] | None = None  # of the clips, all that is read of them; None: all
    label: str = ""  # of the subset, for people
    selected: tuple[str, ...] = ()  # labels of methods, in this order; empty: all

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
        return {label: replace(self, root=self.root / label) for label in labels} or {"": self}

    @property
    def begun(self) -> bool:
        """Return whether a protocol was written."""
        return (self.root / "protocol.json").exists()

    def methods(self) -> list[Method]:
        """Return the selected methods; of all that have been begun, in the matrix file's order."""
        begun = map(self.method, self.protocol()["methods"])
        methods = {method.label: method for method in begun if method is not None}
        for label in self.selected:
            if label not in methods:
                raise BadData(f"no method is called {label!r}{nearest(label, methods)}")
        return [methods[label] for label in self.selected or methods]

    def select(self, *labels: str) -> Results:
        """Return the results of the methods with these labels; of all methods without labels."""
        return replace(self, selected=labels)

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
        clips = self.protocol()["clips"]
        return self._reread(lambda: self.score_files.scores(self._sound(method), clips))

    def means(self, method: str, num_steps: int | None = None) -> dict[str, FloatArray]:
        """Return means over all or the first steps [N, S] by metric, in the protocol's order."""
        clips = self.protocol()["clips"]
        return self._reread(lambda: self.score_files.means(self._sound(method), clips, num_steps))

    def failures(self, method: str) -> dict[str, str]:
        """Return why clips could not be predicted; they are scored as copies of the last frame."""
        return {
            clip: reason
            for part in self.parts(method)
            for clip, (_, reason, _) in part.failures.items()
        }

    def clip_facts(self) -> dict[str, dict[str, float]]:
        """Return numbers that are known of the clips themselves, by clip and name."""
        protocol = self.protocol()
        parts = [part for name in protocol["methods"] for part in self.parts(name)]
        facts = {clip: part.facts[clip] for part in parts for clip in part.facts}
        return {clip: facts[clip] for clip in protocol["clips"] if clip in facts}

    def predictions(self, method: str, fingerprint: str = "") -> list[tuple[str, Path]]:
        """Return (clip name, file) of the kept predictions of a method."""
        return _named(self._prediction(method, "*", fingerprint))

    def prediction(self, method: str, clip: str) -> Prediction:
        """Return a kept prediction."""
        return kept_files.read(self._prediction(method, quoted(clip)), Prediction)

    def clips(self, fingerprint: str = "") -> list[tuple[str, Path]]:
        """Return (clip name, file) of the kept clips."""
        return _named(self._clip("*", fingerprint))

    def clip(self, name: str) -> Clip:
        """Return a kept clip, past and future, without full and right frames."""
        return kept_files.read(self._clip(quoted(name)), Clip)

    def parts(self, method: str, fingerprint: str = "") -> list[Part]:
        """Return how the clips of a method were scored; without damaged files.

        Those of the method as it is now, or of another fingerprint.
        """
        stored = self._reread(lambda: self._stored(method, fingerprint))
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

    def _stored(self, method: str, fingerprint: str = "") -> dict[Path, list[Part]]:
        """Return the newest parts of the protocol's clips by file."""
        fingerprint = fingerprint or self._fingerprint(method)
        fitting = {
            path: [part for part in parts or () if part.fingerprint == fingerprint]
            for path, parts in self.score_files.parts(method).items()
        }
        return newest(fitting, self.protocol()["clips"] if self.begun else [])

    def _fingerprint(self, method: str) -> str:
        """Return the fingerprint of a method as it is now."""
        stored = self.root / method / "method.json"
        return records.read_method(stored).fingerprint if stored.exists() else ""

    def _prediction(self, method: str, stem: str, fingerprint: str = "") -> Path:
        """Return the file of a prediction of the method as it is now or of a fingerprint."""
        name = f"{stem}.{(fingerprint or self._fingerprint(method))[:8]}.npz"
        return self.root / method / "predictions" / name

    def _clip(self, stem: str, fingerprint: str = "") -> Path:
        """Return the file of a clip of the protocol as it is now or of a fingerprint."""
        if not fingerprint and self.begun:
            fingerprint = str(self.protocol().get("fingerprint", ""))
        return self.root / "clips" / f"{stem}.{fingerprint[:8]}.npz"

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
        return self.root / "recordings" / f"{quoted(clip)}.rrd"

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
        """Merge the score files of a method into one; those of other clips and settings stay."""
        with suppress(Timeout, NotImplementedError), FileLock(self.root / ".merge.lock", timeout=0):
            self.score_files.merge(method, self._fingerprint(method))

    def write_prediction(self, method: str, clip: str, prediction: Prediction) -> None:
        """Keep a prediction."""
        kept_files.write(self._prediction(method, quoted(clip)), prediction)

    def write_clip(self, clip: Clip) -> None:
        """Keep a clip, so that images and new scores need no data set."""
        kept_files.write(self._clip(quoted(clip.name)), clip)

    def size_bytes(self, method: str, folder: str) -> int:
        """Return the size of a method's folder `scores` or `predictions`."""
        return sum(path.stat().st_size for path in (self.root / method / folder).glob("*"))

    def set_damaged_aside(self, method: str | None) -> list[Path]:
        """Rename damaged score files and predictions of a method, or of None damaged clips."""
        kept = self.clips() if method is None else self.predictions(method)
        parts = [] if method is None else self.damaged_parts(method)
        damaged = [*parts, *(path for _, path in kept if not kept_files.is_whole(path))]
        for path in damaged:
            path.rename(path.with_name(f"{path.name}.damaged"))
        return damaged

    def discard(self, method: str) -> None:
        """Remove scores and predictions of a method as it is now; those of other settings stay."""
        fingerprint = self._fingerprint(method)
        folder = self.root / method / "scores"
        paths = [path for _, path in self.predictions(method)]
        for path, parts in self.score_files.parts(method).items():
            fingerprints = {part.fingerprint for part in parts or ()}
            if path.parent == folder and fingerprints == {fingerprint}:
                paths.append(path)
        for path in paths:
            path.unlink(missing_ok=True)

    def remove_method(self, method: str) -> None:
        """Remove a method with all its rows and predictions."""
        shutil.rmtree(self.root / method, ignore_errors=True)


def quoted(clip: str) -> str:
    """Return the part of a file name from which the name of a clip can be recovered."""
    return quote(clip, safe="+@=, ")


def check_clip_name(clip: str) -> None:
    """Raise BadData for a name of a clip that its kept files cannot have."""
    files.check_name(clip, "the clip")
    max_bytes = 225  # of 255 that file systems allow: scratch files have longer names
    if len(quoted(clip)) > max_bytes:
        raise BadData(
            f"the clip {clip[:40]!r}... takes {len(quoted(clip))} bytes as a file's name, where "
            f"letters beyond English count 3 to 12: give its sequence a name of {max_bytes} at most"
        )


def _named(pattern: Path) -> list[tuple[str, Path]]:
    """Return (clip name, file) of the files that match a pattern."""
    paths = sorted(pattern.parent.glob(pattern.name))
    end = pattern.name.removeprefix("*")
    return [
        (unquote(path.name.removesuffix(end)), path)
        for path in paths
        if not path.name.startswith(".")
    ]
