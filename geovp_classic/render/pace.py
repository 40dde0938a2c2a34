"""When the camera is at the poses that a scene is asked for: the k-th is taken to be at the k-th future time."""

from __future__ import annotations

import numpy as np

from geovp_classic.types import FloatArray


def seconds_of(
    seconds: FloatArray,  # [F], at least one, of the future times
    count: int,
) -> FloatArray:
    """The times [count] of so many poses; beyond the last one they go on at its interval."""
    interval = np.diff(seconds, prepend=0)[-1]
    further = seconds[-1] + interval * np.arange(1, max(count - len(seconds), 0) + 1)
    return np.concatenate([seconds, further])[:count]
