"""Scores in memory: an array per metric."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geovp_classic.types import FloatArray

ScoreRow = tuple[str, int, int, str, float]  # clip, sample, step from 1, metric, value


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of one method on some clips."""

    clips: Sequence[str]
    values: Mapping[str, FloatArray]  # by metric, [N, S, F]; NaN: not defined, or not stored

    def rows(self) -> Iterator[ScoreRow]:
        """Yield all values by clip, metric, sample and step."""
        for number, clip in enumerate(self.clips):
            for metric, values in self.values.items():
                for (sample, step), value in np.ndenumerate(values[number]):
                    yield clip, sample, step + 1, metric, float(value)


def nanmean(values: npt.NDArray[np.floating], axis: int) -> FloatArray:
    """Return np.nanmean that answers NaN for an empty slice without a warning."""
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        return np.asarray(np.nanmean(values, axis=axis))
