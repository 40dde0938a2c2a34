"""Task of a run: predict a clip with several methods, and score the predictions."""

import functools
import operator
from collections.abc import Hashable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix.components import build, code_hash, on_device
from geovp_benchmarks.matrix.schema import Matrix, MethodPlan
from geovp_benchmarks.progress import announce
from geovp_benchmarks.results.score_files import Failure
from geovp_benchmarks.results.store import Results, ScoreRecord, Scores
from geovp_benchmarks.running.profiling import Usage
from geovp_benchmarks.running.scoring import Metrics, ScoredClip, score
from geovp_classic.errors import BadData
from geovp_classic.interfaces import Dataset
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.predictors.geometric import GeometricPredictor, show
from geovp_classic.types import Clip, Context, Prediction, PrivilegedInput

Scored = tuple[Scores, ScoreRecord]


@dataclass(frozen=True)
class BuiltMatrix:
    """Components of a matrix; a Failure replaces a component that cannot be built here."""

    matrix: Matrix
    dataset: Dataset
    methods: Mapping[MethodPlan, dict[str, Any]]  # their components by role
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


@functools.lru_cache(maxsize=1)
def build_matrix(matrix_json: str) -> BuiltMatrix:
    """Build all components once per process; raise an error for a wrong name or setting."""
    matrix = Matrix.model_validate_json(matrix_json)
    with on_device(matrix.device):
        components = {key: build(*key, spec) for key, spec in matrix.specs.items()}
        metrics = Metrics.build(matrix.frame_metrics, matrix.trajectory_metrics, matrix.size_px)
    buildable = [each for each in components.values() if not isinstance(each, Failure)]
    dataset = matrix.build_dataset(needs_of(buildable))
    methods = {
        method: {role: components[key] for role, key in method.components.items()}
        for method in matrix.methods
    }
    return BuiltMatrix(matrix, dataset, methods, metrics)


def needs_of(components: Iterable[Any]) -> PrivilegedInput:
    """Return all privileged inputs of components."""
    needs = (component.needs for component in components)
    return functools.reduce(operator.or_, needs, PrivilegedInput.NONE)


@dataclass(frozen=True)
class Task:
    """Clip and the methods that lack it, as data for any process."""

    matrix: str  # Matrix.to_json
    root: Path  # of the results
    index: int  # in the data set
    clip: str
    fingerprints: Mapping[MethodPlan, str]
    is_kept: bool = False  # whether the clip and its predictions are stored


def score_clip(task: Task) -> list[Scored]:
    """Predict and score a clip with each method; only a kept clip and its predictions are written.

    A copy of the last frame replaces a prediction that fails.
    """
    built, results = build_matrix(task.matrix), Results(task.root)
    clip = ScoredClip(built.clip(task.index, task.clip), built.matrix.num_past)
    if task.is_kept:
        results.write_clip(clip.clip)
    shared: dict[Hashable, Any] = {}  # steps that several methods have in common
    scored = []
    for method, fingerprint in task.fingerprints.items():
        announce(f"{task.clip}, {method.label}")
        components = built.methods[method]
        context, _ = clip.clip.split(clip.num_past, needs_of(components.values()))
        usage, scoring = Usage(), Usage()  # the peak of scoring is the same for all methods
        failures = {}
        try:
            prediction = _predict(components, method, context, clip, shared, usage)
            with scoring.measure("metrics"):
                scores = score(clip, prediction, built.metrics)
        except Exception as error:  # of a component: the run continues
            failures[task.clip] = Failure.of(error)
            prediction, scores = CopyLast().predict(context), Scores([task.clip], {})
            with suppress(Exception), scoring.measure("metrics"):
                scores = score(clip, prediction, built.metrics)
        if task.is_kept:
            results.write_prediction(method.name, task.clip, prediction)
        record = ScoreRecord(
            method=method.name,
            clips=[task.clip],
            fingerprint=fingerprint,
            metrics=built.metrics.described,
            seconds={**usage.seconds, **scoring.seconds},
            peak_memory_mb=usage.peak_mb,
            code=code_hash(components.values()),
            failures=failures,
        )
        scored.append((scores, record))
        announce(f"{task.clip}, {method.label}", done=1)
    return scored


def _predict(
    components: Mapping[str, Any],
    method: MethodPlan,
    context: Context,
    clip: ScoredClip,
    shared: dict[Hashable, Any],
    usage: Usage,
) -> Prediction:
    """Return the prediction of a method, from steps that other methods may have computed."""
    num_samples = method.num_samples
    if method.predictor is not None:
        with usage.measure("predict"):
            prediction: Prediction = components["predictor"].predict(context, num_samples)
        return prediction
    predictor = GeometricPredictor(**components)
    observed = usage.shared(
        shared, "observe", (), lambda: predictor.observer.observe(clip.truth[0])
    )
    key: Hashable = method.pose_source, num_samples
    motion = usage.shared(shared, "motion", key, lambda: predictor.estimate(observed, num_samples))
    past = motion.past
    poses = past.world_from_cam.tobytes(), past.times_s.tobytes(), past.is_metric
    key = method.renderer, poses
    scene = usage.shared(shared, "reconstruct", key, lambda: predictor.reconstruct(observed, past))
    with usage.measure("view"):
        return show(scene, motion, context)
