"""The error budget: the changes from replacing the stages of a row by the truth, and its tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from benchmarks.intervals import KIND, Interval
from benchmarks.progress import Progress
from benchmarks.studies.budget.images import ALL_STAGES, ClipImages, not_measurable, oracle_depth
from benchmarks.studies.budget.poses import SCALE, ClipMotions, OraclePoses, Oracles
from benchmarks.studies.budget.scores import Predict, Scores, Subject, heading, score, text
from geovp_classic.types import Clip

NONE: Oracles = frozenset()
DIRECTIONS = ("put in alone", "put in one by one", "taken away alone")


@dataclass(frozen=True)
class Budget:
    """All variants' scores."""

    subject: Subject
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
        pairs = (NONE, frozenset({stage})), (before, before | {stage}), (self.everything, self.everything - {stage})
        return dict(zip(DIRECTIONS, pairs, strict=True))[direction]

    def change(self, direction: str, stage: str, metric: str) -> Interval:
        """How the score changes then."""
        before, after = self.pair(direction, stage)
        return self.scores.change([after], before, metric)


def measure(subject: Subject, progress: Progress) -> Budget:
    """Score the forecast, the truth, and everything between on all clips; the first says what can be measured."""
    predictor = subject.predictor
    missing = not_measurable(subject.dataset[0], predictor.renderer)
    stages = tuple(stage for stage in ALL_STAGES if stage not in missing)
    everything = frozenset(stages)
    alone = [(frozenset({stage}), everything - {stage}) for stage in stages]
    in_turn = [frozenset(stages[:number]) for number in range(len(stages) + 1)]
    variants = list(dict.fromkeys([NONE, everything, *(one for pair in alone for one in pair), *in_turn]))
    clips = ((clip, _predict(subject, clip)) for clip in map(subject.dataset.__getitem__, range(subject.num_clips)))
    return Budget(subject, score(subject, variants, clips, progress), stages, missing)


def _predict(subject: Subject, clip: Clip) -> Predict[Oracles]:
    source, renderer = subject.predictor.pose_source, subject.predictor.renderer
    depth = oracle_depth(clip, renderer)
    needs = OraclePoses(source, NONE).needs | renderer.needs
    needs = needs if depth is None else needs | depth.needs
    context, target = clip.split(subject.matrix.num_past, needs)
    return ClipImages(ClipMotions(source, context), renderer, depth, context, target, subject.steps).frames


def tables(budget: Budget) -> Iterator[str]:
    """A table a metric, then what could not be measured and what the numbers are."""
    scores, subject = budget.scores, budget.subject
    yield f"{subject.label}: {subject.about}"
    for name, metric in subject.metrics.items():
        digits = 2 if metric.unit == "dB" else 4
        ends = [f"{scores.level(one, name).mean:.{digits}f}" for one in (NONE, budget.everything)]
        yield f"\n{heading(name, metric)}: all forecast {ends[0]}, all true {ends[1]}"
        yield f"{'stage':<18}" + "".join(f"{direction:>29}" for direction in DIRECTIONS) + f"{'n':>4}"
        for stage in budget.stages:
            cells = [f"{text(budget.change(direction, stage, name), metric):>29}" for direction in DIRECTIONS]
            count = min(scores.count(*budget.pair(direction, stage)) for direction in DIRECTIONS)
            yield f"{stage:<18}{''.join(cells)}{count:>4}"
    yield ""
    yield from (f"{stage}: not measurable here, it {reason}" for stage, reason in budget.missing.items())
    for reason in dict.fromkeys(scores.reasons.values()):
        yield f"left out where it occurs: {reason}"
    yield f"{KIND}. True poses are the recorded ones, refined from the images."
    if SCALE in budget.stages and "depth" not in budget.stages:
        yield "A scale that is wrong everywhere alters no image but through forecasters; path is without speed."
