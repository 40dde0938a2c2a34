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
    methods = [method for method in results.methods() if method.status == "done"]
    for method in sorted(methods, key=lambda method: method.kind != "geometric"):
        samples = results.means(method.name).get(metric, np.empty((0, 1)))
        failed = results.failures(method.name)
        means = statistics.over_steps(samples).tolist()  # over samples
        pairs = zip(protocol["clips"], means, strict=False)
        scores = {clip: mean for clip, mean in pairs if clip not in failed and math.isfinite(mean)}
        if scores:
            break
    else:
        raise BadData(f"--keep {keep}: no method is complete with this metric: see below the table")
    is_lower_better = protocol["metrics"][metric]["higher_is_better"] is False
    ranked = sorted(scores, key=scores.__getitem__, reverse=is_lower_better == (which == "worst"))
    num_frames = protocol["num_past"] + protocol["num_future"]
    min_distance = math.ceil(num_frames / protocol["stride"])  # in clips
    position = {clip: index for index, clip in enumerate(protocol["clips"])}
    clips: list[str] = []
    for clip in ranked:
        distances = [abs(position[clip] - position[other]) for other in clips]
        if len(clips) < num_clips and min(distances, default=min_distance) >= min_distance:
            clips.append(clip)
    clips = list(dict.fromkeys([*clips, *ranked]))[:num_clips]
    return Selection(tuple(clips), f"{which} {title(metric)} of {method.label}")
