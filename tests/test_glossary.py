"""The glossary has all names that tables and settings can print."""

import re
from pathlib import Path

import pytest

from geovp_benchmarks.analysis.strata import DIVISIONS
from geovp_benchmarks.evaluation.oracles import STAGES
from geovp_benchmarks.results.score_names import ALWAYS_SCORED
from geovp_benchmarks.results.stored_facts import MARKS, title
from geovp_classic import registry

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "glossary.md").read_text()


@pytest.mark.parametrize("role", registry.PROTOCOL_OF_ROLE)
def test_components_are_explained(role: str) -> None:
    missing = [name for name in registry.names(role) if f"`{name}`" not in PAGE]
    assert not missing


def test_letters_of_privileged_inputs_are_explained() -> None:
    letters = re.findall(r"^\| `([a-z])` \|", PAGE, re.MULTILINE)
    assert sorted(letters) == sorted(letter for letter, _ in MARKS.values())


def test_columns_stages_and_attributes_are_explained() -> None:
    metrics = [*registry.names("frame_metrics"), *registry.names("trajectory_metrics")]
    columns = [title(name) for name in (*metrics, *ALWAYS_SCORED) if name != "stabilised"]
    strata = ["covered", "seen", "disoccluded", "static", "moving"]
    attributes = [f"`{name}`" for name in DIVISIONS]
    statuses = ["done", "partial", "skipped", "failed"]
    terms = [*columns, *strata, *attributes, *STAGES, *statuses]
    assert [term for term in terms if term not in PAGE] == []
