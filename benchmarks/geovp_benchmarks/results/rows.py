"""Scores in memory: a row per clip, sample, step and metric, in columns."""

from __future__ import annotations

import dataclasses
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geovp_classic.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Categorical:
    """A column of names: each that occurs, in the order of the first rows, and which of them a row
    has.
    """

    categories: tuple[str, ...]
    codes: IntArray  # [R], indices into the categories

    @classmethod
    def of(cls, column: Sequence[str] | npt.NDArray[np.object_]) -> Categorical:
        """From a name per row [R]."""
        known = {name: number for number, name in enumerate(dict.fromkeys(column))}
        return cls(tuple(known), np.fromiter(map(known.__getitem__, column), np.int32, len(column)))

    @classmethod
    def coded(cls, names: Sequence[str], codes: IntArray) -> Categorical:
        """Return the column of indices into distinct names, of which not all need occur."""
        present = np.flatnonzero(np.bincount(codes, minlength=len(names)))
        renumbered = np.zeros(len(names), np.int32)
        renumbered[present] = np.arange(len(present))
        return cls(tuple(names[code] for code in present.tolist()), renumbered[codes])

    @classmethod
    def concatenated(cls, columns: Sequence[Categorical]) -> Categorical:
        """One column after the other."""
        known = {
            name: n
            for n, name in enumerate(
                dict.fromkeys(name for each in columns for name in each.categories)
            )
        }
        numbers = [
            np.array([known[name] for name in each.categories], np.int32)[each.codes]
            for each in columns
        ]
        return cls(tuple(known), np.concatenate([np.empty(0, np.int32), *numbers]))

    def values(self) -> npt.NDArray[np.object_]:
        """The name of each row [R]."""
        return np.array(self.categories, dtype=object)[self.codes]

    def among(self, wanted: Container[str]) -> BoolArray:
        """Whether the name of each row [R] is wanted."""
        return np.array([name in wanted for name in self.categories], dtype=bool)[self.codes]

    def __getitem__(self, chosen: BoolArray | IntArray) -> Categorical:
        found, numbers = np.unique(self.codes[chosen], return_inverse=True)
        return Categorical(tuple(self.categories[n] for n in found), numbers)


@dataclass(frozen=True, eq=False)
class Rows:
    """Columns of equal length [R]."""

    clip: Categorical
    sample: IntArray  # 0 .. S-1
    step: IntArray  # horizon k = 1 .. F
    metric: Categorical  # "psnr", "psnr@covered", "psnr@moving", "translation-error", ...
    value: FloatArray  # NaN: not defined there, e.g. no covered pixel

    @classmethod
    def of(
        cls,
        clip: Sequence[str] | npt.NDArray[np.object_] = (),
        sample: npt.ArrayLike = (),
        step: npt.ArrayLike = (),
        metric: Sequence[str] | npt.NDArray[np.object_] = (),
        value: npt.ArrayLike = (),
    ) -> Rows:
        """From columns [R]; from nothing, no rows."""
        numbers = np.asarray(sample, np.int32), np.asarray(step, np.int32)
        return cls(
            Categorical.of(clip), *numbers, Categorical.of(metric), np.asarray(value, np.float64)
        )

    @classmethod
    def concatenated(cls, parts: Sequence[Rows]) -> Rows:
        """The rows of one after the other."""
        parts = [Rows.of(), *parts]
        clip, metric = (
            Categorical.concatenated(names)
            for names in ([p.clip for p in parts], [p.metric for p in parts])
        )
        sample, step, value = (
            np.concatenate([getattr(p, name) for p in parts])
            for name in ("sample", "step", "value")
        )
        return cls(clip, sample, step, metric, value)

    @property
    def extent(self) -> tuple[int, int, int]:
        """The numbers of clips, samples S and steps F."""
        return (
            len(self.clip.categories),
            int(self.sample.max(initial=-1)) + 1,
            int(self.step.max(initial=0)),
        )

    def of_clips(self, clips: Container[str]) -> Rows:
        """The rows of some clips."""
        return self.where(self.clip.among(clips))

    def of_metrics(self, metrics: Container[str]) -> Rows:
        """The rows of some metrics."""
        return self.where(self.metric.among(metrics))

    def where(self, chosen: BoolArray | IntArray) -> Rows:
        """Return the rows of a mask [R] or of indices."""
        return Rows(*(getattr(self, field.name)[chosen] for field in dataclasses.fields(self)))

    def lines(self) -> Iterator[tuple[str, int, int, str, float]]:
        """Each row's clip, sample, step, metric and value."""
        numbers = (self.sample.tolist(), self.step.tolist())
        return zip(
            self.clip.values(), *numbers, self.metric.values(), self.value.tolist(), strict=True
        )

    def __len__(self) -> int:
        return len(self.value)
