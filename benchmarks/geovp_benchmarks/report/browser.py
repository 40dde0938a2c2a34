"""The clips of a report, the worst first: labels, scores, and films of those that were kept."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from geovp_benchmarks.plots.material import Material
from geovp_benchmarks.report import films
from geovp_benchmarks.report.findings import Findings
from geovp_benchmarks.results.store import Method
from geovp_benchmarks.tables import causes, clips

MAX_CLIPS = 500  # the worst


@dataclass(frozen=True)
class ShownClip:
    """A clip with the films of its methods; the first film is the ground truth."""

    name: str
    score: float  # of the method that orders the clips; NaN where there is none
    labels: Sequence[str]
    films: Sequence[films.Film]


@dataclass(frozen=True)
class Browser:
    """All clips, and what is frequent among those that a method predicts worst."""

    clips: Sequence[ShownClip]
    table: Sequence[Sequence[str]]  # see tables.clips; empty without scores
    stride: int  # films show each n-th frame
    worst: Sequence[ShownClip]  # the quarter with the worst scores
    frequent: Sequence[tuple[str, int, int]]  # label, number of clips of the worst, of the others
    orders: str = ""  # label of the method whose scores order the clips

    @property
    def has_films(self) -> bool:
        """Return whether any clip has films."""
        return any(clip.films for clip in self.clips)


def build(material: Material, findings: Findings | None) -> Browser:
    """Return the clips ordered by the scores of the method of the findings."""
    # The method that orders the clips, and labels of what it finds hard.
    judge = _judge(material, findings)
    names = material.protocol["clips"]
    labels = causes.of_clips(material.results, judge) if judge else {name: [] for name in names}
    scores = findings.clip_scores if findings else {}
    sign = 1 if not findings or findings.column.higher_is_better else -1
    names = sorted(names, key=lambda name: sign * scores.get(name, sign * math.inf))
    # Films of the kept clips, in a format that fits all of them on a page.
    predicted = [{*material.results.predictions(method).names} for method in material.methods]
    counts = {name: sum(name in of_method for of_method in predicted) for name in material.clips}
    num_films = sum(1 + count for count in counts.values() if count)
    width_px, height_px = material.protocol["size_px"]
    num_frames = 1 + material.protocol["num_future"]
    shown = films.Format.of(num_films, num_frames, height_px / width_px)
    shown_clips = [
        ShownClip(
            name,
            scores.get(name, math.nan),
            labels[name],
            [*films.of_clip(material, name, shown)] if counts.get(name) else [],
        )
        for name in names[:MAX_CLIPS]
    ]
    # What is frequent among the worst quarter, and a table of few methods.
    worst = shown_clips[: math.ceil(len(names) / 4)] if scores else []
    methods = [method.label for method in [judge, *material.shown] if method]
    return Browser(
        shown_clips,
        clips.rounded(
            clips.per_clip(material.results.select(*methods), material.options.metrics)[
                : MAX_CLIPS + 1
            ]
        ),
        shown.stride,
        worst,
        causes.frequent(labels, [clip.name for clip in worst]),
        judge.label if judge else "",
    )


def _judge(material: Material, findings: Findings | None) -> Method | None:
    """Return the method that the findings are about."""
    if findings and findings.judge:
        label = findings.judge.label.partition(", mean of ")[0]
        return next(method for method in material.methods if method.label == label)
    return None
