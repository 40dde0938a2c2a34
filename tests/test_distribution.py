"""The sdist can be built, and the wheel built from it has the packages and nothing else."""

import importlib.util
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {"geovp", "geovp_classic", "geovp_learned", "geovp_benchmarks"}


def python(*args: object) -> str:
    """Run Python with these arguments, and return what it printed."""
    done = subprocess.run(
        [sys.executable, *map(str, args)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the sdist of a copy of the tracked files, and the wheel built from that sdist."""
    if not (ROOT / ".git").exists() or importlib.util.find_spec("build") is None:
        pytest.skip("needs a git checkout and the package `build`")
    source = tmp_path_factory.mktemp("source")
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in listed.stdout.splitlines():
        if not name.startswith("docs/") and (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    out = tmp_path_factory.mktemp("dist")
    python("-m", "build", "--no-isolation", "--outdir", out, source)
    (sdist,) = out.glob("*.tar.gz")
    (wheel,) = out.glob("*.whl")
    return sdist, wheel


def test_the_wheel_holds_the_packages_with_their_data_and_no_tests(
    built: tuple[Path, Path],
) -> None:
    with zipfile.ZipFile(built[1]) as wheel:
        names = wheel.namelist()
    tops = {name.partition("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == PACKAGES
    for package in PACKAGES - {"geovp"}:
        assert f"{package}/py.typed" in names
    assert any(name.endswith(".safetensors") for name in names)
    assert {"geovp_benchmarks/configs/demo.toml", "geovp_benchmarks/papers/fvs20.toml"} <= {*names}
    assert {"geovp/display/page.html", "geovp/drawing/geovp.mplstyle"} <= {*names}


def test_the_sdist_holds_what_a_packager_needs(built: tuple[Path, Path]) -> None:
    with tarfile.open(built[0]) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    assert {"LICENSE", "CHANGELOG.md", "CITATION.cff", "constraints.txt"} <= names
    assert not any(name.startswith("tests/") for name in names)


def test_the_index_accepts_both(built: tuple[Path, Path]) -> None:
    if importlib.util.find_spec("twine") is None:
        pytest.skip("the package twine is not installed")
    assert python("-m", "twine", "check", "--strict", *built).count("PASSED") == 2
