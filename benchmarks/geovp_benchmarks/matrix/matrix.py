"""A matrix file: one protocol, and every component that is to be run under it."""

import dataclasses
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from geovp_benchmarks.matrix import matrix_files, matrix_values, protocols
from geovp_benchmarks.matrix.matrix_values import Spec
from geovp_benchmarks.results.store import NOT_CELLS
from geovp_classic import registry
from geovp_classic.errors import BadData
from geovp_classic.types import PrivilegedInput

TABLES = ("protocol", "pose_sources", "renderers", "predictors", "metrics")
PROTOCOL_KEYS = ("dataset", "num_past", "num_future", "size_px", "stride", "num_samples", "device")
FROM_PROTOCOL = (
    "num_frames",
    "stride",
    "size_px",
    "with_full",
    "with_right",
)  # fields that the protocol sets
DEFAULT_METRICS = {
    "frame": ["psnr", "ssim", "lpips"],
    "trajectory": ["translation-error", "rotation-error"],
    "stabilised": [],
}
# the share of pixels that a prediction did not invent; scored without being asked for
COVERAGE = "coverage"
CONFIDENCE = "confidence"  # `Prediction.confidence`, likewise
UNASKED = (COVERAGE, CONFIDENCE)
ENTRY_NAME = re.compile(r"[A-Za-z0-9_+=,][A-Za-z0-9_+=,.-]*")


@dataclass(frozen=True)
class Entry:
    """One line of a table: a component, and how many samples are asked of it."""

    spec: Spec
    num_samples: int


@dataclass(frozen=True)
class CellPlan:
    """One cell to compute: a pose source with a renderer, or a whole predictor, by their names in
    the matrix file.
    """

    num_samples: int
    pose_source: str | None = None
    renderer: str | None = None
    predictor: str | None = None

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.predictor or f"{self.pose_source}--{self.renderer}"

    @property
    def label(self) -> str:
        """The name in tables and figures."""
        return self.predictor or f"{self.pose_source} + {self.renderer}"

    @property
    def kind(self) -> str:
        """One of "geometric", "predictor"."""
        return "geometric" if self.predictor is None else "predictor"

    @property
    def components(self) -> dict[str, tuple[str, str]]:
        """(role in the registry, name in the matrix file) of the pose source and the renderer, or
        of the predictor.
        """
        if self.predictor is not None:
            return {"predictor": ("predictors", self.predictor)}
        return {
            "pose_source": ("pose_sources", str(self.pose_source)),
            "renderer": ("renderers", str(self.renderer)),
        }


@dataclass(frozen=True)
class Matrix:
    """The content of a matrix file; nothing is built yet."""

    name: str
    dataset: Spec
    num_past: int
    num_future: int
    size_px: tuple[int, int]
    stride: int
    pose_sources: Mapping[str, Entry]
    renderers: Mapping[str, Spec]
    predictors: Mapping[str, Entry]
    frame_metrics: Mapping[str, Spec]
    trajectory_metrics: Mapping[str, Spec]
    device: str | None = None  # of networks that do not name one; None: each network's own default

    @property
    def cells(self) -> tuple[CellPlan, ...]:
        """Every pose source with every renderer, then the predictors, in the order of the file."""
        crossed = [
            CellPlan(entry.num_samples, pose_source=source, renderer=renderer)
            for source, entry in self.pose_sources.items()
            for renderer in self.renderers
        ]
        whole = [
            CellPlan(entry.num_samples, predictor=name) for name, entry in self.predictors.items()
        ]
        return (*crossed, *whole)

    @property
    def specs(self) -> dict[tuple[str, str], Spec]:
        """Every component by role and name."""
        sources = {("pose_sources", name): entry.spec for name, entry in self.pose_sources.items()}
        renderers = {("renderers", name): spec for name, spec in self.renderers.items()}
        return (
            sources
            | renderers
            | {("predictors", name): entry.spec for name, entry in self.predictors.items()}
        )

    def to_json(self) -> str:
        """The matrix as plain text, for another process."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The inverse of `to_json`."""
        fields = json.loads(text)
        for table in ("pose_sources", "predictors"):
            fields[table] = {name: Entry(**entry) for name, entry in fields[table].items()}
        return cls(**{**fields, "size_px": tuple(fields["size_px"])})

    def with_root(self, root: Path | None) -> Self:
        """The same matrix with the data set's root replaced, or with $VARIABLES in it
        spelled out.
        """
        if root is not None:
            return replace(self, dataset={**self.dataset, "root": str(root)})
        given = self.dataset.get("root")
        if not isinstance(given, str):
            return self
        for variable in re.findall(r"\$\{?(\w+)", given):
            if not os.environ.get(variable):
                raise BadData(
                    f"protocol.dataset.root is {given!r}, but {variable} is not set: set it, or "
                    "give --root FOLDER"
                )
        return replace(self, dataset={**self.dataset, "root": os.path.expandvars(given)})

    def with_device(self, device: str | None) -> Self:
        """The same matrix with its device replaced, where one is given."""
        return self if device is None else replace(self, device=device)

    def build_dataset(self, needs: PrivilegedInput) -> Any:
        """The data set with the protocol's clip length, stride and size, and with the views that
        someone needs.
        """
        fields = {
            "num_frames": self.num_past + self.num_future,
            "stride": self.stride,
            "size_px": list(self.size_px),
            "with_full": PrivilegedInput.FULL_FRAMES in needs,
            "with_right": PrivilegedInput.RIGHT_FRAMES in needs,
        }
        known = {
            field.name
            for field in dataclasses.fields(registry.load("datasets", self.dataset["name"]))
        }
        ours = {name: value for name, value in fields.items() if name in known}
        return registry.build("datasets", {**self.dataset, **ours}, "protocol.dataset")


