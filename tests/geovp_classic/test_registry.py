"""One door: names in, checked components out, and the way back."""

import pathlib
from dataclasses import dataclass
from importlib import metadata
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.errors import BadData, MissingExtra, UnknownComponent
from geovp_classic.interfaces import Forecaster, Odometry, PoseSource
from geovp_classic.types import BoolArray, Context, FloatArray, Motion, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class Drift:
    """A forecaster with one field of every plain kind."""

    speed_m_s: float = 1.0
    steps: int = 3
    mode: Literal["slow", "fast"] = "slow"
    size_px: tuple[int, int] = (4, 5)
    tags: tuple[str, ...] = ()
    path: pathlib.Path | None = None
    loud: bool = False

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        return np.tile(past.world_from_cam[-1], (num_samples, len(times_s), 1, 1))


@dataclass(frozen=True)
class Walk:
    """A pose source that holds another component and has one field without a default."""

    forecaster: Forecaster
    odometry: Odometry | None = None
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        futures = self.forecaster.forecast(
            context.past, context.times_s[context.num_past :], num_samples
        )
        return Motion(context.past, futures, np.ones(context.num_past, bool))


class NotADataclass:
    pass


HERE = __name__
REGISTERED: dict[str, dict[str, str]] = {
    "geovp.forecasters": {"drift": "Drift", "odd": "NotADataclass", "gone": "Gone"},
    "geovp.pose_sources": {"walk": "Walk"},
}


@pytest.fixture(autouse=True)
def door(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A registry that holds this file's components and one whose package is missing."""

    def entry_points(*, group: str) -> list[metadata.EntryPoint]:
        found = [
            metadata.EntryPoint(n, f"{HERE}:{c}", group)
            for n, c in REGISTERED.get(group, {}).items()
        ]
        if group == "geovp.forecasters":
            found.append(metadata.EntryPoint("deep", "a_missing_module:Deep", group))
        return found

    def load(point: metadata.EntryPoint) -> Any:
        module, _, attribute = point.value.partition(":")
        if module == HERE:
            return {"Drift": Drift, "Walk": Walk, "NotADataclass": NotADataclass}.get(
                attribute
            ) or fail(attribute)
        raise ModuleNotFoundError("No module named 'torch'", name="torch")

    def fail(attribute: str) -> None:
        raise AttributeError(f"module has no attribute {attribute!r}")

    monkeypatch.setattr(metadata, "entry_points", entry_points)
    monkeypatch.setattr(metadata.EntryPoint, "load", load)
    registry._entry_points.cache_clear()
    yield
    monkeypatch.undo()
    registry._entry_points.cache_clear()


def test_describe_undoes_build() -> None:
    spec = {
        "name": "walk",
        "forecaster": {
            "name": "drift",
            "speed_m_s": 2,
            "size_px": [7, 8],
            "tags": ["a"],
            "path": "x",
        },
    }
    built = registry.build("pose_sources", spec)
    assert built == Walk(Drift(speed_m_s=2.0, size_px=(7, 8), tags=("a",), path=pathlib.Path("x")))
    assert isinstance(built, PoseSource)
    table = registry.describe(built)
    assert table["forecaster"]["steps"] == 3  # defaults are spelled out
    assert registry.build("pose_sources", table) == built
    assert registry.describe(registry.build("pose_sources", table)) == table


def test_a_bare_name_is_a_component_with_its_defaults() -> None:
    assert registry.build("forecasters", "drift") == Drift()


@pytest.mark.parametrize(
    ("role", "spec", "message"),
    [
        ("forecasters", {"name": "drfit"}, "did you mean 'drift'"),
        (
            "forecasters",
            {"name": "drift", "sped_m_s": 1},
            "no field 'sped_m_s': did you mean 'speed_m_s'",
        ),
        ("forecaster", {"name": "drift"}, "did you mean 'forecasters'"),
        ("pose_sources", {"name": "walk", "forecaster": {"name": "drfit"}}, "did you mean 'drift'"),
    ],
)
def test_mistyped_words_get_the_nearest_right_one(role: str, spec: Any, message: str) -> None:
    with pytest.raises(UnknownComponent, match=message):
        registry.build(role, spec)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"speed_m_s": "fast"}, r"forecasters.speed_m_s is 'fast', expected a number"),
        ({"speed_m_s": True}, "expected a number"),
        ({"steps": 1.5}, "expected a whole number"),
        ({"steps": True}, "expected a whole number"),
        ({"loud": 1}, "expected true or false"),
        ({"mode": "fsat"}, "did you mean 'fast'"),
        ({"size_px": [1, 2, 3]}, "has 3 values, expected 2"),
        ({"size_px": [1, "b"]}, r"size_px\[1\] is 'b'"),
        ({"path": 3}, "expected a path"),
    ],
)
def test_wrong_field_types_are_named(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(BadData, match=message):
        registry.build("forecasters", {"name": "drift", **fields})


def test_what_is_no_table_or_lacks_a_field_is_refused() -> None:
    for spec in (3, {}, {"name": 5}):
        with pytest.raises(BadData, match="expected a table"):
            registry.build("forecasters", spec)
    with pytest.raises(BadData, match="needs the field 'forecaster'"):
        registry.build("pose_sources", {"name": "walk"})
    with pytest.raises(BadData, match="not a dataclass"):
        registry.build("forecasters", "odd")


def test_missing_packages_name_their_extra_and_names_are_listed_all_the_same() -> None:
    assert registry.names("forecasters") == ["deep", "drift", "gone", "odd"]
    with pytest.raises(MissingExtra, match=r"pip install .*\[learned\]'"):
        registry.build("forecasters", "deep")
    with pytest.raises(MissingExtra, match="cannot be loaded"):
        registry.build("forecasters", "gone")


def test_an_unregistered_component_cannot_be_described() -> None:
    @dataclass(frozen=True)
    class Private:
        tracked: BoolArray | None = None

    with pytest.raises(UnknownComponent, match="not registered"):
        registry.describe(Private())
