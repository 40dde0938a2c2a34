"""Whether a results folder can be reproduced: some of its predictions are computed and scored
again, and compared.
"""

import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geovp_benchmarks.matrix.components import Failure
from geovp_benchmarks.matrix.schema import Matrix
from geovp_benchmarks.matrix.values import validated
from geovp_benchmarks.progress import announce
from geovp_benchmarks.results.provenance import versions
from geovp_benchmarks.results.store import Method, Part, Results, Rows
from geovp_benchmarks.running.built_matrix import BuiltMatrix, Task, build_matrix, compute
from geovp_classic.errors import BadData, GeovpError
from geovp_classic.types import PrivilegedInput

MOST_LISTED = 3  # metrics in the verdict on one pair


@dataclass(frozen=True)
class Stored:
    """One clip's stored rows in one row of the table."""

    results: Results
    method: Method
    part: Part
    clip: str

    @property
    def rows(self) -> Rows:
        """The clip's rows."""
        return self.results.scores(self.method.name).of_clips((self.clip,))


@dataclass(frozen=True)
class Verdict:
    """How stored rows and rows computed here agree."""

    stored: Stored
    differences: Mapping[str, float] = field(
        default_factory=dict
    )  # metric -> largest, own unit; inf: only one has it
    problem: str = ""  # why there is nothing to compare
    missing: Mapping[str, str] = field(
        default_factory=dict
    )  # stored metrics that cannot be computed here -> why
    is_repeatable: bool = True  # two computations here agree
    code: str = ""  # the hash of the sources here

    def reproduces(self, tolerance: float) -> bool:
        """Whether no value is off by more than the tolerance, in the metric's own unit."""
        return (
            not self.problem
            and not self.missing
            and max(self.differences.values(), default=0.0) <= tolerance
        )

    def sentence(self, tolerance: float) -> str:
        """The verdict in words."""
        agreement = (
            "differs"
            if max(self.differences.values(), default=0.0) > tolerance
            else "within the tolerance"
        )
        listed = _listed(self.stored.results, self.differences, MOST_LISTED)
        parts = [self.problem or (f"{agreement}: {listed}" if listed else "identical")]
        parts += [f"{name} cannot be compared: {reason}" for name, reason in self.missing.items()]
        parts += (
            []
            if self.is_repeatable
            else ["not deterministic: two computations here differ as well"]
        )
        if self.code and self.code != self.stored.part.code:
            parts.append(f"stored by code {self.stored.part.code}, here it is {self.code}")
        return f"{self.stored.method.label}, {self.stored.clip}: {'; '.join(filter(None, parts))}"


def largest(results: Results, verdicts: Sequence[Verdict]) -> str:
    """The largest difference of each metric over whole images and paths; "" where all
    are the same.
    """
    over_all: dict[str, float] = {}
    for name, value in (
        each for verdict in verdicts for each in verdict.differences.items() if "@" not in each[0]
    ):
        over_all[name] = max(over_all.get(name, 0.0), value)
    return f"largest differences: {_listed(results, over_all)}" if over_all else ""


def _listed(results: Results, differences: Mapping[str, float], most: int | None = None) -> str:
    """Differences with their units, the largest first; beyond `most` of them their number alone."""
    abouts = results.protocol()["metrics"]
    units = {name: abouts.get(name.partition("@")[0], {}).get("unit", "") for name in differences}
    ordered = sorted(differences.items(), key=lambda one: -one[1])
    shown = [f"{name} {value:.3g} {units[name]}".rstrip() for name, value in ordered[:most]]
    return ", ".join(
        [*shown, *([f"{len(ordered) - len(shown)} more"] if len(ordered) > len(shown) else [])]
    )


def sample(results: Results, count: int, seed: int) -> list[Stored]:
    """So many of the stored (row, clip) pairs, drawn without replacement, in the order of the
    folder.
    """
    pairs = [
        Stored(results, method, part, clip)
        for method in results.methods()
        for part in results.parts(method.name)
        for clip in part.clips
    ]
    if not pairs:
        raise BadData(
            f"{results.root} holds no methods: give a folder in which `geovp run` has finished one"
        )
    if "rescored_from" in results.protocol():
        raise BadData(
            f"{results.root} holds new scores of kept predictions: verify the folder that they "
            "were kept in"
        )
    chosen = np.random.default_rng(seed).choice(len(pairs), min(count, len(pairs)), replace=False)
    return [pairs[index] for index in sorted(chosen.tolist())]


def check_dataset(results: Results, root: Path | None) -> None:
    """Raise BadData unless the data set is there and consists of the frames that it
    consisted of.
    """
    stored = results.protocol()
    dataset = _matrix(results, root).build_dataset(PrivilegedInput.NONE)
    found = str(getattr(dataset, "split_hash", ""))
    if found != stored["split_hash"]:
        raise BadData(
            f"the data set here has the split hash {found or 'none'}, the results were computed on "
            f"{stored['split_hash'] or 'none'}: give the same data with --root"
        )


