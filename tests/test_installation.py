"""What `pip install .` brings suffices but for what extras are for, and who lacks one is told
which.
"""

import json
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from geovp_classic import registry

EXTRAS = (
    "torch",
    "safetensors",
    "lightning",
    "dask",
    "distributed",
    "open3d",
    "av",
    "rerun",
    "argcomplete",
)
DEVELOPMENT = ("evo", "pytest", "hypothesis")
BLOCK = """
import sys
class Blocked:
    def find_spec(name, *_):
        if name.partition(".")[0] in {modules!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocked)
"""


def without(modules: tuple[str, ...], code: str) -> subprocess.CompletedProcess[str]:
    """The code in a Python that has not got these modules."""
    return subprocess.run(
        [sys.executable, "-c", BLOCK.format(modules=modules) + code],
        capture_output=True,
        text=True,
        check=False,
    )


def test_everything_but_what_extras_are_for_is_imported_without_them() -> None:
    code = """
import importlib, pkgutil
for package in ("geovp_classic", "geovp_benchmarks"):
    found = pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}.")
    for name in (one.name for one in found):
        if not (".performance" in name or name.endswith((".__main__", ".volume", ".volume_fusion"))):
            importlib.import_module(name)
print(sum(name.startswith("geovp_") for name in sys.modules))
"""
    done = without(EXTRAS + DEVELOPMENT, code)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 100


@pytest.mark.parametrize(
    ("module", "role", "name", "extra"),
    [
        ("open3d", "renderers", "volume-fusion", "volume"),
        ("torch", "renderers", "synsin", "learned"),
        ("torch", "frame_metrics", "lpips", "learned"),
    ],
)
def test_a_missing_extra_is_named_with_the_command_that_adds_it(
    module: str, role: str, name: str, extra: str
) -> None:
    code = f"from geovp_benchmarks import cli; sys.exit(cli.main(['check', {role!r}, {name!r}]))"
    done = without((module,), code)
    assert done.returncode == 2
    assert (
        f"{name!r} needs {module}, which is not installed: {registry.install_command(extra)}"
        in done.stderr
    )
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("about", "command"),
    [
        ({}, "pip install 'geovp-classic[volume]'"),
        ({"url": "file:///gone/geovp"}, "pip install 'geovp-classic[volume]'"),
        ({"url": "{here}", "dir_info": {}}, "pip install '{path}[volume]'"),
        (
            {"url": "{here}", "dir_info": {"editable": True}},
            "pip install --editable '{path}[volume]'",
        ),
    ],
)
def test_the_command_names_where_it_was_installed_from(
    about: dict[str, object], command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = json.dumps(about).replace("{here}", tmp_path.as_uri()) if about else None
    monkeypatch.setattr(metadata, "distribution", lambda _: metadata.PathDistribution(tmp_path))
    monkeypatch.setattr(metadata.PathDistribution, "read_text", lambda *_: text)
    assert registry.install_command("volume") == command.format(path=tmp_path)


def test_every_extra_of_a_module_exists() -> None:
    offered = set(metadata.metadata("geovp-classic").get_all("Provides-Extra") or [])
    assert set(registry.EXTRA_OF_MODULE.values()) < offered
