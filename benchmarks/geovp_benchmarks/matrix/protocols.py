"""Protocols of papers: observed and predicted frames, metrics, and the meaning of the numbers.

A matrix file follows one with `[protocol] name = "fvs20"`. Other keys replace the
protocol's choices, so that another data set can be measured in its form.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from geovp_benchmarks.matrix.values import Spec, Specs
from geovp_benchmarks.results.validation import validated
from geovp_classic.errors import BadData, UnknownComponent
from geovp_classic.registry import nearest


class Protocol(BaseModel):
    """The choices of a paper, and of the code that its numbers come from."""

    model_config = ConfigDict(frozen=True)

    name: str
    paper: str
    data: str  # in words
    num_past: int
    num_future: int
    size_px: tuple[int, int]  # (width, height)
    stride: int  # frames between the starts of two clips
    metrics: Specs
    dataset: Spec | None = None  # without its root; None: no reader of ours reads it
    num_clips: int | None = None
    num_samples: int = 1  # the best by the mean over steps counts, per clip and metric
    horizons: tuple[int, ...] = ()  # "t+k" is the mean over the first k frames; (): over all
    differences: str = ""  # from the paper


TABLES = Path(__file__).with_suffix(".toml")


def load(name: str) -> Protocol:
    """Return the protocol of a name; UnknownComponent has the nearest name."""
    protocols = tomllib.loads(TABLES.read_text("utf-8"))
    if name not in protocols:
        raise UnknownComponent(f"there is no protocol {name!r}{nearest(name, protocols)}")
    return Protocol(name=name, **protocols[name])


def expanded(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a matrix file's content with the choices of the protocol that it names, if any.

    BadData for a protocol with data that no reader reads, unless the file has another data set.
    """
    table = content.get("protocol")
    if not isinstance(table, Mapping) or not isinstance(table.get("name"), str):
        return content
    protocol = load(table["name"])
    keys = {"dataset", "num_past", "num_future", "size_px", "stride"}
    choices = protocol.model_dump(include=keys, exclude_none=True) | dict(table)
    if "dataset" not in choices:
        raise BadData(
            f"{protocol.name} is measured on {protocol.data}, which nothing here reads: give "
            "dataset = { ... }"
        )
    del choices["name"]
    metrics = validated(dict[str, Any], content.get("metrics", {}), "metrics")
    return {**content, "protocol": choices, "metrics": {"frame": protocol.metrics, **metrics}}
