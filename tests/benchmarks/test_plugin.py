"""A component in somebody else's package, installed by pip, is found by name and runs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from geovp_benchmarks.results.store import Results
from tests.benchmarks.made import content, write_matrix

PROJECT = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"

[project]
name = "far-away-methods"
version = "0.1"

[project.entry-points."geovp.predictors"]
grey = "far_away_methods:Grey"

[tool.setuptools]
py-modules = ["far_away_methods"]
"""
MODULE = '''
"""One predictor that knows nothing of the harness."""
from dataclasses import dataclass

import numpy as np

from geovp_classic.types import Context, PrivilegedInput, Prediction


@dataclass(frozen=True)
class Grey:
    """The same grey everywhere."""

    level: int = 128
    needs = PrivilegedInput.NONE

    def predict(self, context: Context, num_samples: int = 1) -> Prediction:
        shape = (1, context.num_future, *context.frames.shape[1:])
        return Prediction(np.full(shape, self.level, np.uint8))
'''


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which pip has put the package."""
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("site")
    (source / "pyproject.toml").write_text(PROJECT)
    (source / "far_away_methods.py").write_text(MODULE)
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
    ]
    subprocess.run([*command, "--target", str(target), str(source)], check=True)
    return target


def geovp(installed: Path, toys: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(installed), str(toys), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "geovp_benchmarks.cli", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}, check=False
    )


def test_it_runs_in_a_matrix(installed: Path, toys: Path, tmp_path: Path) -> None:
    path = write_matrix(
        tmp_path / "m.toml",
        content({"clips": 1}, predictors={"dark": {"name": "grey", "level": 13}}),
    )
    done = geovp(installed, toys, "run", str(path), "--out", str(tmp_path / "out"), "--no-report")
    assert done.returncode == 0, done.stderr
    method = Results(tmp_path / "out").by_name()["dark"]
    assert method.components == {"predictor": {"name": "grey", "level": 13}}
    # the real frames of steps 3 and 4 have the grey levels 3 and 4
    (values,) = Results(tmp_path / "out").scores("dark").values.values()
    assert values.ravel().tolist() == [10.0, 9.0]
