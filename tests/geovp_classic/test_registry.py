"""The registry builds checked components from names and tables, and describes them again."""

from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from geovp_classic import registry
from geovp_classic.errors import BadData, MissingExtra, UnknownComponent
from geovp_classic.interfaces import Forecaster, Odometry, PoseSource
from geovp_classic.types import BoolArray, Context, FloatArray, Motion, PrivilegedInput, Trajectory


@dataclass(frozen=True)
class Drift:
    """A forecaster with one field of each plain type."""

    speed_m_s: float = 1.0
    steps: int = 3
    mode: Literal["slow", "fast"] = "slow"
    size_px: tuple[int, int] = (4, 5)
    tags: tuple[str, ...] = ()
    path: Path | None = None
    loud: bool = False

    def forecast(self, past: Trajectory, times_s: FloatArray, num_samples: int = 1) -> FloatArray:
        return np.tile(past.world_from_cam[-1], (num_samples, len(times_s), 1, 1))


@dataclass(frozen=True)
class Walk:
    """A pose source with a nested component and a field without a default."""

    forecaster: Forecaster
    odometry: Odometry | None = None
    needs: ClassVar[PrivilegedInput] = PrivilegedInput.PAST_POSES

    def estimate(self, context: Context, num_samples: int = 1) -> Motion:
        raise NotImplementedError


class NotADataclass:
    pass


COMPONENTS = {
    "geovp.forecasters": {"drift": "Drift", "odd": "NotADataclass", "gone": "Gone"},
    "geovp.pose_sources": {"walk": "Walk"},
}


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Register this file's components and one whose package is missing."""

    def entry_points(*, group: str) -> list[metadata.EntryPoint]:
        classes = COMPONENTS.get(group, {})
        points = [metadata.EntryPoint(n, f"{__name__}:{c}", group) for n, c in classes.items()]
        return [*points, metadata.EntryPoint("deep", "a_missing_module:Deep", group)]

    def load(point: metadata.EntryPoint) -> Any:
        if point.module != __name__:
            raise ModuleNotFoundError("No module named 'torch'", name="torch")
        if point.attr not in globals():
            raise AttributeError(f"module has no attribute {point.attr!r}")
        return globals()[point.attr]

    monkeypatch.setattr(metadata, "entry_points", entry_points)
    monkeypatch.setattr(metadata.EntryPoint, "load", load)
    registry._entry_points.cache_clear()
    yield
    monkeypatch.undo()
    registry._entry_points.cache_clear()


def test_describe_is_the_inverse_of_build() -> None:
    drift = {"name": "drift", "speed_m_s": 2, "size_px": [7, 8], "tags": ["a"], "path": "x"}
    walk = registry.build("pose_sources", {"name": "walk", "forecaster": drift})
    assert walk == Walk(Drift(speed_m_s=2.0, size_px=(7, 8), tags=("a",), path=Path("x")))
    assert isinstance(walk, PoseSource)
    table = registry.describe(walk)
    assert table["forecaster"]["steps"] == 3  # defaults are included
    assert registry.build("pose_sources", table) == walk
    assert registry.build("forecasters", {"name": "drift", "path": None}) == Drift()


def test_defaults_reach_nested_components() -> None:
    with registry.defaults(steps=7):
        walk = registry.build("pose_sources", {"name": "walk", "forecaster": "drift"})
    assert walk.forecaster == Drift(steps=7)


@pytest.mark.parametrize(
    ("role", "spec", "message"),
    [
        ("forecasters", {"name": "drfit"}, "did you mean 'drift'"),
        ("forecasters", {"name": "drift", "sped_m_s": 1}, "did you mean 'speed_m_s'"),
        ("forecaster", {"name": "drift"}, "did you mean 'forecasters'"),
        ("pose_sources", {"name": "walk", "forecaster": {"name": "drfit"}}, "mean 'drift'"),
    ],
)
def test_mistyped_words_get_the_nearest_right_one(role: str, spec: Any, message: str) -> None:
    with pytest.raises(UnknownComponent, match=message):
        registry.build(role, spec)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("speed_m_s", "fast", r"forecasters.speed_m_s is 'fast', expected a number"),
        ("steps", 1.5, "expected a whole number"),
        ("loud", 1, "expected true or false"),
        ("mode", "fsat", "did you mean 'fast'"),
        ("size_px", [1, 2, 3], "has 3 values, expected 2"),
        ("size_px", [1, "b"], r"size_px\[1\] is 'b'"),
        ("tags", "03", r'tags is .03., expected a list, as \["03"\]$'),
        ("tags", 10, r'is 10, expected a list, as \["10"\]$'),
        ("tags", [10], r"tags\[0\] is 10, expected a text in quotes"),
        ("path", 3, "expected a path"),
    ],
)
def test_a_value_of_another_type_is_named(field: str, value: Any, message: str) -> None:
    with pytest.raises(BadData, match=message):
        registry.build("forecasters", {"name": "drift", field: value})


@pytest.mark.parametrize("spec", [3, {}, {"name": 5}, {"name": "walk"}])
def test_an_incomplete_table_is_refused(spec: Any) -> None:
    with pytest.raises(BadData, match=r"expected a table|needs the field"):
        registry.build("pose_sources", spec)


def test_components_that_cannot_be_used_are_still_listed() -> None:
    assert registry.names("forecasters") == ["deep", "drift", "gone", "odd"]
    with pytest.raises(MissingExtra, match=r"pip install 'geovp\[learned\]'"):
        registry.build("forecasters", "deep")
    with pytest.raises(MissingExtra, match="cannot be loaded"):
        registry.build("forecasters", "gone")
    with pytest.raises(BadData, match="not a dataclass"):
        registry.build("forecasters", "odd")


def test_an_unregistered_component_cannot_be_described() -> None:
    @dataclass(frozen=True)
    class Private:
        tracked: BoolArray | None = None

    with pytest.raises(UnknownComponent, match="not registered"):
        registry.describe(Private())
