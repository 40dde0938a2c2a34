"""The built components of a matrix, and the tasks that compute clips with them in any
process.
"""

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix.components import Failure, build, code_hash, on_device
from geovp_benchmarks.matrix.schema import Matrix, MethodPlan
from geovp_benchmarks.progress import announce
from geovp_benchmarks.results.store import Part, Results, Rows
from geovp_benchmarks.running.metric_set import MetricSet
from geovp_benchmarks.running.profiling import StageProfiler
from geovp_benchmarks.running.scoring import ScoringContext, check, score
from geovp_classic.errors import BadData
from geovp_classic.interfaces import Dataset
from geovp_classic.observation import Observed
from geovp_classic.predictors.copy_last import CopyLast
from geovp_classic.predictors.geometric import GeometricPredictor, show
from geovp_classic.types import Clip, Context, Motion, Prediction, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class BuiltMatrix:
    """The built components of a matrix by role and name, a Failure in place of one that cannot be
    built here.
    """

    matrix: Matrix
    dataset: Dataset
    components: Mapping[tuple[str, str], Any]
    metrics: MetricSet

    def clip_names(self, limit: int | None) -> tuple[str, ...]:
        """The names of the first clips, or of all; a data set that does not list them is read for
        it.
        """
        if hasattr(self.dataset, "clip_names"):  # known without reading them
            return tuple(self.dataset.clip_names[:limit])
        return tuple(self.dataset[index].name for index in range(len(self.dataset))[:limit])

    def components_of(self, plan: MethodPlan) -> dict[str, Any]:
        """The components themselves."""
        return {role: self.components[key] for role, key in plan.components.items()}

    def needs(self, plan: MethodPlan) -> PrivilegedInput:
        """What the components of a method need together."""
        return functools.reduce(
            PrivilegedInput.__or__, (each.needs for each in self.components_of(plan).values())
        )

    def code(self, plan: MethodPlan) -> str:
        """A hash of the sources that the rows of a method depend on."""
        return code_hash(self.components_of(plan).values())


@dataclass(frozen=True)
class Task:
    """Clips and the methods that lack them; plain data, so that it can travel."""

    matrix: str  # Matrix.to_json
    root: str
    clips: Mapping[int, str]  # number in the data set -> name
    methods: tuple[MethodPlan, ...]
    fingerprints: Mapping[str, str]
    columns: tuple[str, ...]
    kept: frozenset[str]


@dataclass(frozen=True)
class TaskResult:
    """How a task ended; its parquet parts are on disk."""

    task: Task
    failures: Mapping[str, Failure]  # by method


@functools.lru_cache(maxsize=1)
def build_matrix(matrix_json: str) -> BuiltMatrix:
    """Build all components; a missing package gives a Failure, a wrong name or setting
    is raised.
    """
    matrix = Matrix.from_json(matrix_json)
    with on_device(matrix.device):
        components = {key: build(*key, spec) for key, spec in matrix.specs.items()}
        metrics = MetricSet.build(matrix.frame_metrics, matrix.trajectory_metrics)
    needs = [each.needs for each in components.values() if not isinstance(each, Failure)]
    dataset = matrix.build_dataset(
        functools.reduce(PrivilegedInput.__or__, needs, PrivilegedInput.NONE)
    )
    return BuiltMatrix(matrix, dataset, components, metrics)


@dataclass(frozen=True)
class Cache:
    """Results for one clip that methods share: a motion per pose source, a scene per renderer and
    past.
    """

    calls: dict[Hashable, tuple[Future[Any], StageProfiler]] = field(
        default_factory=dict
    )  # done, and what they cost

    def get_or_compute(
        self, key: Hashable, compute: Callable[[], Any], profiler: StageProfiler, stage: str
    ) -> Any:
        """The value, computed once per key, or the error it raised; every method is charged its
        full cost.
        """
        if key not in self.calls:
            call, own = self.calls[key] = Future(), StageProfiler()
            with own.measure(stage):
                try:
                    call.set_result(compute())
                except Exception as error:  # raised for every method that asks
                    call.set_exception(error)
        call, own = self.calls[key]
        profiler.add(stage, own.seconds[stage], own.peaks_mb[stage])
        return call.result()


def scene_key(renderer: str, past: Trajectory) -> Hashable:
    """Equal for equal pasts, also of different pose sources."""
    poses_and_times = past.world_from_cam.tobytes() + past.times_s.tobytes()
    return "scene", renderer, hashlib.sha256(poses_and_times).digest(), past.is_metric