def verify(stored: Stored, root: Path | None = None) -> Verdict:
    """Compute stored rows again, twice where they differ; nothing is written into the results."""
    announce(f"{stored.clip}, {stored.method.label}")
    try:
        built = build_matrix(_matrix(stored.results, root, stored).to_json())
        (plan,) = built.matrix.methods
        lost = [
            each.reason for each in built.components_of(plan).values() if isinstance(each, Failure)
        ]
        if lost:
            return Verdict(stored, problem=f"cannot be computed here: {lost[0]}")
        missing = built.metrics.unavailable(built.matrix.size_px)
        fresh = _compute(stored, built, missing)
        found = _differences(_without(stored.rows, missing), fresh)
        is_repeatable = not found or not _differences(fresh, _compute(stored, built, missing))
    except GeovpError as problem:
        return Verdict(stored, problem=f"cannot be computed here: {problem}")
    return Verdict(stored, found, "", missing, is_repeatable, built.code(plan))


def other_versions(results: Results) -> Iterator[str]:
    """The libraries that differ between the results and this machine."""
    before, now = results.protocol()["versions"], versions()
    for name in [*before, *(name for name in now if name not in before)]:
        if before.get(name) != now.get(name):
            stored = before.get(name, "an unknown version")
            yield f"{name}: stored with {stored}, here {now.get(name, 'none')}"


def _matrix(results: Results, root: Path | None, stored: Stored | None = None) -> Matrix:
    """The matrix of one stored row with its resolved settings; of none, the protocol alone."""
    protocol = results.protocol()
    spec = {} if stored is None else stored.method.components
    metrics = {} if stored is None else stored.part.metrics
    roles = {name: protocol["metrics"][name]["role"] for name in metrics}
    method = None if stored is None else stored.method
    count = 1 if method is None else method.num_samples
    fields = {
        "name": protocol["name"],
        "dataset": protocol["dataset"],
        "num_past": protocol["num_past"],
        "num_future": protocol["num_future"],
        "size_px": tuple(protocol["size_px"]),
        "stride": protocol["stride"],
        "pose_sources": {str(method.pose_source): {**spec["pose_source"], "num_samples": count}}
        if method and method.pose_source
        else {},
        "renderers": {str(method.renderer): spec["renderer"]} if method and method.renderer else {},
        "predictors": {method.name: {**spec["predictor"], "num_samples": count}}
        if method and "predictor" in spec
        else {},
        "frame_metrics": {name: spec for name, spec in metrics.items() if roles[name] == "frame"},
        "trajectory_metrics": {
            name: spec for name, spec in metrics.items() if roles[name] == "trajectory"
        },
    }
    return validated(Matrix, fields, "protocol.json").with_root(root)


def _compute(stored: Stored, built: BuiltMatrix, missing: Mapping[str, str]) -> Rows:
    """The rows of the clip as they come out here; GeovpError when the prediction fails as it did
    not before.
    """
    name, clips = stored.method.name, stored.results.protocol()["clips"]
    with tempfile.TemporaryDirectory() as folder:
        fresh = Results(Path(folder))
        fresh.write_method(name, stored.method.record)
        task = Task(
            matrix=built.matrix.to_json(),
            root=folder,
            clips={clips.index(stored.clip): stored.clip},
            methods=built.matrix.methods,
            fingerprints={name: stored.method.fingerprint},
            columns=tuple(column for column in built.metrics.built if column not in missing),
            kept=frozenset(),
        )
        failed = compute(task).failures
        reason = failed[name].reason if failed else fresh.failures(name).get(stored.clip, "")
        if reason and stored.clip not in stored.part.failures:
            raise GeovpError(reason)
        return fresh.scores(name)


def _differences(stored: Rows, fresh: Rows) -> dict[str, float]:
    """The largest difference of each stored metric that is not the same to the last bit."""
    before, now = _values(stored), _values(fresh)
    metrics, found = {metric for metric, *_ in before}, dict[str, float]()
    for key in sorted({*before, *(key for key in now if key[0] in metrics)}):
        one, other = before.get(key, math.inf), now.get(key, math.inf)
        if one != other and not (math.isnan(one) and math.isnan(other)):
            difference = abs(one - other)
            found[key[0]] = max(
                found.get(key[0], 0.0), math.inf if math.isnan(difference) else difference
            )
    return found


def _values(rows: Rows) -> dict[tuple[str, int, int], float]:
    """Values by metric, sample and step; NaN where one is not defined."""
    return {(metric, sample, step): value for _, sample, step, metric, value in rows.lines()}


def _without(rows: Rows, missing: Mapping[str, str]) -> Rows:
    """The rows of metrics that can be computed here."""
    return rows.of_metrics(
        [name for name in rows.metric.categories if name.partition("@")[0] not in missing]
    )
