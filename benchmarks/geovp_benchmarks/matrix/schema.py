"""Schema of a matrix file: one protocol, and all components that run under it."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict

from geovp_benchmarks.matrix import files, papers
from geovp_benchmarks.matrix.values import (
    Count,
    Device,
    FolderName,
    IsNamed,
    Size,
    Spec,
    Specs,
)
from geovp_benchmarks.results.records import Method
from geovp_benchmarks.results.score_names import ALWAYS_SCORED
from geovp_benchmarks.validation import validated
from geovp_classic import registry
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.types import PrivilegedInput


class Table(BaseModel):
    """A table of a matrix file."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Component(Table):
    """A component by its name, with its fields."""

    model_config = ConfigDict(extra="allow")  # the fields

    name: str
    num_samples: Count | None = None  # None: as many as the protocol says

    @property
    def spec(self) -> Spec:
        """Return the component as `registry.build` takes it."""
        return {"name": self.name, **(self.model_extra or {})}


def _check_dataset(spec: Spec) -> Spec:
    """Raise ValueError for fields that the protocol sets."""
    for key in ("num_frames", "stride", "size_px", "with_full", "with_right"):
        if key in spec:
            raise ValueError(f"expected no {key!r}, which the harness sets: leave it out")
    return spec


class ProtocolTable(Table):
    """The table [protocol]: which frames are observed and predicted."""

    dataset: Annotated[Spec, AfterValidator(_check_dataset)]
    root: Path | None = None  # of the data set, in place of its own
    num_past: Count
    num_future: Count
    size_px: Size
    stride: Count
    num_samples: Count = 1
    device: Device | None = None  # of networks that do not name one; None: their own default


class MetricsTable(Table):
    """The table [metrics]: components by the names of their columns."""

    frame: Specs = {name: {"name": name} for name in ("psnr", "ssim", "lpips")}
    trajectory: Specs = {name: {"name": name} for name in ("translation-error", "rotation-error")}
    set: Specs = {}


class ComponentTables(Table):
    """The tables of the components that predict."""

    pose_sources: dict[FolderName, Annotated[Component, IsNamed]] = {}
    renderers: dict[FolderName, Spec] = {}
    predictors: dict[FolderName, Annotated[Component, IsNamed]] = {}


class MatrixFile(ComponentTables):
    """The content of a matrix file."""

    protocol: ProtocolTable
    metrics: MetricsTable = MetricsTable()


