"""The glossary has all names that tables and settings can print."""

import re
from pathlib import Path

import pytest

from geovp_benchmarks.error_budget.oracles import STAGES
from geovp_benchmarks.results.score_names import ALWAYS_SCORED
from geovp_benchmarks.results.stored_facts import MARKS, title
from geovp_benchmarks.statistics.strata import DIVISIONS
from geovp_classic import registry
from tests import registered

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "glossary.md").read_text()


@pytest.mark.parametrize("role", registry.PROTOCOL_OF_ROLE)
def test_components_are_explained(role: str) -> None:
    missing = [name for name in registered.names(role) if f"`{name}`" not in PAGE]
    assert not missing


def test_letters_of_privileged_inputs_are_explained() -> None:
    letters = re.findall(r"^\| `([a-z])` \|", PAGE, re.MULTILINE)
    assert sorted(letters) == sorted(letter for letter, _ in MARKS.values())


def test_columns_stages_and_attributes_are_explained() -> None:
    metrics = [*registered.names("frame_metrics"), *registered.names("trajectory_metrics")]
    columns = [title(name) for name in (*metrics, *ALWAYS_SCORED) if name != "stabilised"]
    strata = ["covered", "seen", "disoccluded", "static", "moving"]
    attributes = [f"`{name}`" for name in DIVISIONS]
    statuses = ["done", "partial", "skipped", "failed"]
    terms = [*columns, *strata, *attributes, *STAGES, *statuses]
    assert [term for term in terms if term not in PAGE] == []


def test_an_installed_plug_in_need_not_be_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "far_ahead-0.1.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: far-ahead\nVersion: 0.1\n")
    (folder / "entry_points.txt").write_text("[geovp.forecasters]\nhover = far_ahead:Hover\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry._entry_points.cache_clear()
    assert "hover" in registry.names("forecasters")
    test_components_are_explained("forecasters")
    registry._entry_points.cache_clear()
