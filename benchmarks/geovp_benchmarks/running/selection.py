"""Selection of the clips whose predictions are kept: by name, or by the scores of a method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results.score_names import ALWAYS_SCORED
from geovp_benchmarks.results.store import Method, Results
from geovp_benchmarks.results.stored_facts import title
from geovp_classic.errors import BadData
from geovp_classic.registry import nearest


@dataclass(frozen=True)
class Selection:
    """Clips to keep, in the order in which they are shown, and the reason."""

    clips: tuple[str, ...]
    by: str = "asked for by name"

    def among(self, names: Sequence[str]) -> frozenset[str]:
        """Return the clips; raise BadData unless the data set has all of them."""
        for clip in self.clips:
            if clip not in names:
                raise BadData(
                    f"--keep: there is no clip {clip!r}: they are called {names[0]} to {names[-1]}"
                )
        return frozenset(self.clips)


@dataclass(frozen=True)
class Ranking:
    """Rule WHICH:METRIC or WHICH:METRIC:METHOD that selects clips once there are scores."""

    which: str  # "worst", "best" or "median"
    metric: str
    # name or label; "": the first complete method with the metric, geometric methods first
    method: str = ""
    num_clips: int = 3

    @classmethod
    def parse(cls, text: str, matrix: Matrix) -> Self:
        """Parse a rule; raise BadData if a word is not in the matrix."""
        which, metric, method = [*text.split(":", 2), "", ""][:3]
        names = [name for each in matrix.methods for name in (each.label, each.name)]
        metrics = [*matrix.frame_metrics, *matrix.trajectory_metrics, *ALWAYS_SCORED]
        choices = {which: ("worst", "best", "median"), metric: metrics, method: ["", *names]}
        for word, allowed in choices.items():
            if word not in allowed:
                raise BadData(
                    f"--keep {text!r} has {word!r}, expected N, all, clip names, or "
                    f"worst|best|median:METRIC[:METHOD]{nearest(word, filter(None, allowed))}"
                )
        return cls(which, metric, method)

    def choose(self, results: Results) -> Selection:
        """Return the selected clips; raise BadData if no complete method has the metric."""
        protocol = results.protocol()
        method, scores = self._scores(results)
        is_lower_better = protocol["metrics"][self.metric]["higher_is_better"] is False
        is_descending = is_lower_better == (self.which == "worst")
        if self.which == "median":
            middle = float(np.median(list(scores.values())))
            scores = {clip: abs(score - middle) for clip, score in scores.items()}
            is_descending = False
        ranked = sorted(scores, key=scores.__getitem__, reverse=is_descending)
        num_frames = protocol["num_past"] + protocol["num_future"]
        clips: list[str] = []
        for clip in ranked:
            if not any(_overlap(clip, other, num_frames) for other in clips):
                clips.append(clip)
        clips += [clip for clip in ranked if clip not in clips]  # if too few are apart
        selected = sorted(clips[: self.num_clips], key=ranked.index)
        return Selection(tuple(selected), f"{self.which} {title(self.metric)} of {method.label}")

    def _scores(self, results: Results) -> tuple[Method, Mapping[str, float]]:
        """Return a complete method and its mean scores of the clips that it could predict."""
        methods = [
            method
            for method in results.methods()
            if method.status == "done" and self.method in ("", method.name, method.label)
        ]
        for method in sorted(methods, key=lambda method: method.kind != "geometric"):
            rows = results.scores(method.name).of_metrics((self.metric,))
            rows = rows.where(np.isfinite(rows.value))
            means = np.bincount(rows.clip.codes, rows.value) / np.bincount(rows.clip.codes)
            scores = dict(zip(rows.clip.categories, means.tolist(), strict=True))
            for clip in results.failures(method.name):
                scores.pop(clip, None)
            if scores:
                return method, scores
        which = f"the method {self.method!r} is not" if self.method else "no method is"
        raise BadData(
            f"--keep: {which} complete with {self.metric}, by which clips are to be selected: see "
            "below the table"
        )


def _overlap(clip: str, other: str, num_frames: int) -> bool:
    """Return whether two names such as "03/000180" are of one sequence and share frames."""
    (sequence, _, first), (other_sequence, _, second) = clip.rpartition("/"), other.rpartition("/")
    if sequence != other_sequence or not (first.isdecimal() and second.isdecimal()):
        return False
    return abs(int(first) - int(second)) < num_frames