class Matrix(ProtocolTable, ComponentTables):
    """A matrix: what its file asks for, with the components still to be built."""

    name: str
    dataset: Spec  # of stored results with the fields that the protocol sets, too
    metrics: dict[str, Specs]  # by role
    selected: tuple[str, ...] = ()  # labels of methods, in this order; empty: all
    max_samples: int | None = None  # of each method

    @property
    def methods(self) -> tuple[Method, ...]:
        """Return the selected methods.

        All are the pose sources with each renderer, then the predictors, in the file's order.
        """
        geometric = [
            Method.of(self._num_samples(entry), source, renderer)
            for source, entry in self.pose_sources.items()
            for renderer in self.renderers
        ]
        predictors = (
            Method.of(self._num_samples(entry), name) for name, entry in self.predictors.items()
        )
        methods = {method.label: method for method in (*geometric, *predictors)}
        return tuple(methods[label] for label in self.selected or methods)

    def _num_samples(self, entry: Component) -> int:
        """Return the number of samples that an entry is asked for."""
        num_samples = entry.num_samples or self.num_samples
        return min(num_samples, self.max_samples or num_samples)

    def select(self, *labels: str) -> Self:
        """Return the matrix with these methods only; UnknownComponent names the nearest label."""
        available = [method.label for method in self.methods]
        for label in labels:
            if label not in available:
                nearest = registry.nearest(label, available)
                raise UnknownComponent(f"{self.name} has no method {label!r}{nearest}")
        return self.model_copy(update={"selected": labels})

    def predictor_spec(self, label: str) -> Spec:
        """Return a method as a predictor; UnknownComponent names the nearest label."""
        selected = self.select(label)
        (method,) = selected.methods
        specs = {role: selected.specs[key] for role, key in method.entries.items()}
        return specs.get("predictor") or {"name": "geometric", **specs}

    @property
    def specs(self) -> dict[tuple[str, str], Spec]:
        """Return the components of the methods by role and name."""
        keys = [key for method in self.methods for key in method.entries.values()]
        entries = {(role, name): getattr(self, role)[name] for role, name in keys}
        return {
            key: entry.spec if isinstance(entry, Component) else entry
            for key, entry in entries.items()
        }

    def override(self, **settings: Any) -> Self:
        """Return the matrix with settings in place of those of its file, without None."""
        given = {key: value for key, value in settings.items() if value is not None}
        return self.model_copy(update=given)

    @property
    def data_root(self) -> Path | None:
        """Return the root of the data set; BadData for a variable that is not set."""
        given = self.root or self.dataset.get("root") or self.dataset.get("path")
        if not given or not isinstance(given, (str, Path)):
            return None
        root = os.path.expandvars(given)
        if "$" in root or not root:
            raise BadData(
                f"the root of the data set is {given!s}, which is not set: set it, or give "
                "--root FOLDER"
            )
        return Path(root)

    def build_dataset(self, needs: PrivilegedInput) -> Any:
        """Build the data set with the protocol's clips and the views that components need."""
        spec, root = self.dataset, self.data_root
        if root is not None:
            if not root.expanduser().exists():
                raise BadData(
                    f"the folder of the data set, {root}, does not exist: give the place of the "
                    "data as --root FOLDER"
                )
            spec = spec | {"path" if "path" in spec else "root": str(root)}
        with registry.defaults(
            num_frames=self.num_past + self.num_future,
            stride=self.stride,
            size_px=self.size_px,
            with_full=PrivilegedInput.FULL_FRAMES in needs,
            with_right=PrivilegedInput.RIGHT_FRAMES in needs,
        ):
            return registry.build("datasets", spec, "protocol.dataset")


def read(path: Path, settings: Sequence[str] = ()) -> Matrix:
    """Return the matrix of a TOML file, or of a built-in one by name.

    Settings such as "protocol.stride=20" replace those of the file. BadData or UnknownComponent
    names the place in the file and the nearest known word.
    """
    return parse(*files.read(path, settings))


def parse(name: str, content: Mapping[str, Any]) -> Matrix:
    """Return the matrix of a TOML file's content."""
    content = papers.expanded(content)
    try:
        json.dumps(content, allow_nan=False)
    except (TypeError, ValueError) as problem:  # such as a date or NaN, which results cannot hold
        raise BadData(
            f"the matrix file has another value than numbers and text: {problem}"
        ) from problem
    file = validated(MatrixFile, content)
    metrics = dict(file.metrics)
    _check_columns([name for specs in metrics.values() for name in specs])
    tables = file.model_dump(exclude={"metrics", "protocol"}) | file.protocol.model_dump()
    matrix = Matrix(name=name, metrics=metrics, **tables)
    _check_methods(matrix)
    return matrix


def _check_columns(names: list[str]) -> None:
    """Raise BadData unless names can be columns of a table."""
    for name in names:
        if name in ALWAYS_SCORED or names.count(name) > 1:
            raise BadData(
                f"metrics: a column cannot be called {name!r}, which is reserved or stands "
                "there twice: give another name"
            )


def _check_methods(matrix: Matrix) -> None:
    """Raise BadData unless there are methods, with folders of their own."""
    if bool(matrix.pose_sources) != bool(matrix.renderers) or not matrix.methods:
        raise BadData(
            "the matrix file has no complete method: give [pose_sources] and [renderers], or "
            "[predictors]"
        )
    names = [method.name for method in matrix.methods]
    reserved = "clips tables plots protocol.json method.json report.html .lock"
    folders = [name.casefold() for name in (*reserved.split(), *names)]  # on every file system
    for name in names:
        if folders.count(name.casefold()) > 1:
            raise BadData(
                f"two folders of the results would be called {name!r}: rename an entry of the "
                "matrix file"
            )
