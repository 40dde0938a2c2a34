"""The plain installation works without the extras, and a missing extra is named."""

import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from geovp_classic import registry

DEVELOPMENT = ("distributed", "evo", "pytest", "hypothesis")
BLOCK = """
import sys
class Blocked:
    def find_spec(name, *_):
        if name.partition(".")[0] in {modules!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocked)
"""


def run_without(modules: tuple[str, ...], code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a Python that cannot import these modules."""
    script = BLOCK.format(modules=modules) + code
    return subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )


def test_modules_are_imported_without_the_extras() -> None:
    code = """
import importlib, pkgutil
for package in ("geovp_classic", "geovp_benchmarks"):
    found = pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}.")
    for name in (module.name for module in found):
        if not name.endswith((".__main__", ".volume_fusion", ".server")):
            importlib.import_module(name)
print(sum(name.startswith("geovp_") for name in sys.modules))
"""
    done = run_without((*registry.EXTRA_OF_MODULE, *DEVELOPMENT), code)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 100


@pytest.mark.parametrize(
    ("module", "role", "name"),
    [
        ("open3d", "renderers", "volume-fusion"),
        ("torch", "frame_metrics", "lpips"),
        ("transformers", "depth_sources", "huggingface"),
    ],
)
def test_a_missing_extra_is_named_with_its_command(module: str, role: str, name: str) -> None:
    code = f"from geovp_benchmarks import cli; sys.exit(cli.main(['check', {role!r}, {name!r}]))"
    done = run_without((module,), code)
    assert done.returncode == 2
    assert registry.install_command(registry.EXTRA_OF_MODULE[module]) in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_bag_without_its_extra_names_the_command(tmp_path: Path) -> None:
    (tmp_path / "run.bag").write_bytes(b"#ROSBAG V2.0\n")
    code = f"from geovp_benchmarks import cli; sys.exit(cli.main(['doctor', {str(tmp_path)!r}]))"
    done = run_without(("rosbags",), code)
    assert done.returncode == 2
    assert registry.install_command("rosbag") in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_extra_of_each_module_exists() -> None:
    offered = set(metadata.metadata("geovp").get_all("Provides-Extra") or [])
    assert set(registry.EXTRA_OF_MODULE.values()) < offered
