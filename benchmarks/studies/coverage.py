"""Coverage of 95 % intervals of a mean over the clips of drives, on made values.

A value is the sum of a drive's effect, an autoregression over the clips of the drive, and its mean
0. "of others" counts how often the interval holds the mean of all drives there could be, "of these"
the mean of the drives that were taken. The intervals are those of tables, the block bootstrap over
clips that they use with fewer than eight drives, and one as if clips were independent.

Examples:
  python benchmarks/studies coverage --draws 1000
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from geovp.progress import tracked
from geovp_benchmarks.statistics.intervals import Intervals
from geovp_benchmarks.statistics.score import Score
from geovp_benchmarks.tables.formats import grid
from geovp_classic.types import FloatArray

ARGUMENTS = {
    "": {
        "--draws N = 300": "Number of made data sets per line.",
        "--seed NUMBER = 0": "Seed of the made values.",
    }
}


@dataclass(frozen=True)
class Setting:
    """Drives with clips that depend on each other."""

    lengths: tuple[int, ...]  # clips of each drive
    drive_effect: float  # standard deviation, that of a clip is 1
    correlation: float = 0.0  # of neighbouring clips
    is_skewed: bool = False  # exponential noise instead of normal

    def draw(self, rng: Generator) -> tuple[FloatArray, FloatArray]:
        """Return values [N], and the effect of the drive of each [N]."""
        values, effects = [], []
        for length in self.lengths:
            noise = rng.exponential(size=length) - 1 if self.is_skewed else rng.normal(size=length)
            effect = self.drive_effect * rng.normal()
            clip = noise[0]
            for innovation in noise:
                clip = self.correlation * clip
                clip += np.sqrt(1 - self.correlation**2) * innovation
                values.append(effect + clip)
                effects.append(effect)
        return np.array(values), np.array(effects)

    @property
    def clips(self) -> tuple[str, ...]:
        """Return the names of the clips."""
        return tuple(
            f"{drive:02d}/{clip:03d}"
            for drive, length in enumerate(self.lengths)
            for clip in range(length)
        )

    @property
    def row(self) -> list[str]:
        """Return drives, clips per drive, drive effect, correlation and noise in words."""
        lengths = sorted(set(self.lengths))
        span = " to ".join(map(str, (lengths[0], lengths[-1])[: len(lengths)]))
        noise = "skewed" if self.is_skewed else "normal"
        counts = [str(len(self.lengths)), span]
        return [*counts, f"{self.drive_effect:g}", f"{self.correlation:g}", noise]


SETTINGS = (
    Setting((2,) * 18, 0.5),
    Setting((2,) * 50, 0.5),
    Setting((2,) * 50, 0.5, 0.5, is_skewed=True),
    Setting((20,) * 10, 0.0),
    Setting((20,) * 10, 0.3),
    Setting((20,) * 10, 1.0),
    Setting((20,) * 10, 0.3, 0.8),
    Setting((20,) * 10, 0.3, 0.5, is_skewed=True),
    Setting((5, 10, 15, 20, 25) * 3, 0.5, 0.5),
    Setting((4, 4, 4, 4, 4, 4, 8, 8, 16, 16, 32, 32), 0.5, 0.5),
    Setting((36,), 0.0, 0.5),
    Setting((60, 40), 0.0, 0.5),
    Setting((60, 40), 0.5, 0.5),
    Setting((20, 20, 20), 0.0, 0.8),
)


def run(args: argparse.Namespace) -> Iterator[str]:
    """Yield a table with a line per setting."""
    heads = ["drives", "clips of each", "drive effect", "correlation", "noise"]
    heads += ["tables, of others (%)", "tables, of these (%)"]
    heads += ["bootstrap, of others (%)", "independent, of others (%)"]
    lines = [heads]
    for setting in tracked(SETTINGS):
        rng, clips = np.random.default_rng(args.seed), setting.clips
        hits = np.zeros(4)
        for _ in range(args.draws):
            values, effects = setting.draw(rng)
            table, bootstrap = (
                Intervals(min_drives=min_drives).interval(values, clips)
                for min_drives in (Intervals.min_drives, len(values))
            )
            half = 1.96 * table.standard_error
            hits += [
                _holds(table, 0.0),
                _holds(table, effects.mean()),
                _holds(bootstrap, 0.0),
                abs(table.mean) <= half,
            ]
        lines.append([*setting.row, *(f"{100 * count / args.draws:.1f}" for count in hits)])
    yield from grid(lines)


def _holds(score: Score, truth: float) -> bool:
    return score.low <= truth <= score.high
