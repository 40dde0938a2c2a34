"""Selection of the clips whose predictions are kept: `--keep` of `geovp run`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geovp_benchmarks.analysis import statistics
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results.score_names import ALWAYS_SCORED
from geovp_benchmarks.results.store import Results
from geovp_benchmarks.results.stored_facts import title
from geovp_classic.errors import BadData
from geovp_classic.registry import nearest


@dataclass(frozen=True)
class Selection:
    """Clips to keep, in the order in which they are shown, and the reason."""

    clips: tuple[str, ...] = ()
    by: str = ""  # "": spread over the data set, or all


def select(keep: str, clips: Sequence[str], matrix: Matrix) -> Selection:
    """Return the clips of a number, "all", or names with commas; raise BadData for other words.

    "worst:METRIC" and "best:METRIC" select none, because they need scores.
    """
    if keep == "all":
        return Selection(tuple(clips))
    if keep == "1":
        return Selection((clips[len(clips) // 2],))
    if keep.isdecimal():
        count = min(int(keep), len(clips))
        indices = np.linspace(0, len(clips) - 1, count).round().astype(int)
        return Selection(tuple(clips[index] for index in indices))
    which, colon, metric = keep.partition(":")
    if colon:
        metrics = [*matrix.frame_metrics, *matrix.trajectory_metrics, *ALWAYS_SCORED]
        if which not in ("worst", "best"):
            raise BadData(f"--keep {keep}: expected worst:METRIC or best:METRIC")
        if metric not in metrics:
            raise BadData(f"--keep {keep}: unknown metric {metric!r}{nearest(metric, metrics)}")
        return Selection()
    names = keep.split(",")
    for name in names:
        if name not in clips:
            raise BadData(
                f"--keep {keep}: expected a number, all, worst:METRIC, best:METRIC or names of "
                f"clips; {name!r} is not among {clips[0]} to {clips[-1]}"
            )
    return Selection(tuple(names), "asked for by name")


def rank(keep: str, results: Results, num_clips: int = 3) -> Selection:
    """Return the worst or best clips, without common frames if there are enough.

    The scores are those of the first complete method, geometric methods first. Raises BadData if no
    complete method has the metric.
    """
    which, _, metric = keep.partition(":")
    protocol = results.protocol()
    done = [method for method in results.methods() if method.status == "done"]
    for method in sorted(done, key=lambda method: method.kind != "geometric"):
        samples = results.means(method.name).get(metric)
        if samples is None:
            continue
        means = statistics.over_steps(samples)  # over samples
        means[np.isin(protocol["clips"], [*results.failures(method.name)])] = np.nan
        if np.isfinite(means).any():
            break
    else:
        raise BadData(f"--keep {keep}: no method is complete with this metric: see below the table")
    is_lower_better = protocol["metrics"][metric]["higher_is_better"] is False
    sign = -1 if is_lower_better == (which == "worst") else 1
    ranked = [
        number
        for number in np.argsort(sign * means, kind="stable").tolist()
        if np.isfinite(means[number])
    ]
    num_frames = protocol["num_past"] + protocol["num_future"]
    min_distance = math.ceil(num_frames / protocol["stride"])  # in clips
    apart: list[int] = []
    for number in ranked:
        if all(abs(number - other) >= min_distance for other in apart):
            apart.append(number)
    best = list(dict.fromkeys([*apart[:num_clips], *ranked]))[:num_clips]
    clips = tuple(protocol["clips"][number] for number in best)
    return Selection(clips, f"{which} {title(metric)} of {method.label}")
