"""Mean of a method over clips, with its interval."""

import functools
import math
from dataclasses import dataclass, field

import numpy as np

from geovp_classic.types import FloatArray, IntArray


@dataclass(frozen=True)
class Score:
    """The mean of a method over clips with its interval; NaN where too few clips have a value."""

    mean: float
    low: float = math.nan
    high: float = math.nan
    standard_error: float = math.nan  # as if clips were independent
    clips: int = 0  # that have a value
    effective_clips: float = 0.0
    # [N] by clip, each a mean over steps; empty for a published score
    values: FloatArray = field(default_factory=lambda: np.empty(0), compare=False)
    p_value: float = math.nan  # of a mean of zero, two-sided
    is_over_drives: bool = False  # whether each drive is one observation
    mean_error: float = math.nan  # standard error of the mean that the interval follows from
    degrees: float = math.nan  # of freedom of this error
    # [R, N], values by training seed, of a mean over seeds
    seeds: FloatArray = field(default_factory=lambda: np.empty((0, 0)), compare=False)

    @property
    def is_exact(self) -> bool:
        """Return whether an error is zero on all clips up to rounding, as that of true poses."""
        return self.clips > 0 and bool(np.nanmax(np.abs(self.values)) < 1e-6)

    @property
    def has_few_clips(self) -> bool:
        """Return whether the effective clips are too few to rely on the interval."""
        return self.effective_clips < 8


@functools.lru_cache(maxsize=4)  # all scores of a table share them
def sequences_of(clips: tuple[str, ...]) -> IntArray:
    """Return the number [N] of the sequence of each clip: its name up to the last slash."""
    names = [clip.rpartition("/")[0] for clip in clips]
    return np.unique(names, return_inverse=True)[1]
