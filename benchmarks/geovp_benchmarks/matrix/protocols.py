"""Protocols of papers by name: which frames are seen and predicted, how they are scored, what a
table's numbers mean.

A matrix file follows one with `[protocol] name = "fvs20"`; what is given beside the name replaces
the protocol's own choice, so that another data set can be measured in its form.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geovp_benchmarks.matrix.matrix_values import Spec
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.registry import nearest


@dataclass(frozen=True)
class Protocol:
    """The choices of a paper, and of the code that its numbers come from."""

    name: str
    paper: str
    data: str  # in words
    num_past: int
    num_future: int
    size_px: tuple[int, int]  # (width, height)
    stride: int  # frames between the starts of two clips
    metrics: Mapping[str, Spec]  # by column
    dataset: Spec | None = None  # without its root; None where no reader of ours reads it
    num_clips: int | None = None
    num_samples: int = 1  # the best one counts, chosen per clip and metric by its mean over steps
    horizons: tuple[
        int, ...
    ] = ()  # "t+k" in tables is the mean over the first k frames; with none, over all frames
    differences: str = ""  # what cannot be done here as it is done there

    @property
    def about(self) -> str:
        """All of it in a few lines."""
        clips = f"{self.num_clips:,} clips" if self.num_clips else "number of clips not given"
        values = "; ".join(f"t+{k} is the mean over the first {k}" for k in self.horizons)
        best = f"best of {self.num_samples} per clip and metric" if self.num_samples > 1 else ""
        lines = [
            f"{self.name}: {self.paper}",
            f"{self.data}; {self.size_px[0]}x{self.size_px[1]}, {self.num_past} seen, the next "
            f"{self.num_future} "
            f"predicted; {clips}, stride {self.stride}",
            f"metrics: {', '.join(_words(column, spec) for column, spec in self.metrics.items())}",
            "; ".join(filter(None, (best, values or "means over all predicted frames"))),
            f"differs here: {self.differences}" if self.differences else "",
        ]
        return "\n  ".join(filter(None, lines))


def _words(column: str, spec: Spec) -> str:
    settings = ", ".join(f"{key} {value}" for key, value in spec.items() if key != "name")
    return f"{column} ({settings})" if settings else column


def _all() -> dict[str, Protocol]:
    tables: dict[str, dict[str, Any]] = tomllib.loads(
        Path(__file__).with_suffix(".toml").read_text("utf-8")
    )
    for fields in tables.values():
        fields |= {key: tuple(fields[key]) for key in ("size_px", "horizons") if key in fields}
    return {name: Protocol(name=name, **fields) for name, fields in tables.items()}


ALL: Mapping[str, Protocol] = _all()


def load(name: str) -> Protocol:
    """The protocol of a name; UnknownComponent with the nearest one."""
    if name not in ALL:
        raise UnknownComponent(f"there is no protocol {name!r}{nearest(name, tuple(ALL))}")
    return ALL[name]


def matrix_protocol(
    name: str, root: Path | str | None = None, dataset: Spec | None = None
) -> dict[str, Any]:
    """The tables `protocol` and `metrics` of a matrix; `dataset` replaces the protocol's own, in
    its form.

    BadData for a protocol whose data nothing here reads, unless another data set is given.
    """
    protocol = load(name)
    chosen = dataset if dataset is not None else protocol.dataset
    if chosen is None:
        raise BadData(
            f"{name} is measured on {protocol.data}, which nothing here reads: give dataset = "
            f"{{ ... }}"
        )
    where = {} if root is None else {"root": str(root)}
    form = {
        "num_past": protocol.num_past,
        "num_future": protocol.num_future,
        "stride": protocol.stride,
    }
    table = {"dataset": {**chosen, **where}, **form, "size_px": list(protocol.size_px)}
    return {"protocol": table, "metrics": {"frame": dict(protocol.metrics)}}


def expanded(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """A matrix file's content with its protocol's name spelled out; as it is where there is no
    name.
    """
    given = content.get("protocol")
    if not isinstance(given, Mapping) or not isinstance(given.get("name"), str):
        return content
    tables = matrix_protocol(given["name"], given.get("root"), given.get("dataset"))
    own = {key: value for key, value in given.items() if key not in ("name", "root", "dataset")}
    metrics = {**tables["metrics"], **content.get("metrics", {})}
    return {**content, "protocol": {**tables["protocol"], **own}, "metrics": metrics}
