"""The toy components, registered for the time of a test like any installed package's."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks import workshop
from geovp_classic import registry

TOYS = Path(__file__).parent / "toys"


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder that has to be on the path for the toys to be found, already on ours."""
    monkeypatch.syspath_prepend(str(TOYS))
    registry._entry_points.cache_clear()
    workshop.workshop.cache_clear()
    yield TOYS
    registry._entry_points.cache_clear()
    workshop.workshop.cache_clear()
