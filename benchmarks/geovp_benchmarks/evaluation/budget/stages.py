"""The error budget: the changes from replacing the stages of a row by the truth, and its tables."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from geovp_benchmarks.analysis.intervals import KIND, Interval
from geovp_benchmarks.evaluation.budget.images import (
    ALL_STAGES,
    DEPTH,
    MIN_SEEN,
    MOVING,
    ClipImages,
    with_true_depth,
)
from geovp_benchmarks.evaluation.budget.poses import TRUTH, ClipMotions, Oracles
from geovp_benchmarks.evaluation.budget.scores import Predict, Scores, Subject, heading, score, text
from geovp_benchmarks.progress import Progress
from geovp_classic.types import Clip

NONE: Oracles = frozenset()
WHY_NOT = {
    DEPTH: (
        "needs recorded depth or right images (--stereo), and a renderer that takes a depth source"
    ),
    MOVING: "needs exact masks of what moves, which only synthetic clips have",
}
DIRECTIONS = ("put in alone", "put in one by one", "taken away alone")


@dataclass(frozen=True)
class Budget:
    """All variants' scores."""

    scores: Scores[Oracles]
    stages: tuple[str, ...]  # in the order in which they are put in
    missing: Mapping[str, str]  # stages that cannot be measured, and why

    @property
    def everything(self) -> Oracles:
        """All stages that can be true."""
        return frozenset(self.stages)

    def pair(self, direction: str, stage: str) -> tuple[Oracles, Oracles]:
        """The variants before and after the stage is replaced, or taken away."""
        before = frozenset(self.stages[: self.stages.index(stage)])
        pairs = (
            (NONE, frozenset({stage})),
            (before, before | {stage}),
            (self.everything, self.everything - {stage}),
        )
        return dict(zip(DIRECTIONS, pairs, strict=True))[direction]

    def change(self, direction: str, stage: str, metric: str) -> Interval:
        """How the score changes then."""
        before, after = self.pair(direction, stage)
        return self.scores.change([after], before, metric)


def measure(subject: Subject, progress: Progress) -> Budget:
    """Score the forecast, the truth, and everything between on all clips; the first says what can
    be measured.
    """
    known = {
        DEPTH: with_true_depth(subject.predictor.renderer, subject.first),
        MOVING: subject.first.moving,
    }
    missing = {stage: reason for stage, reason in WHY_NOT.items() if known[stage] is None}
    stages = tuple(stage for stage in ALL_STAGES if stage not in missing)
    budget = Budget(Scores({}, {}, subject, ()), stages, missing)
    pairs = [budget.pair(direction, stage) for direction in DIRECTIONS for stage in stages]
    variants = list(dict.fromkeys(variant for pair in pairs for variant in pair))
    return replace(budget, scores=score(subject, variants, predict, progress))


def predict(subject: Subject, clip: Clip) -> Predict[Oracles]:
    """The frames of one clip, for any stages from the truth."""
    source, renderer = subject.predictor.pose_source, subject.predictor.renderer
    true_depth = with_true_depth(renderer, clip)
    needs = source.needs | TRUTH.needs | renderer.needs | (true_depth or renderer).needs
    context, target = clip.split(subject.matrix.num_past, needs)
    return ClipImages(
        ClipMotions(source, context), renderer, true_depth, context, target, subject.steps
    ).frames


def tables(budget: Budget) -> Iterator[str]:
    """A table a metric, then what could not be measured and what the numbers are."""
    scores, subject = budget.scores, budget.scores.subject
    yield f"{subject.label}: {subject.about}"
    for name, metric in subject.metrics.items():
        digits = 2 if metric.unit == "dB" else 4
        ends = [f"{scores.level(one, name).mean:.{digits}f}" for one in (NONE, budget.everything)]
        yield f"\n{heading(name, metric)}: all forecast {ends[0]}, all true {ends[1]}"
        yield (
            f"{'stage':<18}" + "".join(f"{direction:>29}" for direction in DIRECTIONS) + f"{'n':>4}"
        )
        for stage in budget.stages:
            cells = [
                f"{text(budget.change(direction, stage, name), metric):>29}"
                for direction in DIRECTIONS
            ]
            count = min(scores.count(*budget.pair(direction, stage)) for direction in DIRECTIONS)
            yield f"{stage:<18}{''.join(cells)}{count:>4}"
    yield ""
    yield from (
        f"{stage}: not measurable here, it {reason}" for stage, reason in budget.missing.items()
    )
    for reason in dict.fromkeys(scores.reasons.values()):
        yield f"left out where it occurs: {reason}"
    yield "Holes are what even true poses do not show;"
    yield f"frames of which less than {MIN_SEEN:.0%} is shown are left out."
    yield "True poses are the recorded ones, registered to all images."
    yield "A scale error common to past and future affects only what is in metres:"
    yield "forecasters and recorded depth."
    if scores.have_intervals:
        yield KIND
