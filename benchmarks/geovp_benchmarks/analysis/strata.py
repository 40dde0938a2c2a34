"""Results by kinds of clips: turning or straight, slow or fast, seen before or not, with and
without traffic.

The kinds follow from facts of each clip that are stored beside its scores, computed from true poses
and, where they are known, exact depths and moving objects; never from a prediction, but for `seen`
on video without exact depth.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.results.score_names import COVERAGE
from geovp_benchmarks.results.store import Results
from geovp_classic.errors import BadData
from geovp_classic.registry import nearest


@dataclass(frozen=True)
class Division:
    """How clips are divided by one of their facts."""

    fact: str
    words: tuple[
        str, ...
    ]  # what is said of the strata in ascending order, {} for each bound of theirs
    bounds: tuple[float, ...] = ()  # between the strata; none: as many clips in each


DIVISIONS = {
    "turning": Division(
        "yaw_deg", ("straight, by less than {:g} deg", "turning, by {:g} deg or more"), (5.0,)
    ),
    "speed": Division(
        "speed_m_s", ("below {:g} m/s", "{:g} to {:g} m/s", "{:g} m/s or more"), (5.0, 10.0)
    ),
    "step": Division(
        "step_m",
        ("below {:g} m a frame", "{:g} to {:g} m a frame", "{:g} m a frame or more"),
        (0.5, 1.0),
    ),
    "seen": Division(
        "seen",
        ("below {:.1%} seen before", "{:.1%} to {:.1%} seen before", "{:.1%} or more seen before"),
    ),
    "moving": Division(
        "moving", ("below {:.1%} of pixels moving", "{:.1%} or more of pixels moving"), (0.01,)
    ),
}


def divide(results: Results, by: str) -> list[Results]:
    """Return a subset per stratum that has clips, and one of the clips whose fact is not known;
    BadData where none is.
    """
    if by not in DIVISIONS:
        raise BadData(f"clips cannot be divided by {by!r}{nearest(by, DIVISIONS)}")
    division, clips = DIVISIONS[by], results.protocol()["clips"]
    facts, source = _facts(results, division.fact)
    known = {clip: facts[clip] for clip in clips if clip in facts}
    if not known:
        raise BadData(
            f"{results.root} does not say {division.fact} of any clip, by which it could be "
            "divided: the data set has "
            "no true poses or depths, or an older version computed the methods (`geovp run "
            "--fresh` recomputes them)"
        )
    bounds = division.bounds or tuple(np.quantile(list(known.values()), [1 / 3, 2 / 3]).tolist())
    ranks = {
        clip: int(np.searchsorted(bounds, value, side="right")) for clip, value in known.items()
    }
    limits = [bounds[max(rank - 1, 0) : rank + 1] for rank in range(len(bounds) + 1)]
    labels = [
        words.format(*ends) + source for words, ends in zip(division.words, limits, strict=True)
    ]
    labels.append(f"{division.fact} not known")
    subsets = [
        frozenset(c for c in clips if ranks.get(c, len(bounds) + 1) == rank)
        for rank in range(len(labels))
    ]
    return [
        replace(results, subset=subset, label=label)
        for subset, label in zip(subsets, labels, strict=True)
        if subset
    ]


def _facts(results: Results, fact: str) -> tuple[Mapping[str, float], str]:
    """Return a fact by clip, and words on where it is from; without exact depth, what a method
    covers was seen before.
    """
    facts = {
        clip: numbers[fact] for clip, numbers in results.clip_facts().items() if fact in numbers
    }
    if facts or fact != "seen":
        return facts, ""
    for method in (
        method
        for method in results.select().methods()
        if method.kind == "geometric" and method.status == "done"
    ):
        fractions = statistics.mean_of_samples(results.scores(method.name).values[COVERAGE])
        means = statistics.over_steps(fractions).tolist()
        facts = dict(zip(results.protocol()["clips"], means, strict=True))
        return facts, f", as {method.label} covers it"
    return {}, ""