def read(given: Path, settings: Sequence[str] = ()) -> Matrix:
    """The matrix of a TOML file, or of a built-in one by name, with settings such as
    "protocol.stride=20" in it.

    BadData or UnknownComponent names the line's table and the nearest known word.
    """
    return parse(*matrix_files.read(given, settings))


def parse(name: str, content: Mapping[str, Any]) -> Matrix:
    """The matrix of a TOML file's content."""
    matrix_values.check_values(content)
    matrix_values.only(content, TABLES, "the matrix file", "table")
    content = protocols.expanded(content)
    protocol = matrix_values.table(content, "protocol")
    if "datasets" in protocol:
        raise BadData(
            "protocol.datasets names several data sets, but this takes one: give a file with "
            "dataset = {...}"
        )
    matrix_values.only(protocol, PROTOCOL_KEYS, "protocol", "key")
    num_samples = matrix_values.count(protocol, "num_samples", "protocol", 1)
    metrics = {**DEFAULT_METRICS, **matrix_values.table(content, "metrics")}
    matrix_values.only(metrics, tuple(DEFAULT_METRICS), "metrics", "key")
    matrix = Matrix(
        name=name,
        dataset=_dataset(protocol),
        num_past=matrix_values.count(protocol, "num_past", "protocol"),
        num_future=matrix_values.count(protocol, "num_future", "protocol"),
        size_px=matrix_values.size(protocol),
        stride=matrix_values.count(protocol, "stride", "protocol"),
        pose_sources=_entries(content, "pose_sources", num_samples),
        renderers=_named(content, "renderers"),
        predictors=_entries(content, "predictors", num_samples),
        frame_metrics=_stabilised(
            _metrics(metrics["frame"], "metrics.frame"), metrics["stabilised"]
        ),
        trajectory_metrics=_metrics(metrics["trajectory"], "metrics.trajectory"),
        device=matrix_values.device(protocol),
    )
    _check_cells(matrix)
    return matrix


def _check_cells(matrix: Matrix) -> None:
    if bool(matrix.pose_sources) != bool(matrix.renderers):
        given, lacking = (
            ("pose_sources", "renderers") if matrix.pose_sources else ("renderers", "pose_sources")
        )
        raise BadData(
            f"the matrix file has [{given}] but no [{lacking}]: a method needs one of each"
        )
    names = [cell.name for cell in matrix.cells]
    if not names:
        raise BadData(
            "the matrix file has no method: give [pose_sources] and [renderers], or [predictors]"
        )
    matrix_values.check_names(names, NOT_CELLS)
    matrix_values.check_clip(matrix.size_px, matrix.num_past + matrix.num_future)
    both = set(matrix.frame_metrics) & set(matrix.trajectory_metrics)
    if both:
        raise BadData(
            f"metrics: {min(both)!r} is a frame metric and a trajectory metric: rename one of them"
        )


def _dataset(protocol: Mapping[str, Any]) -> Spec:
    spec = matrix_values.spec(protocol.get("dataset"), "protocol.dataset")
    for key in FROM_PROTOCOL:
        if key in spec:
            raise BadData(
                f"protocol.dataset has {key!r}, which the harness sets: leave it out, "
                "[protocol] says it all"
            )
    return spec


def _entries(content: Mapping[str, Any], table: str, num_samples: int) -> dict[str, Entry]:
    entries = {}
    for name, spec in _named(content, table).items():
        samples = matrix_values.count(spec, "num_samples", f"{table}.{name}", num_samples)
        entries[name] = Entry(
            {key: value for key, value in spec.items() if key != "num_samples"}, samples
        )
    return entries


def _named(content: Mapping[str, Any], table: str) -> dict[str, Spec]:
    entries = matrix_values.table(content, table)
    for name in entries:
        if not ENTRY_NAME.fullmatch(name):
            where = f"{table}.{name}"
            raise BadData(
                f"{where}: an entry's name becomes a folder's, expected letters, digits and _ + "
                "= , . -"
            )
    return {name: matrix_values.spec(value, f"{table}.{name}") for name, value in entries.items()}


def _metrics(value: Any, where: str) -> dict[str, Spec]:
    named = matrix_values.named_specs(value, where)
    for name in named:
        if "@" in name or name in UNASKED:
            raise BadData(f"{where}: a column cannot be called {name!r}: give another name")
    return named


def _stabilised(frame: dict[str, Spec], names: Any) -> dict[str, Spec]:
    """The frame metrics, followed by the stabilised versions of those that are named."""
    if not isinstance(names, list):
        raise BadData(
            f'metrics.stabilised is {names!r}, expected a list of frame metrics such as ["psnr"]'
        )
    matrix_values.only(map(str, names), tuple(frame), "metrics.stabilised", "frame metric")
    twice = sorted({f"{name}-stabilised" for name in names} & set(frame))
    if twice:
        raise BadData(
            f"metrics.frame has {twice[0]!r}, as metrics.stabilised calls its own: give another "
            "name"
        )
    return frame | {
        f"{name}-stabilised": {"name": "stabilised", "metric": frame[name]} for name in names
    }
