"""Which clips' predictions are kept: named ones, or those that a method predicts worst, best or
about as usual.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results.score_names import ALWAYS_SCORED
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.results.stored_facts import title
from geovp_classic.errors import BadData
from geovp_classic.registry import nearest

NUM_CLIPS = 3
WHICH = ("worst", "best", "median")
NAMED = "asked for by name"


@dataclass(frozen=True)
class Selection:
    """Clips to keep, in the order in which they are shown, and why these."""

    clips: tuple[str, ...]
    by: str

    def among(self, known: Sequence[str]) -> frozenset[str]:
        """The clips; BadData unless the data set has all of them."""
        for clip in self.clips:
            if clip not in known:
                raise BadData(
                    f"--keep: there is no clip {clip!r}: they are called {known[0]} to {known[-1]}"
                )
        return frozenset(self.clips)


@dataclass(frozen=True)
class Ranking:
    """The rule WHICH:METRIC or WHICH:METRIC:METHOD, by which clips are chosen once there
    are scores.
    """

    which: str
    metric: str
    # a method's name or label; "": the first complete method with the metric, geometric ones first
    method: str = ""

    @classmethod
    def parse(cls, text: str, matrix: Matrix) -> Self:
        """The rule in words; BadData when a word is not one of the matrix."""
        which, _, rest = text.partition(":")
        metric, _, label = rest.partition(":")
        metrics = [*matrix.frame_metrics, *matrix.trajectory_metrics, *ALWAYS_SCORED]
        labels = [name for method in matrix.methods for name in (method.label, method.name)]
        for word, known in ((which, WHICH), (metric, metrics), (label, ["", *labels])):
            if word not in known:
                raise BadData(
                    f"--keep {text!r} has {word!r}, expected N, all, clip names, or "
                    f"{'|'.join(WHICH)}:METRIC[:METHOD]"
                    f"{nearest(word, filter(None, known))}"
                )
        return cls(which, metric, label)

    def choose(self, results: Results) -> Selection:
        """NUM_CLIPS clips; BadData when no complete method has the metric."""
        protocol = results.protocol()
        method, scores = self._scores(results)
        sign = (
            -1 if protocol["metrics"][self.metric]["higher_is_better"] is False else 1
        )  # least coverage is the worst
        ranked = sorted(scores, key=lambda clip: sign * scores[clip])  # the worst one first
        if self.which == "best":
            ranked.reverse()
        if self.which == "median":
            middle = float(np.median(list(scores.values())))
            ranked.sort(key=lambda clip: abs(scores[clip] - middle))
        chosen = _apart(ranked, int(protocol["num_past"]) + int(protocol["num_future"]))
        return Selection(tuple(chosen), f"{self.which} {title(self.metric)} of {method.label}")

    def _scores(self, results: Results) -> tuple[Method, Mapping[str, float]]:
        """Return the method and its mean scores of the clips that it could predict."""
        methods = [
            method
            for method in results.methods()
            if method.status == "done" and self.method in ("", method.name, method.label)
        ]
        for method in sorted(methods, key=lambda method: method.kind != "geometric"):
            cube, failed = (
                statistics.cube(results.scores(method.name), self.metric),
                results.failures(method.name),
            )
            with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
                means = np.nanmean(cube.values, axis=(1, 2))
            scores = dict(zip(cube.clips, means.tolist(), strict=True))
            scores = {
                clip: value
                for clip, value in scores.items()
                if np.isfinite(value) and clip not in failed
            }
            if scores:
                return method, scores
        which = f"the method {self.method!r} is not" if self.method else "no method is"
        raise BadData(
            f"--keep: {which} complete with {self.metric}, by which clips are to be selected: see "
            "below the table"
        )


def _apart(ranked: Sequence[str], num_frames: int) -> list[str]:
    """The first NUM_CLIPS that share no frame, as far as their names (sequence/first frame) tell
    and there are some.
    """
    chosen: list[str] = []
    for clip in ranked:
        if not any(_overlap(clip, other, num_frames) for other in chosen):
            chosen.append(clip)
    chosen += [clip for clip in ranked if clip not in chosen]
    return sorted(chosen[:NUM_CLIPS], key=ranked.index)


def _overlap(clip: str, other: str, num_frames: int) -> bool:
    """Whether two names such as "03/000180" are of one sequence and less than a clip apart."""
    (sequence, _, first), (others, _, second) = clip.rpartition("/"), other.rpartition("/")
    is_numbered = first.isdecimal() and second.isdecimal()
    return sequence == others and is_numbered and abs(int(first) - int(second)) < num_frames
