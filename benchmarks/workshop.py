"""The components of a matrix, built, and the computing of one chunk of clips with them; runs in any process."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import pyarrow as pa

from benchmarks.failures import Failure, build
from benchmarks.matrix import CellPlan, Matrix, Spec
from benchmarks.measures import Measures
from benchmarks.provenance import code_of
from benchmarks.remembering import Memory, RememberingPoseSource, RememberingRenderer, Stopwatch
from benchmarks.scoring import Case, score
from benchmarks.store import Part, Results
from geovp_classic.errors import BadData
from geovp_classic.interfaces import Dataset, FramePredictor
from geovp_classic.predictors import GeometricPredictor
from geovp_classic.types import Clip, Grant


@runtime_checkable
class ListsClips(Protocol):
    """A data set that knows its clips' names without reading them."""

    @property
    def clip_names(self) -> tuple[str, ...]:
        """The names in order."""
        ...


@dataclass(frozen=True)
class Workshop:
    """The built components of a matrix by role and name, a Failure in place of one that cannot be built here."""

    matrix: Matrix
    dataset: Dataset
    components: Mapping[tuple[str, str], Any]
    measures: Measures

    def clip_names(self, limit: int | None) -> tuple[str, ...]:
        """The names of the first clips, or of all; a data set that does not list them is read for it."""
        if isinstance(self.dataset, ListsClips):
            return tuple(self.dataset.clip_names[:limit])
        return tuple(self.dataset[index].name for index in range(len(self.dataset))[:limit])

    def parts(self, plan: CellPlan) -> dict[str, Any]:
        """The components of a cell: pose_source and renderer, or predictor."""
        if plan.predictor is not None:
            return {"predictor": self.components["predictors", plan.predictor]}
        source, renderer = str(plan.pose_source), str(plan.renderer)
        return {
            "pose_source": self.components["pose_sources", source],
            "renderer": self.components["renderers", renderer],
        }

    def specs(self, plan: CellPlan) -> dict[str, Spec]:
        """The same as the matrix file has it."""
        if plan.predictor is not None:
            return {"predictor": self.matrix.predictors[plan.predictor].spec}
        source, renderer = str(plan.pose_source), str(plan.renderer)
        return {"pose_source": self.matrix.pose_sources[source].spec, "renderer": self.matrix.renderers[renderer]}

    def needs(self, plan: CellPlan) -> Grant:
        """What the components of a cell need together."""
        return functools.reduce(Grant.__or__, (part.needs for part in self.parts(plan).values()))

    def code(self, plan: CellPlan) -> str:
        """A hash of the sources that the rows of a cell depend on."""
        return code_of(self.parts(plan).values())

    def predictor(self, plan: CellPlan, memory: Memory, watch: Stopwatch) -> FramePredictor:
        """The predictor of a cell; one made of two parts shares its motions and scenes through the memory."""
        parts = self.parts(plan)
        if plan.predictor is not None:
            whole: FramePredictor = parts["predictor"]
            return whole
        return GeometricPredictor(
            RememberingPoseSource(str(plan.pose_source), parts["pose_source"], memory, watch),
            RememberingRenderer(str(plan.renderer), parts["renderer"], memory, watch),
        )


@dataclass(frozen=True)
class Task:
    """A chunk of clips and the cells that lack it; plain data, so that it can travel."""

    matrix: str  # Matrix.to_json
    root: str
    chunk: int
    clips: Mapping[int, str]  # number in the data set -> name
    cells: tuple[CellPlan, ...]
    fingerprints: Mapping[str, str]
    columns: tuple[str, ...]
    kept: frozenset[str]


@dataclass(frozen=True)
class Report:
    """What became of a task; its parts are on disk."""

    task: Task
    failures: Mapping[str, Failure]


@dataclass(frozen=True)
class _Tally:
    """What one cell has so far in this chunk."""

    watch: Stopwatch = field(default_factory=Stopwatch)
    rows: list[pa.Table] = field(default_factory=list)


