"""Ids of protocols, and what rows say of their networks' weights."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from geovp_benchmarks.matrix.components import files_of, nested, weights_of
from geovp_benchmarks.results.provenance import protocol_id
from geovp_classic import registry

PSNR = {
    "role": "frame",
    "asked": {"name": "psnr"},
    "unit": "dB",
    "definition": "RGB jointly",
    "unavailable": None,
}
PROTOCOL: dict[str, Any] = {
    "dataset": {"name": "kitti", "split": "test", "root": "/here", "with_full": False},
    "split_hash": "ab",
    "num_past": 10,
    "num_future": 20,
    "size_px": [256, 256],
    "stride": 10,
    "clips": ["03/000180", "03/000190"],
    "metrics": {"psnr": PSNR},
    "versions": {"numpy": "1.26.4"},
}


@pytest.mark.parametrize(
    "change",
    [
        {"dataset": {**PROTOCOL["dataset"], "split": "val"}},
        {"split_hash": "cd"},
        {"num_past": 9},
        {"clips": ["03/000180"]},
        {"metrics": {"psnr": {**PSNR, "definition": "mean over channels"}}},
        {"metrics": {"psnr": {**PSNR, "asked": {"name": "psnr", "channels": "each"}}}},
    ],
)
def test_another_protocol_has_another_id(change: dict[str, Any]) -> None:
    assert protocol_id({**PROTOCOL, **change}) != protocol_id(PROTOCOL)


def test_the_same_protocol_elsewhere_has_the_same_id() -> None:
    elsewhere = {**PROTOCOL["dataset"], "root": "/there", "with_full": True}
    other = {**PROTOCOL, "dataset": elsewhere, "versions": {}, "methods": ["a"], "name": "other"}
    assert protocol_id(other) == protocol_id(PROTOCOL)
    assert len(protocol_id(PROTOCOL)) == 8


@dataclass(frozen=True)
class Trained:
    weights_note: str


@dataclass(frozen=True)
class Made:
    parts: tuple[Trained, ...]
    other: Trained


def test_weights_of_nested_parts_are_found_once_each() -> None:
    made = Made((Trained("a"), Trained("b")), Trained("a"))
    assert weights_of([made, Trained("c"), object()]) == ["a", "b", "c"]
    assert [type(part) for part in nested([made])] == [Made, Trained, Trained, Trained]


def test_files_of_any_sequence_count(tmp_path: Path) -> None:
    path = str(tmp_path / "{sequence}")
    depth = registry.build("depth_sources", {"name": "recorded", "path": path})
    hashes: set[str] = set()
    for content in ("1", "2"):
        (tmp_path / "03.txt").write_text(content)
        hashes.update(files_of([depth]))
    assert len(hashes) == 2
