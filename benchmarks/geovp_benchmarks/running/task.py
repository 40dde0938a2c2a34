"""Task of a run: predict a clip with several methods, and score the predictions."""

import errno
import functools
from collections.abc import Hashable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from geovp.progress import announce
from geovp.provenance import code_hash
from geovp_benchmarks.failure import ERRORS, Failure
from geovp_benchmarks.matrix.components import build, on_device
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.results.store import Method, Results, ScoreRecord, Scores
from geovp_benchmarks.running import scoring
from geovp_benchmarks.running.profiling import Usage
from geovp_benchmarks.running.scoring import Metrics, ScoredClip, score
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.interfaces import Dataset, FramePredictor
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.predictors.geometric import GeometricPredictor, show
from geovp_classic.types import Clip, Context, Prediction, PrivilegedInput

Scored = tuple[Scores, ScoreRecord]
FULL_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


@dataclass(frozen=True)
class BuiltMatrix:
    """Components of a matrix; a Failure replaces what cannot be built here."""

    matrix: Matrix
    dataset: Dataset
    components: Mapping[tuple[str, str], Any]  # by role and name
    predictors: Mapping[str, Any]  # by the name of the method
    metrics: Metrics

    @property
    def clip_names(self) -> tuple[str, ...]:
        """Return the names of all clips; read the clips if the data set does not list them."""
        names = getattr(self.dataset, "clip_names", None)
        if names is None:
            names = [self.dataset[index].name for index in range(len(self.dataset))]
        return tuple(names)

    def clip(self, index: int, name: str) -> Clip:
        """Read a clip; raise BadData for another name or length."""
        clip = self.dataset[index]
        length = self.matrix.num_past + self.matrix.num_future
        if clip.name != name or len(clip) != length:
            raise BadData(
                f"clip {index} of the data set is {clip.name!r} with {len(clip)} frames, expected "
                f"{name!r} with num_past + num_future = {length}"
            )
        return clip

    def texts(self, name: str) -> dict[str, str]:
        """Return what the data set says about a clip in words, such as its kind."""
        describe = getattr(self.dataset, "strata", None)
        texts: dict[str, str] = describe(name) if describe else {}
        return texts


def code_of(predictor: FramePredictor) -> str:
    """Return a short hash of the source files that scores of a predictor depend on."""
    return code_hash([predictor], [__name__, scoring.__name__])


@functools.lru_cache(maxsize=1)
def build_matrix(matrix_json: str) -> BuiltMatrix:
    """Build all components once per process; raise an error for a wrong name or setting."""
    matrix = Matrix.model_validate_json(matrix_json)
    with on_device(matrix.device):
        components = {key: build(*key, spec) for key, spec in matrix.specs.items()}
        metrics = Metrics.build(matrix.metrics, matrix.size_px)
    predictors: dict[str, Any] = {}
    needs = PrivilegedInput.NONE
    for method in matrix.methods:
        parts = {role: components[key] for role, key in method.entries.items()}
        failures = [each for each in parts.values() if isinstance(each, Failure)]
        if failures:
            predictors[method.name] = failures[0]
        else:
            predictor = parts.get("predictor") or GeometricPredictor(**parts)
            predictors[method.name] = predictor
            needs |= predictor.needs
    return BuiltMatrix(matrix, matrix.build_dataset(needs), components, predictors, metrics)


def load(matrix_json: str) -> None:
    """Build the components of a matrix in this process, unless that is impossible here."""
    with suppress(GeovpError):  # is recorded with each clip
        build_matrix(matrix_json)


@dataclass(frozen=True)
class Task:
    """Clip and the methods that lack it, as data for any process."""

    matrix: str  # Matrix.to_json
    root: Path  # of the results
    index: int  # in the data set
    clip: str
    digest: str  # of its content
    methods: Sequence[Method]
    is_kept: bool = False  # whether the clip and its predictions are stored
    failure: Failure | None = None  # of an earlier attempt: nothing is predicted

    def record(self, method: Method, **facts: Any) -> ScoreRecord:
        """Return how a method was scored on the clip."""
        return ScoreRecord(
            method.name,
            [self.clip],
            method.fingerprint,
            digests={self.clip: self.digest},
            **facts,
        )


