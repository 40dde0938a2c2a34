"""Results on disk: the only module that knows where which file is, and writes them so that a kill
loses nothing.

    <root>/protocol.json                  data set, clip names, sizes, metrics, versions
    <root>/clips/<clip>.npz               the kept clips themselves: frames, camera, trajectory,
    depths where known
    <root>/<cell>/cell.json               components, privileged inputs, status, seconds per stage,
    peak memory; see Cell
    <root>/<cell>/scores/part-00003.parquet   one row per clip, sample, step and metric; see Rows
    <root>/<cell>/predictions/<clip>.npz  the kept predictions
    <root>/earlier/<fingerprint>/         cells and clips of other settings, which come back with
    these
    <root>/tables  plots  recordings  report.html     views of the above
    <root>/datasets.json                  of several data sets: their labels, each with a folder
    <root>/<label> as above

Every file is written beside its place and renamed into it, and has a checksum: npz files zip's, the
others one of their own. A part holds all rows of its clips or does not exist, and holds in its
metadata the clips, the fingerprint, the code hash, the times and the peak memory.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from geovp_benchmarks.results import kept_files, part_files, record_files
from geovp_benchmarks.results.part_files import Part
from geovp_benchmarks.results.record_files import Cell
from geovp_benchmarks.results.rows import Rows
from geovp_classic import files
from geovp_classic.data.atomic import write_bytes
from geovp_classic.errors import BadData
from geovp_classic.types import Clip, Prediction

__all__ = ["EARLIER", "NOT_CELLS", "Cell", "Part", "Results", "Rows", "check_clip_name"]

EARLIER = "earlier"
LIMIT_VALUES = 2**26  # of one metric: clips times samples times steps, 0.5 GB in memory
MAX_NAME_BYTES = 230  # of 255 that file systems allow: scratch files have longer names
NOT_CELLS = ("clips", "tables", "plots", "recordings", EARLIER)


@dataclass(frozen=True)
class Results:
    """A results folder, read and written."""

    root: Path

    # Reading

    def protocol(self) -> dict[str, Any]:
        """What all cells share: name, dataset, clips (names, in order), num_past, num_future,
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

    def cells(self) -> list[Cell]:
        """All cells that have been begun, in the order of the matrix file."""
        return [cell for name in self.protocol()["cells"] if (cell := self.cell(name)) is not None]

    def cell(self, name: str) -> Cell | None:
        """One cell, None when it has not been begun."""
        path = self.root / name / "cell.json"
        return record_files.cell(path) if path.exists() else None

    def scores(self, cell: str) -> Rows:
        """The rows of one cell; BadData when a part is damaged."""
        found = self._read_parts(cell)
        damaged = [path for path, part in found.items() if part is None]
        if damaged:
            raise BadData(
                f"{damaged[0]} is damaged: `geovp run` sets it aside and computes it again"
            )
        rows = Rows.concatenated([*map(part_files.rows, found)])
        clips, samples, steps = rows.extent
        if clips * samples * steps > LIMIT_VALUES:
            extent = f"{clips} clips, {samples} samples and {steps} steps"
            raise BadData(
                f"{self.root / cell} has rows of {extent}, which no run has: remove it and run "
                "again"
            )
        return rows

    def failures(self, cell: str) -> dict[str, str]:
        """Why clips could not be predicted, by the clip's name; their rows are those of a copy of
        the last frame.
        """
        return {
            clip: reason
            for part in self.parts(cell)
            for clip, (_, reason, _) in part.failures.items()
        }

    def clip_facts(self) -> dict[str, Mapping[str, float]]:
        """What is known of the clips themselves: numbers by name, by clip."""
        parts = (part for cell in self.cells() for part in self.parts(cell.name))
        return {clip: facts for part in parts for clip, facts in part.facts.items()}

    def predictions(self, cell: str) -> list[tuple[str, Path]]:
        """(clip name, file) of the predictions that were kept of one cell."""
        return _named(self.root / cell / "predictions")

    def prediction(self, cell: str, clip: str) -> Prediction:
        """One kept prediction: frames [S, F, H, W, 3], covered [S, F, H, W] or None, motion or
        None.
        """
        return kept_files.read_prediction(self.root / cell / "predictions" / _file(clip))

    def clips(self) -> list[tuple[str, Path]]:
        """(clip name, file) of the clips that were kept."""
        return _named(self.root / "clips")

    def clip(self, name: str) -> Clip:
        """One kept clip, past and future: frames, camera, trajectory, depths, moving; never wide or
        right frames.
        """
        return kept_files.read_clip(self.root / "clips" / _file(name), name)

    def parts(self, cell: str) -> list[Part]:
        """The parts on disk that belong to the cell as it is now, by index; an unreadable file
        counts as absent.
        """
        return [part for part in self._read_parts(cell).values() if part]

    def damaged_parts(self, cell: str) -> list[Path]:
        """The part files that are not as they were written."""
        return [path for path, part in self._read_parts(cell).items() if part is None]

    def _read_parts(self, cell: str) -> dict[Path, Part | None]:
        """The parts of the cell as it is now by file, None for a file that is damaged."""
        now = self.cell(cell)
        found = {
            path: part_files.read(path)
            for path in sorted((self.root / cell / "scores").glob("part-*.parquet"))
        }
        return {
            path: part
            for path, part in found.items()
            if not part or (now and part.fingerprint == now.fingerprint)
        }

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

    def write_cell(self, name: str, record: Mapping[str, Any]) -> None:
        """Write a cell's cell.json."""
        write_bytes(self.root / name / "cell.json", files.json_bytes(record))

    def write_part(self, cell: str, rows: Rows, part: Part) -> None:
        """Write all rows of the part's clips at once."""
        part_files.write(self._part(cell, part.index), rows, part)

    def write_prediction(self, cell: str, clip: str, prediction: Prediction) -> None:
        """Keep a prediction."""
        kept_files.write_prediction(self.root / cell / "predictions" / _file(clip), prediction)

    def write_clip(self, clip: Clip) -> None:
        """Keep a clip, so that images and new scores need no data set."""
        kept_files.write_clip(self.root / "clips" / _file(clip.name), clip)

    def swap(self, name: str, before: str, now: str) -> None:
        """Set a cell or the kept clips of one fingerprint aside, and bring those of another back if
        there are any.
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

    def with_rows_of(self, cell: str, fingerprint: str) -> Results:
        """The folder that holds a cell's rows of a fingerprint: this one, or that of earlier
        settings.
        """
        now = self.cell(cell)
        return (
            self if now and now.fingerprint == fingerprint else Results(self._earlier(fingerprint))
        )

    def with_clips_of(self, fingerprint: str) -> Results:
        """The folder that holds the kept clips of a protocol's fingerprint: this one, or that of
        earlier settings.
        """
        is_now = self.begun and self.protocol()["fingerprint"] == fingerprint
        return self if is_now else Results(self._earlier(fingerprint))

    def size_bytes(self, cell: str, folder: str) -> int:
        """What the files of a cell take in its folder `scores` or `predictions`."""
        return sum(path.stat().st_size for path in (self.root / cell / folder).glob("*"))

    def set_aside(self) -> set[Path]:
        """What is kept of other settings."""
        return set((self.root / EARLIER).glob("*/*"))

    def _earlier(self, fingerprint: str) -> Path:
        return self.root / EARLIER / (fingerprint[:16] or "unknown")

    def set_damaged_aside(self, cell: str | None) -> list[Path]:
        """Rename a cell's damaged parts and predictions, or of None the damaged clips: they are
        computed again.
        """
        kept = self.clips() if cell is None else self.predictions(cell)
        parts = [] if cell is None else self.damaged_parts(cell)
        damaged = [*parts, *(path for _, path in kept if not kept_files.is_whole(path))]
        for path in damaged:
            path.rename(path.with_name(f"{path.name}.damaged"))
        return damaged

    def remove_part(self, cell: str, index: int) -> None:
        """Remove a part that is stale."""
        self._part(cell, index).unlink(missing_ok=True)

    def remove_cell(self, cell: str) -> None:
        """Remove a cell with all its rows and predictions."""
        shutil.rmtree(self.root / cell, ignore_errors=True)

    def _part(self, cell: str, index: int) -> Path:
        return self.root / cell / "scores" / f"part-{index:05d}.parquet"


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
