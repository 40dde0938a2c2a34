"""The Dockerfile builds and runs where docker runs; elsewhere its instructions are checked."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def instructions() -> list[list[str]]:
    """Return the words of each instruction, with continued lines joined."""
    text = re.sub(r"\\\n\s*", "", (ROOT / "Dockerfile").read_text())
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [line.split() for line in lines]


def test_sources_exist_and_pass_the_ignore_file() -> None:
    allowed = (ROOT / ".dockerignore").read_text().splitlines()
    copies = [words[1:-1] for words in instructions() if words[0] == "COPY"]
    sources = [name for names in copies if not names[0].startswith("--from=") for name in names]
    assert len(sources) > 4
    for name in sources:
        assert (ROOT / name).exists(), name
        assert f"!{name}" in allowed, name


def test_the_image_lists_its_components() -> None:
    docker = shutil.which("docker")
    if (
        docker is None
        or subprocess.run([docker, "info"], capture_output=True, check=False).returncode
    ):
        pytest.skip("no docker daemon can be reached")
    subprocess.run([docker, "build", "--quiet", "--tag", "geovp-test", ROOT], check=True)
    command = [docker, "run", "--rm", "geovp-test", "list"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "depth-fusion" in done.stdout
