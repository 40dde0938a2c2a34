"""The median of some hundreds of numbers, as the robust fits of each round ask for it."""

import numpy as np

from geovp_classic.types import FloatArray


def median(
    values: FloatArray,  # [N], N >= 1, without NaN
) -> float:
    """The same as `np.median`, which takes several times as long
    (benchmarks/performance/libraries.py).
    """
    above = len(values) // 2
    below = above - 1 + len(values) % 2
    parted = np.partition(values, (below, above))
    return float((parted[below] + parted[above]) / 2)
