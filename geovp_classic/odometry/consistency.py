"""Poses of a path that say nothing: not measured, or where no vehicle drove, since frames were swapped or stand."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from geovp_classic.geometry import se3
from geovp_classic.types import BoolArray, FloatArray

SIDEWAYS = 0.5  # of the way along the axis
TOLERANCE = 0.3  # of a median step
LEAST_SHARE = 0.6  # of the frames that must agree, or nothing is said
NUM_TRIALS = 300
SEED = 0


def is_sideways(
    world_from_cam: FloatArray,  # [P, 4, 4]
) -> bool:
    """Whether the camera went more than half as far to its side as along its axis: rarely what a vehicle's does."""
    steps = np.abs((se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:])[:, :3, 3]).sum(axis=0)
    return bool(steps[0] > SIDEWAYS * steps[2])


def measured(
    tracked: BoolArray,  # [P]
    most_bridged: int,  # images in a row that were not tracked, before tracking starts anew
) -> BoolArray:
    """Which poses [P] were measured relative to one another: the tracked ones since the start that had most of them.

    What was tracked from different starts is related by nothing but continued motion. The image of a start, which is
    the last one of a gap, counts as well.
    """
    steps = np.flatnonzero(tracked)
    starts = np.flatnonzero(np.diff(steps) > most_bridged + 1) + 1  # in the list of steps
    longest = max(np.split(steps, starts)[::-1], key=len)  # of equally long ones the last
    found: BoolArray = np.zeros(len(tracked), dtype=bool)
    found[longest] = True
    if len(starts) and longest[0] > steps[0]:
        found[longest[0] - 1] = True
    return found


def driven(
    world_from_cam: FloatArray,  # [P, 4, 4], in any unit
    times_s: FloatArray,  # [P]
) -> BoolArray:
    """Which poses [P] lie where a constant acceleration that most of them agree with puts them along the path.

    A least median of squares (Rousseeuw 1984) over parabolas through three poses. All, where no step goes backwards
    among others that go forwards, or no parabola fits most of them.
    """
    count = len(times_s)
    everyone = np.ones(count, dtype=bool)
    ahead = (se3.inverse(world_from_cam[:-1]) @ world_from_cam[1:])[:, 2, 3]
    progress, step = np.concatenate([[0.0], np.cumsum(ahead)]), float(np.median(np.abs(ahead))) if count > 1 else 0.0
    if count < 5 or not (ahead < -TOLERANCE * step).any():
        return everyone
    triples = np.array(list(combinations(range(count), 3)))
    if len(triples) > NUM_TRIALS:
        triples = np.random.default_rng(SEED).choice(triples, NUM_TRIALS, replace=False)
    seconds = times_s - times_s[0]
    powers = np.stack([np.ones(count), seconds, seconds**2], axis=-1)
    parabolas = np.linalg.solve(powers[triples], progress[triples][..., None])
    errors = np.abs(progress - (powers @ parabolas)[..., 0])  # [trials, P]
    best = errors[np.median(errors, axis=1).argmin()]
    agree = best <= TOLERANCE * step
    return agree if agree.mean() >= LEAST_SHARE else everyone
