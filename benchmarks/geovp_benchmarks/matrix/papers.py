"""Papers: one file for each, with its protocol, data, methods that reproduce it, and its numbers.

A file in the folder `papers` is a matrix file with two more tables: [paper] says what the protocol
is and where its data comes from, [published] holds the published numbers with their source.
Definitions of metrics are explained in docs/concepts/protocols.md.
"""

import tomllib
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict

from geovp_benchmarks.matrix import PAPERS
from geovp_benchmarks.matrix.values import Spec, Specs
from geovp_benchmarks.validation import validated
from geovp_classic.errors import UnknownComponent
from geovp_classic.registry import nearest


class PublishedRow(BaseModel):
    """A published row; `method` is the label of the method that reproduces it."""

    model_config = ConfigDict(frozen=True, extra="allow")  # lists of numbers by metric

    name: str
    method: str = ""
    bold: tuple[str, ...] = ()
    privileged_inputs: tuple[str, ...] = ()

    @property
    def numbers(self) -> Mapping[str, list[list[float]]]:
        """Return by metric, for each horizon, the mean and, if given, the standard error."""
        return self.model_extra or {}


class Published(BaseModel):
    """Published numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    source: str
    about: str
    decimals: int
    row: tuple[PublishedRow, ...]


class Paper(BaseModel):
    """The choices of a paper, and of the code that its numbers come from."""

    model_config = ConfigDict(frozen=True)

    name: str
    title: str
    data: str  # in words
    where: str  # the data comes from
    num_past: int
    num_future: int
    size_px: tuple[int, int]  # (width, height)
    stride: int  # frames between the starts of two clips
    dataset: Spec
    metrics: dict[str, Specs]  # by role
    published: Published
    num_clips: int | None = None
    num_samples: int = 1  # the best by the mean over steps counts, per clip and metric
    horizons: tuple[int, ...] = ()  # "t+k" is the mean over the first k frames; (): over all
    differences: str = ""  # from the paper


def names() -> list[str]:
    """Return the names of all papers."""
    return sorted(path.stem for path in PAPERS.glob("*.toml"))


def load(name: str) -> Paper:
    """Return the paper of a name; UnknownComponent has the nearest name."""
    if name not in names():
        raise UnknownComponent(
            f"there is no protocol {name!r}{nearest(name, names())}: `geovp list protocols` names "
            "all"
        )
    content = tomllib.loads((PAPERS / f"{name}.toml").read_text("utf-8"))
    tables = {key: content[key] for key in ("metrics", "published")}
    paper: Paper = validated(
        Paper, {"name": name, **content["protocol"], **content["paper"], **tables}
    )
    return paper


def expanded(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the matrix in a file's content, with the choices of the protocol that it names."""
    matrix = {key: value for key, value in content.items() if key not in ("paper", "published")}
    table = matrix.get("protocol")
    if not isinstance(table, Mapping) or not isinstance(table.get("name"), str):
        return matrix
    paper = load(table["name"])
    keys = {"dataset", "num_past", "num_future", "size_px", "stride"}
    choices = paper.model_dump(include=keys) | dict(table)
    del choices["name"]
    metrics = validated(dict[str, Any], matrix.get("metrics", {}), "metrics")
    return {**matrix, "protocol": choices, "metrics": {**paper.metrics, **metrics}}
