"""What README, citation and site promise: length, picture, links, numbers of a page of results,
equations.
"""

import re
import runpy
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name
)
def test_links_lead_to_files(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)", page.read_text())
    missing = [link for link in links if not link.startswith("http") and not (ROOT / link).exists()]
    assert not missing
    assert len(links) > 5 or page.name != "README.md"


def rows(page: Path) -> dict[str, list[str]]:
    """Entries of a page's first table that has them by the first column, without bold; other
    columns may follow.
    """
    lines = [
        line.strip("|").split("|")
        for line in page.read_text().splitlines()
        if line.startswith("| ")
    ]
    return {
        first.strip(): [entry.replace("*", "").strip() for entry in more]
        for first, *more in reversed(lines)
    }


def test_the_readmes_numbers_are_those_of_the_results_page() -> None:
    shown, printed = rows(ROOT / "README.md"), rows(ROOT / "docs/results/fusion.md")
    methods = [
        name for name in shown if name in printed and name != "method" and not name.startswith("-")
    ]
    assert len(methods) == 6
    for name in methods:
        assert shown[name] == printed[name][: len(shown[name])], name


def test_the_citation_is_of_this_version() -> None:
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {PYPROJECT['project']['version']}\n" in citation
    assert f"\nlicense: {PYPROJECT['project']['license']}\n" in citation


def test_equations_become_mathml() -> None:
    pytest.importorskip("latex2mathml", reason="the extra docs is not installed")
    hook = runpy.run_path(str(ROOT / "docs/mathml.py"))["on_page_content"]
    inline = hook(r'<p>with <span class="arithmatex">\(a &lt; b\)</span></p>')
    assert re.search(
        r'<p>with <span><math [^>]*display="inline">.*<mi>a</mi>.*<mi>b</mi>.*</math></span></p>',
        inline,
    )
    assert 'display="block"' in hook('<div class="arithmatex">\\[x\\]</div>')
    assert hook("<p>no formula</p>") == "<p>no formula</p>"
