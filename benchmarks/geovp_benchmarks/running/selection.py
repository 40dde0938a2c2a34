"""Selection of the clips whose predictions are kept: `--keep` of `geovp run`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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

    clips: tuple[str, ...] = ()
    by: str = ""  # "": spread over the data set, or all


def select(keep: str, clips: Sequence[str], matrix: Matrix) -> Selection:
    """Return the clips of a number, "all", or names with commas.

    A ranking WHICH:METRIC or WHICH:METRIC:METHOD selects none, because it needs scores. Raises
    BadData for an unknown word.
    """
    if keep == "all":
        return Selection(tuple(clips))
    if keep == "1":
        return Selection((clips[len(clips) // 2],))
    if keep.isdecimal():
        count = min(int(keep), len(clips))
        indices = np.linspace(0, len(clips) - 1, count).round().astype(int)
        return Selection(tuple(clips[index] for index in indices))
    if ":" in keep:
        _check_ranking(keep, matrix)
        return Selection()
    names = tuple(keep.split(","))
    for name in names:
        if name not in clips:
            raise BadData(
                f"--keep: there is no clip {name!r}: they are called {clips[0]} to {clips[-1]}"
            )
    return Selection(names, "asked for by name")


def _check_ranking(keep: str, matrix: Matrix) -> None:
    """Raise BadData if a word of a ranking is not in the matrix."""
    which, metric, method = [*keep.split(":", 2), ""][:3]
    methods = [name for each in matrix.methods for name in (each.label, each.name)]
    metrics = [*matrix.frame_metrics, *matrix.trajectory_metrics, *ALWAYS_SCORED]
    choices = {which: ["worst", "best", "median"], metric: metrics, method: ["", *methods]}
    for word, allowed in choices.items():
        if word not in allowed:
            raise BadData(
                f"--keep {keep!r} has {word!r}, expected N, all, clip names, or "
                f"worst|best|median:METRIC[:METHOD]{nearest(word, filter(None, allowed))}"
            )


def rank(keep: str, results: Results, num_clips: int = 3) -> Selection:
    """Return the clips of a ranking, without common frames if there are enough.

    The scores are those of METHOD or of the first complete method, geometric methods first. Raises
    BadData if no complete method has the metric.
    """
    which, metric, name = [*keep.split(":", 2), ""][:3]
    protocol = results.protocol()
    method, scores = _scores(results, metric, name)
    is_lower_better = protocol["metrics"][metric]["higher_is_better"] is False
    is_descending = is_lower_better == (which == "worst")
    if which == "median":
        middle = float(np.median(list(scores.values())))
        scores = {clip: abs(score - middle) for clip, score in scores.items()}
        is_descending = False
    ranked = sorted(scores, key=scores.__getitem__, reverse=is_descending)
    num_frames = protocol["num_past"] + protocol["num_future"]
    min_distance = math.ceil(num_frames / protocol["stride"])  # in clips
    position = {clip: index for index, clip in enumerate(protocol["clips"])}
    clips: list[str] = []
    for clip in ranked:
        distances = [abs(position[clip] - position[other]) for other in clips]
        if len(clips) < num_clips and min(distances, default=min_distance) >= min_distance:
            clips.append(clip)
    clips = list(dict.fromkeys([*clips, *ranked]))[:num_clips]
    selected = sorted(clips, key=ranked.index)
    return Selection(tuple(selected), f"{which} {title(metric)} of {method.label}")


def _scores(results: Results, metric: str, name: str) -> tuple[Method, Mapping[str, float]]:
    """Return a complete method and its mean scores of the clips that it could predict."""
    methods = [
        method
        for method in results.methods()
        if method.status == "done" and name in ("", method.name, method.label)
    ]
    for method in sorted(methods, key=lambda method: method.kind != "geometric"):
        rows = results.scores(method.name).of_metrics((metric,))
        rows = rows.where(np.isfinite(rows.value))
        means = np.bincount(rows.clip.codes, rows.value) / np.bincount(rows.clip.codes)
        scores = dict(zip(rows.clip.categories, means.tolist(), strict=True))
        for clip in results.failures(method.name):
            scores.pop(clip, None)
        if scores:
            return method, scores
    which = f"the method {name!r} is not" if name else "no method is"
    raise BadData(
        f"--keep: {which} complete with {metric}, by which clips are to be selected: see below the "
        "table"
    )