@functools.lru_cache(maxsize=1)
def workshop(matrix_json: str) -> Workshop:
    """The workshop of a matrix; a component's wrong name or setting is raised, what is not installed is kept."""
    matrix = Matrix.from_json(matrix_json)
    components = {key: build(*key, spec) for key, spec in _specs(matrix)}
    needs = [part.needs for part in components.values() if not isinstance(part, Failure)]
    dataset = matrix.build_dataset(functools.reduce(Grant.__or__, needs, Grant.NONE))
    measures = Measures.build(matrix.frame_metrics, matrix.trajectory_metrics)
    return Workshop(matrix, dataset, components, measures)


def compute(task: Task) -> Report:
    """Predict and score the clips of a task in all its cells and write a part for every cell that went through."""
    shop, results = workshop(task.matrix), Results(Path(task.root))
    codes = {plan.name: shop.code(plan) for plan in task.cells}  # before anybody edits what is loaded by now
    tallies = {plan.name: _Tally() for plan in task.cells}
    failures: dict[str, Failure] = {}
    for index, name in task.clips.items():
        case = Case(_clip(shop, index, name), shop.matrix.num_past)
        if name in task.kept:
            results.write_clip(case.clip)
        memory = Memory()
        for plan in (plan for plan in task.cells if plan.name not in failures):
            try:
                _predict_and_score(shop, plan, case, memory, tallies[plan.name], task)
            except Exception as error:  # the cell's failure is recorded and the matrix goes on
                failures[plan.name] = Failure.of(error)
    specs = shop.measures.describe(task.columns)
    for plan in (plan for plan in task.cells if plan.name not in failures):
        tally = tallies[plan.name]
        part = _part(task, plan.name, specs, tally.watch, codes[plan.name])
        results.write_part(plan.name, pa.concat_tables(tally.rows), part)
    return Report(task, failures)


def _part(task: Task, name: str, specs: Mapping[str, Any], watch: Stopwatch, code: str) -> Part:
    """What is written beside a cell's rows; metrics take the same memory in all cells and are left out of the peak."""
    peak = watch.peak_without("metrics")
    return Part(
        index=task.chunk,
        clips=tuple(task.clips.values()),
        fingerprint=task.fingerprints[name],
        metrics=specs,
        seconds=watch.seconds,
        peak_memory_mb=peak.memory_mb,
        peak_is_own=peak.is_own,
        code=code,
    )


def _predict_and_score(shop: Workshop, plan: CellPlan, case: Case, memory: Memory, tally: _Tally, task: Task) -> None:
    predictor = shop.predictor(plan, memory, tally.watch)
    context, _ = case.clip.split(case.num_past, predictor.needs)
    if plan.predictor is None:
        prediction = predictor.predict(context, plan.num_samples)  # its parts are timed one by one
    else:
        with tally.watch.time("predict"):
            prediction = predictor.predict(context, plan.num_samples)
    if case.clip.name in task.kept:
        Results(Path(task.root)).write_prediction(plan.name, case.clip.name, prediction)
    _ = case.pixel_sets  # computed once for all cells, so charged to none
    with tally.watch.time("metrics"):
        tally.rows.append(score(case, prediction, shop.measures.chosen(task.columns)))


def _clip(shop: Workshop, index: int, name: str) -> Clip:
    clip = shop.dataset[index]
    wanted = shop.matrix.num_past + shop.matrix.num_future
    if clip.name != name:
        raise BadData(f"clip {index} of the data set is called {clip.name!r} now and {name!r} before: it must stay")
    if len(clip) != wanted:
        raise BadData(f"{clip.name}: {len(clip)} frames, expected num_past + num_future = {wanted}")
    return clip


def _specs(matrix: Matrix) -> Iterator[tuple[tuple[str, str], Spec]]:
    for name, source in matrix.pose_sources.items():
        yield ("pose_sources", name), source.spec
    for name, renderer in matrix.renderers.items():
        yield ("renderers", name), renderer
    for name, predictor in matrix.predictors.items():
        yield ("predictors", name), predictor.spec
