"""The code blocks of README and docs work: each fenced block is executed or checked.

`python` blocks run in one namespace per page, in an empty folder; `toml` blocks are built as
matrices, or checked as the pyproject of the component on their page; `sh` lines are parsed by the
program that they name, and run if they are quick and need no foreign data; `text` is output or
layout. Other languages fail.
"""

import argparse
import dataclasses
import importlib.util
import os
import re
import runpy
import shlex
import sys
import textwrap
import tomllib
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import geovp
import studies
from geovp.drawing import video
from geovp_benchmarks import cli
from geovp_benchmarks.failure import Failure
from geovp_benchmarks.matrix import schema
from geovp_benchmarks.running.task import build_matrix
from geovp_classic import registry

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
EXTRAS = ("torch", "onnx", "onnxscript", "onnxruntime")
HAS_NETWORKS = all(map(importlib.util.find_spec, EXTRAS))
SYNTHETIC = {"name": "synthetic", "num_frames": 30, "size_px": [128, 128]}
MATRIX = """
[protocol]
dataset = { name = "synthetic", num_clips = 3 }
num_past = 4
num_future = 3
size_px = [32, 32]
stride = 10

[pose_sources]
gt-3d = { name = "ground-truth" }

[renderers]
ground-far-plane = { name = "ground-far-plane" }

[predictors]
copy-last = { name = "copy-last" }

[metrics]
frame = ["psnr"]
trajectory = ["rotation-error"]
"""


@dataclass(frozen=True)
class Block:
    """A fenced block and its place."""

    page: Path
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def toml(self) -> dict[str, Any]:
        return tomllib.loads(self.text)

    @property
    def root(self) -> str:
        """Return the root of a matrix's data set."""
        return self.toml["protocol"].get("dataset", {}).get("root", "")


def blocks(page: Path, language: str | None = None) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            page,
            text[: match.start()].count("\n") + 1,
            match["language"],
            textwrap.dedent(match["text"]),
        )
        for match in FENCE.finditer(text)
        if language in (None, match["language"])
    ]


def pages_with(*languages: str) -> list[pytest.param]:
    pages = [page for page in PAGES if any(blocks(page, each) for each in languages)]
    return [pytest.param(page, id=str(page.relative_to(ROOT))) for page in pages]


