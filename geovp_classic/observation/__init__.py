"""Observation: what several steps need to know about the observed frames, computed once."""

from geovp_classic.observation.observe import (
    Observed,
    Observer,
    Stream,
    future_greys,
    recent,
    scene_window_of,
    stream,
)

__all__ = [
    "Observed",
    "Observer",
    "Stream",
    "future_greys",
    "recent",
    "scene_window_of",
    "stream",
]
