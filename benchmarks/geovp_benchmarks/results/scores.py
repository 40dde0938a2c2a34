"""Scores in memory: an array per metric."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from geovp_classic.types import FloatArray

Row = tuple[str, int, int, str, float]  # clip, sample, step from 1, metric, value


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of one method on some clips."""

    clips: Sequence[str]
    values: Mapping[str, FloatArray]  # by metric, [N, S, F]; NaN: not defined, or not stored
    # numbers of each clip, independent of predictions; empty in scores that were read
    facts: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @classmethod
    def of_rows(cls, rows: Sequence[Row]) -> Self:
        """Return the scores in rows."""
        clips = list(dict.fromkeys(clip for clip, *_ in rows))
        num_samples = max((sample for _, sample, *_ in rows), default=-1) + 1
        num_steps = max((step for _, _, step, *_ in rows), default=0)
        values: dict[str, FloatArray] = {}
        for clip, sample, step, metric, value in rows:
            empty = np.full((len(clips), num_samples, num_steps), np.nan)
            values.setdefault(metric, empty)[clips.index(clip), sample, step - 1] = value
        return cls(clips, values)

    def rows(self) -> Iterator[Row]:
        """Yield all values by clip, metric, sample and step."""
        for number, clip in enumerate(self.clips):
            for metric, values in self.values.items():
                for (sample, step), value in np.ndenumerate(values[number]):
                    yield clip, sample, step + 1, metric, float(value)


def nanmean(values: npt.NDArray[np.floating], axis: int) -> FloatArray:
    """Return np.nanmean that answers NaN for an empty slice without a warning."""
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        return np.asarray(np.nanmean(values, axis=axis))
