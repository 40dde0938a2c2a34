"""Observation: what several steps need to know about the observed frames, computed once."""

from geovp_classic.observation.observe import (
    ImageStream,
    Observed,
    Observer,
    future_greys,
    observations_of,
    recent,
    stream_needs,
)

__all__ = [
    "ImageStream",
    "Observed",
    "Observer",
    "future_greys",
    "observations_of",
    "recent",
    "stream_needs",
]
