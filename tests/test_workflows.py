"""The GitHub workflows call what `.ci/run` and a release need, and hold no secrets."""

import os
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]


def jobs(name: str) -> dict[str, Any]:
    """Return the jobs of a workflow."""
    return yaml.safe_load((ROOT / ".github/workflows" / name).read_text())["jobs"]


def test_ci_runs_the_checks_on_every_python_of_the_classifiers() -> None:
    checks = jobs("ci.yml")["checks"]
    assert {"run": ".ci/run"} in checks["steps"]
    assert os.access(ROOT / ".ci/run", os.X_OK)
    metadata = (ROOT / "pyproject.toml").read_text()
    for version in checks["strategy"]["matrix"]["python"]:
        assert f"Programming Language :: Python :: {version}" in metadata


def test_a_release_is_checked_before_it_is_published() -> None:
    release = jobs("release.yml")
    commands = [step.get("run") for step in release["build"]["steps"]]
    assert commands.index("python -m build") < commands.index(
        "python -m twine check --strict dist/*"
    )
    assert release["publish"]["needs"] == release["attach"]["needs"] == "build"
    assert release["publish"]["permissions"] == {"id-token": "write"}


@pytest.mark.parametrize("name", ["ci.yml", "release.yml"])
def test_no_workflow_uses_a_secret(name: str) -> None:
    assert "secrets." not in (ROOT / ".github/workflows" / name).read_text()