@dataclass(frozen=True)
class _MethodOutput:
    """One method's rows and times in this chunk."""

    profiler: StageProfiler = field(default_factory=StageProfiler)
    rows: list[Rows] = field(default_factory=list)
    failures: dict[str, Failure] = field(
        default_factory=dict
    )  # clip -> why it could not be predicted


def compute(task: Task) -> TaskResult:
    """Predict and score the clips of a task in all its methods and write a part for every method
    that did not fail.

    A clip that a method cannot predict is scored as a copy of its last frame, and the part says
    why.
    """
    built, results = build_matrix(task.matrix), Results(Path(task.root))
    codes = {plan.name: built.code(plan) for plan in task.methods}  # before a file can be edited
    outputs = {plan.name: _MethodOutput() for plan in task.methods}
    failures: dict[str, Failure] = {}
    facts: dict[str, Mapping[str, float]] = {}
    for index, name in task.clips.items():
        context = ScoringContext(_clip(built, index, name), built.matrix.num_past)
        if name in task.kept:
            results.write_clip(context.clip)
        facts[name] = context.facts
        cache = Cache()
        for plan in (plan for plan in task.methods if plan.name not in failures):
            announce(f"{name}, {plan.label}")
            try:
                _predict_and_score(built, plan, context, cache, outputs[plan.name], task)
            except (
                Exception
            ) as error:  # scoring failed for any prediction: the matrix goes on without the method
                failures[plan.name] = Failure.of(error)
            announce(f"{name}, {plan.label}", done=1)
    specs = built.metrics.describe(task.columns)
    for name, output in outputs.items():
        if name in failures:
            continue
        peak_mb = output.profiler.peak_without(
            "metrics"
        )  # they take the same memory in all methods
        part = Part(
            clips=tuple(task.clips.values()),
            fingerprint=task.fingerprints[name],
            metrics=specs,
            seconds=output.profiler.seconds,
            peak_memory_mb=peak_mb,
            peak_is_own=peak_mb > 0,
            code=codes[name],
            failures={
                clip: dataclasses.astuple(failure) for clip, failure in output.failures.items()
            },
            facts=facts,
        )
        results.write_part(name, Rows.concatenated(output.rows), part)
    return TaskResult(task, failures)


def _predict_and_score(
    built: BuiltMatrix,
    plan: MethodPlan,
    scoring: ScoringContext,
    cache: Cache,
    output: _MethodOutput,
    task: Task,
) -> None:
    context, _ = scoring.clip.split(scoring.num_past, built.needs(plan))
    try:
        prediction = _predict(
            built.components_of(plan), plan, context, scoring, cache, output.profiler
        )
        check(scoring, prediction)
    except Exception as error:  # the clip's failure is recorded and the method goes on
        output.failures[scoring.clip.name] = Failure.of(error)
        prediction = CopyLast().predict(context)
    if scoring.clip.name in task.kept:
        Results(Path(task.root)).write_prediction(plan.name, scoring.clip.name, prediction)
    _ = scoring.pixel_sets  # computed once for all methods, so charged to none
    with output.profiler.measure("metrics"):
        output.rows.append(score(scoring, prediction, built.metrics.chosen(task.columns)))


def _predict(
    components: Mapping[str, Any],
    plan: MethodPlan,
    context: Context,
    scoring: ScoringContext,
    cache: Cache,
    profiler: StageProfiler,
) -> Prediction:
    """The prediction of a method; methods share motions and scenes, and each is charged
    the full time.
    """
    if plan.predictor is not None:
        with profiler.measure("predict"):
            prediction: Prediction = components["predictor"].predict(context, plan.num_samples)
        return prediction
    predictor = GeometricPredictor(**components)
    observed: Observed = cache.get_or_compute(
        ("observed",), lambda: predictor.observer.observe(scoring.truth[0]), profiler, "observe"
    )
    motion_key = ("motion", plan.pose_source, plan.num_samples)
    motion: Motion = cache.get_or_compute(
        motion_key, lambda: predictor.estimate(observed, plan.num_samples), profiler, "motion"
    )
    key = scene_key(str(plan.renderer), motion.past)
    scene = cache.get_or_compute(
        key, lambda: predictor.reconstruct(observed, motion.past), profiler, "reconstruct"
    )
    with profiler.measure("view"):
        return show(scene, motion, context)


def _clip(built: BuiltMatrix, index: int, name: str) -> Clip:
    clip = built.dataset[index]
    length = built.matrix.num_past + built.matrix.num_future
    if clip.name != name:
        raise BadData(
            f"clip {index} of the data set is called {clip.name!r} now and {name!r} before: it "
            "must stay"
        )
    if len(clip) != length:
        raise BadData(f"{clip.name}: {len(clip)} frames, expected num_past + num_future = {length}")
    return clip
