"""Measure forecasters on pose files alone, and fit their constants: `geovp forecast`."""

from benchmarks.studies.forecasting.command import add_arguments, run

__all__ = ["add_arguments", "run"]
