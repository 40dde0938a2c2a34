"""What protocol.json says of a column: which way is better, and what values it can have."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from geovp_benchmarks.intervals import UNBOUNDED, Bounds
from geovp_benchmarks.matrix import UNASKED


def is_directed(metric: str, about: Mapping[str, Any]) -> bool:
    """Whether one of two values is the better one: not of coverage and confidence, whatever older results say."""
    return metric.partition("@")[0] not in UNASKED and about.get("higher_is_better") is not None


def bounds(metric: str, about: Mapping[str, Any]) -> Bounds:
    """The lowest and highest value that the metric can have; older results do not say."""
    if metric in UNASKED:
        return 0.0, 1.0
    low, high = about.get("bounds") or (None, None)
    return UNBOUNDED[0] if low is None else float(low), UNBOUNDED[1] if high is None else float(high)


def stored_bounds(metric: Any) -> list[float | None]:
    """The bounds that a metric declares, as JSON has them: null where there is none."""
    return [float(end) if math.isfinite(end) else None for end in getattr(metric, "bounds", UNBOUNDED)]