def score_clip(task: Task) -> list[Scored]:
    """Predict and score a clip with each method; only a kept clip and its predictions are written.

    A copy of the last frame replaces a prediction that fails. A clip that cannot be read has no
    scores; a full disk ends the run.
    """
    try:
        return _scored(task)
    except ERRORS as error:
        if isinstance(error, OSError) and error.errno in FULL_DISK:
            raise
        return unscored(task, Failure.of(error))


def unscored(task: Task, failure: Failure) -> list[Scored]:
    """Return records of a clip without scores."""
    return [
        (Scores([task.clip], {}), task.record(method, failures={task.clip: failure}))
        for method in task.methods
    ]


def attempts(task: Task, reason: str) -> list[Task]:
    """Return the tasks that replace one whose process was lost; none if nothing is left to try.

    Each method is tried alone, and one that is lost again is replaced by a copy of the last frame.
    """
    if len(task.methods) > 1:
        return [replace(task, methods=[method]) for method in task.methods]
    if task.failure is None:
        return [replace(task, failure=Failure("failed", reason))]
    return []


def _scored(task: Task) -> list[Scored]:
    built, results = build_matrix(task.matrix), Results(task.root)
    clip = ScoredClip(built.clip(task.index, task.clip), built.matrix.num_past)
    if task.is_kept:
        results.clips().write(task.clip, clip.clip)
    # Each method predicts from its own inputs; equal steps of methods are computed once.
    steps: dict[Hashable, Any] = {}  # that several methods have in common
    scored = []
    for method in task.methods:
        step = f"{task.clip}, {method.label}"
        announce(step)
        predictor = built.predictors[method.name]
        context, _ = clip.clip.split(clip.num_past, predictor.needs)
        usage = Usage(steps)
        scoring = Usage(steps)  # its peak is the same for all methods
        failure = task.failure
        if failure is None:
            try:
                prediction = _predict(predictor, method, context, clip, usage)
                with scoring.measure("metrics"):
                    scores = score(clip, prediction, built.metrics)
            except ERRORS as error:  # of a component: the run continues
                failure = Failure.of(error)
        # A copy of the last frame replaces a prediction that fails.
        if failure is not None:
            prediction, scores = CopyLast().predict(context), Scores([task.clip], {})
            with suppress(*ERRORS), scoring.measure("metrics"):
                scores = score(clip, prediction, built.metrics)
        if task.is_kept:
            results.predictions(method).write(task.clip, prediction)
        # Known of the clip, and how it was scored.
        facts = clip.facts | built.texts(task.clip)
        if ("observe", ()) in steps:
            observed, _ = steps["observe", ()]
            facts["masked"] = float(observed.mask.mean())
        record = task.record(
            method,
            metrics=built.metrics.described,
            seconds={**usage.seconds, **scoring.seconds},
            peak_memory_mb=usage.peak_mb,
            code=code_of(predictor),
            failures={task.clip: failure} if failure else {},
            facts={task.clip: facts} if scores.values else {},
            shown_by={task.clip: prediction.shown_by} if prediction.shown_by else {},
        )
        scored.append((scores, record))
        announce(step, done=1)
    return scored


def _predict(
    predictor: Any, method: Method, context: Context, clip: ScoredClip, usage: Usage
) -> Prediction:
    """Return the prediction of a method, from steps that other methods may have computed."""
    num_samples = method.num_samples
    if method.renderer is None:
        with usage.measure("predict"):
            prediction = predictor.predict(context, num_samples)
        if not isinstance(prediction, Prediction) or len(prediction.frames) > num_samples:
            raise BadData(
                f"predict returned {prediction!r:.80}, expected a Prediction with up to "
                f"{num_samples} samples"
            )
        return prediction
    observed = usage.shared("observe", (), lambda: predictor.observer.observe(clip.truth[0]))
    source = method.pose_source, num_samples
    motion = usage.shared("motion", source, lambda: predictor.estimate(observed, num_samples))
    past = motion.past
    poses = past.world_from_cam.tobytes(), past.times_s.tobytes(), past.is_metric
    key = method.renderer, poses
    scene = usage.shared("reconstruct", key, lambda: predictor.reconstruct(observed, past))
    with usage.measure("view"):
        return show(predictor.judge(scene, motion), motion, context)