def shell_lines() -> Iterator[pytest.param]:
    """Yield the words of each command, once if several pages have it."""
    seen = set()
    for page in PAGES:
        for block in blocks(page, "sh"):
            for number, line in enumerate(block.text.splitlines(), block.line + 1):
                words = shlex.split(line, comments=True)
                if words and tuple(words) not in seen:
                    seen.add(tuple(words))
                    yield pytest.param(words, id=f"{page.relative_to(ROOT)}:{number}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_blocks_have_a_checked_language(page: Path) -> None:
    for block in blocks(page):
        assert block.language in ("python", "toml", "sh", "text"), block
    assert page.read_text().count("```") == 2 * len(blocks(page)), "a fence is not closed"


@pytest.fixture
def namespace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """Return an empty module, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    module = types.ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", module)
    return module


def execute(page: Path, namespace: types.ModuleType) -> None:
    """Run the python blocks of a page in order, without those of networks if an extra is missing."""
    for block in blocks(page, "python"):
        if HAS_NETWORKS or "import torch" not in block.text:
            code = compile("\n" * block.line + block.text, str(page), "exec")
            exec(code, namespace.__dict__)


def check_matrix(block: Block, root: Path | None = None) -> None:
    """Parse and build a matrix with its data set and all its components."""
    parsed = schema.parse("page", block.toml).override(root=root)
    built = build_matrix(parsed.model_dump_json())
    assert built.clip_names, block
    failures = [each for each in built.predictors.values() if isinstance(each, Failure)]
    assert not failures or not HAS_NETWORKS, f"{block}: {failures}"


def check_pyproject(block: Block, namespace: types.ModuleType) -> None:
    """Check that entry points name a role and a class that the page defines in its module."""
    for group, entries in block.toml["project"]["entry-points"].items():
        protocol = registry.PROTOCOL_OF_ROLE[group.removeprefix("geovp.")]
        for value in entries.values():
            module, _, name = value.partition(":")
            component = getattr(namespace, name)()
            assert module in block.toml["tool"]["setuptools"]["py-modules"], block
            assert dataclasses.is_dataclass(component), block
            assert isinstance(component, protocol), block


@pytest.mark.parametrize("page", pages_with("python", "toml"))
def test_python_runs_and_toml_can_be_built(page: Path, namespace: types.ModuleType) -> None:
    before = set(vars(namespace))
    execute(page, namespace)  # writes the folders that matrices name
    assert set(vars(namespace)) > before or not blocks(page, "python") or not HAS_NETWORKS
    for block in blocks(page, "toml"):
        if "protocol" not in block.toml:
            check_pyproject(block, namespace)
        elif not block.root:
            check_matrix(block)


TOML = [block for page in PAGES for block in blocks(page, "toml")]
MATRICES = [block for block in TOML if "protocol" in block.toml and block.root]


@pytest.mark.parametrize("block", MATRICES, ids=str)
def test_matrices_of_real_data_can_be_built(
    block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.chdir(tmp_path)
    layout = block.root.removeprefix("$GEOVP_").lower()
    if layout == "kitti":
        check_matrix(block, kitti())
        return
    write = request.getfixturevalue(f"write_{layout}")
    if layout == "kitti_raw":
        write(tmp_path, 60, geovp.open_clip({**SYNTHETIC, "size_px": [32, 32]}))
    else:
        (sequence,) = block.toml["protocol"]["dataset"]["sequences"]
        write(tmp_path, sequence, grey_clip())
    check_matrix(block, tmp_path)


def grey_clip() -> geovp.Clip:
    """Return thirty grey images of 640x480 from a stationary camera."""
    camera = geovp.Intrinsics(525.0, 525.0, 319.5, 239.5, 640, 480)
    times_s = np.arange(30) / 10
    path = geovp.Trajectory(np.tile(np.eye(4), (30, 1, 1)), times_s, is_metric=True)
    return geovp.Clip("grey", np.full((30, 480, 640, 3), 90, np.uint8), times_s, camera, path)


def kitti() -> Path:
    if "GEOVP_TEST_DATA" not in os.environ:
        pytest.skip("GEOVP_TEST_DATA is not set: the folder with KITTI odometry in kitti/")
    return Path(os.environ["GEOVP_TEST_DATA"]) / "kitti"


class ParsedError(Exception):
    """Raised after the arguments were parsed, so that nothing runs."""


def parse_only(program: Callable[[], object], monkeypatch: pytest.MonkeyPatch) -> None:
    """Start a program and stop it after it has parsed its arguments."""
    parse = argparse.ArgumentParser.parse_args

    def parse_then_stop(self: argparse.ArgumentParser, *args: Any) -> None:
        parse(self, *args)
        raise ParsedError

    with monkeypatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", parse_then_stop)
        with pytest.raises(ParsedError):
            program()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with results/demo and drive.mp4."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "demo.toml").write_text(MATRIX)
    out = ["--out", str(folder / "results/demo"), "--keep", "all", "--no-report"]
    assert cli.main(["run", str(folder / "demo.toml"), *out]) == 0
    video.write_mp4(folder / "drive.mp4", geovp.open_clip(SYNTHETIC).frames, 10.0)
    return folder


@pytest.mark.parametrize("words", list(shell_lines()))
def test_shell_line(
    words: list[str],
    results: Path,
    monkeypatch: pytest.MonkeyPatch,
    write_kitti_raw: Callable[..., Path],
    tmp_path: Path,
) -> None:
    if words[0].startswith("PYTHONPATH="):
        monkeypatch.syspath_prepend(ROOT / words.pop(0).removeprefix("PYTHONPATH="))
    program, *args = words
    if program == "geovp":
        monkeypatch.chdir(results)
        check_geovp(args, monkeypatch, write_kitti_raw, tmp_path)
    elif program == "python" and args[0] == "-m":
        monkeypatch.setattr(sys, "argv", args[1:])
        if "learned" in args[1] and not HAS_NETWORKS:
            pytest.skip("an extra of networks is not installed")
        parse_only(lambda: runpy.run_module(args[1], run_name="__main__"), monkeypatch)
    elif program == "python" and args[0] == "benchmarks/studies":
        parse_only(lambda: studies.main(args[1:]), monkeypatch)
    elif program == "python":
        compile((ROOT / args[0]).read_text(), args[0], "exec")
    elif program == "source":
        assert args == [".venv/bin/activate"]  # made by `make demo`
    elif program == "make":
        makefile = (ROOT / "Makefile").read_text()
        assert re.search(rf"^{args[0]}:", makefile, re.MULTILINE)
        settings = dict(word.split("=") for word in args[1:])
        for name in settings:
            assert re.search(rf"^{name} \?=", makefile, re.MULTILINE)
        assert (ROOT / settings.get("TESTS", "tests")).exists()
        module = settings.get("MODULE", "geometry")
        assert (ROOT / f"tests/mutation_testing/{module}.toml").exists()
    else:
        assert [program, args[0]] == ["pip", "install"]
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        extras = re.findall(r"\[(.*)\]", " ".join(args))
        assert set(extras) <= set(project["optional-dependencies"])


def check_geovp(
    args: list[str],
    monkeypatch: pytest.MonkeyPatch,
    write_kitti_raw: Callable[..., Path],
    folder: Path,
) -> None:
    """Parse a geovp command, and run it if it is quick and its data is available."""
    for word in args:
        if word.startswith("benchmarks/geovp_benchmarks/configs/"):
            schema.read(ROOT / word)
    if args == ["--version"]:
        with pytest.raises(SystemExit, match="0"):
            cli.main(args)
        return
    parse_only(lambda: cli.main(args), monkeypatch)
    if args[0] == "doctor" and "kitti" in args[1]:
        root = folder
        if args[1] == "path/to/kitti":
            root = kitti()
        else:
            write_kitti_raw(folder, 60, geovp.open_clip({**SYNTHETIC, "size_px": [32, 32]}))
        assert cli.main(["doctor", str(root)]) in (0, 1)  # 1: a defect of the data
        return
    is_predict = args[0] == "predict" and "--first" in args
    if is_predict:
        args = [*args, "--size", "96", "--out", str(folder / "predicted")]
    needs_results = args[0] in ("table", "report", "rescore") and "results/demo" in args
    needs_results |= args[:2] == ["plot", "results/demo"] and "--width" in args
    is_check = args[0] == "check" and args[2] == "depth-fusion"
    if args[0] == "list" or needs_results or is_check or is_predict:
        assert cli.main(args) == 0


def test_a_video_can_be_predicted(results: Path, tmp_path: Path) -> None:
    """The page names the files that are written."""
    camera = geovp.open_clip(SYNTHETIC).intrinsics
    numbers = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]
    args = ["--intrinsics", *map(str, numbers), "--first", "0", "--size", "128"]
    out = tmp_path / "out"
    assert cli.main(["predict", str(results / "drive.mp4"), *args, "--out", str(out)]) == 0
    table = (ROOT / "docs/guide/own-video.md").read_text().partition("## Output")[2]
    for line in re.findall(r"^\| (`.*?`) \|", table, re.MULTILINE):
        for name in re.findall(r"`([^`]+)`", line):
            assert (out / name).exists(), name
