"""Scores that are stored of each method, and the values that a score can have."""

import math

Bounds = tuple[float, float]
UNBOUNDED: Bounds = (-math.inf, math.inf)
COVERAGE = "coverage"  # fraction of pixels that were not inpainted
CONFIDENCE = "confidence"  # `Prediction.confidence`
FEATURES = "@features"  # ends the column of a set metric: those of the truth, then of the samples
ALWAYS_SCORED = (COVERAGE, CONFIDENCE)
