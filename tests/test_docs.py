"""What README and docs show works: every fenced block is executed or checked.

`python` blocks run in one namespace a page, in a folder of their own; `toml` blocks are built as
matrices, or checked as the pyproject of the component beside them; `sh` lines are parsed by the
program that they name, and run where they need no foreign data and little time; `text` is output or
layout. Any other language fails.
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

import numpy as np
import pytest

import geovp_classic as geovp
from geovp_benchmarks import cli, matrix, multiple_datasets
from geovp_benchmarks.built_matrix import build_matrix
from geovp_benchmarks.cli import predict
from geovp_benchmarks.components import Failure
from geovp_benchmarks.plots import video
from geovp_classic import registry

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
LANGUAGES = ("python", "toml", "sh", "text")
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
HAS_TORCH = importlib.util.find_spec("torch") is not None
TINY = """
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
    """A fenced block, and where it stands."""

    page: Path
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path, *languages: str) -> list[Block]:
    """The blocks of a page, those of some languages or all."""
    text = page.read_text(encoding="utf-8")
    found = [
        Block(
            page,
            text[: match.start()].count("\n") + 1,
            match["language"],
            textwrap.dedent(match["text"]),
        )
        for match in FENCE.finditer(text)
    ]
    return [block for block in found if not languages or block.language in languages]


def pages_with(language: str) -> list[pytest.param]:
    return [
        pytest.param(page, id=str(page.relative_to(ROOT)))
        for page in PAGES
        if blocks(page, language)
    ]


def shell_lines() -> Iterator[pytest.param]:
    for page in PAGES:
        for block in blocks(page, "sh"):
            for number, line in enumerate(block.text.splitlines(), block.line + 1):
                words = shlex.split(line, comments=True)
                if words:
                    yield pytest.param(words, id=f"{page.relative_to(ROOT)}:{number}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_block_is_of_a_language_that_is_checked(page: Path) -> None:
    unknown = [
        f"{block}: {block.language!r}" for block in blocks(page) if block.language not in LANGUAGES
    ]
    assert not unknown, "\n".join(unknown)
    assert page.read_text().count("```") == 2 * len(blocks(page)), f"{page}: a fence is not closed"


@pytest.fixture
def namespace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """An empty module, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    module = types.ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", module)
    return module


def execute(page: Path, namespace: types.ModuleType) -> list[Block]:
    """Run the python blocks of a page in order; those that need torch are returned where there is
    none.
    """
    left = []
    for block in blocks(page, "python"):
        if "import torch" in block.text and not HAS_TORCH:
            left.append(block)
            continue
        exec(compile("\n" * block.line + block.text, str(page), "exec"), namespace.__dict__)
    return left


@pytest.mark.parametrize("page", pages_with("python"))
def test_python_runs(page: Path, namespace: types.ModuleType) -> None:
    before = set(vars(namespace))
    left = execute(page, namespace)
    assert left or set(vars(namespace)) > before, (
        f"{page}: its blocks define nothing, so nothing was run"
    )
    if left:
        pytest.skip(f"{', '.join(map(str, left))}: torch is not installed")


def is_matrix(block: Block) -> bool:
    return "protocol" in tomllib.loads(block.text)


def root_of(block: Block) -> str:
    return tomllib.loads(block.text)["protocol"].get("dataset", {}).get("root", "")


def check_matrix(block: Block, root: Path | None = None) -> None:
    """Parse and build a matrix with its data set and all its components."""
    for parsed in multiple_datasets.parse("page", tomllib.loads(block.text), root).values():
        built = build_matrix(parsed.to_json())
        assert built.clip_names(1), block
        failed = {
            key: part.reason for key, part in built.components.items() if isinstance(part, Failure)
        }
        assert not failed or not HAS_TORCH, f"{block}: {failed}"


@pytest.mark.parametrize("page", pages_with("toml"))
def test_toml_can_be_built(page: Path, namespace: types.ModuleType) -> None:
    execute(page, namespace)  # they write the folders that matrices name
    for block in blocks(page, "toml"):
        if not is_matrix(block):
            check_pyproject(block, namespace)
        elif not root_of(block):
            check_matrix(block)


def check_pyproject(block: Block, namespace: types.ModuleType) -> None:
    """Every entry point names a role and a class that the page defines, in the module that is
    packaged.
    """
    content = tomllib.loads(block.text)
    for group, entries in content["project"]["entry-points"].items():
        protocol = registry.PROTOCOL_OF_ROLE[group.removeprefix("geovp.")]
        for value in entries.values():
            module, _, name = value.partition(":")
            component = getattr(namespace, name)()
            assert module in content["tool"]["setuptools"]["py-modules"], block
            assert dataclasses.is_dataclass(component), block
            assert isinstance(component, protocol), block


WITH_ROOT = [
    block for page in PAGES for block in blocks(page, "toml") if is_matrix(block) and root_of(block)
]


@pytest.mark.parametrize("block", WITH_ROOT, ids=str)
def test_matrices_of_real_data_can_be_built(
    block: Block,
    tmp_path: Path,
    write_kitti_raw: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(tmp_path)
    name = root_of(block).removeprefix("$GEOVP_").lower()
    if name in ("tum", "euroc", "colmap"):
        (sequence,) = tomllib.loads(block.text)["protocol"]["dataset"]["sequences"]
        request.getfixturevalue(f"write_{name}")(tmp_path, sequence, grey_clip())
        check_matrix(block, tmp_path)
        return
    if root_of(block) == "$GEOVP_KITTI_RAW":
        write_kitti_raw(
            tmp_path,
            60,
            geovp.open_clip({"name": "synthetic", "num_frames": 12, "size_px": [32, 32]}),
        )
        check_matrix(block, tmp_path)
        return
    assert root_of(block) == "$GEOVP_KITTI", block
    check_matrix(block, kitti())


def grey_clip() -> geovp.Clip:
    """Thirty grey images of 640x480 from a camera that stands."""
    camera, times_s = geovp.Intrinsics(525.0, 525.0, 319.5, 239.5, 640, 480), np.arange(30) / 10
    poses = geovp.Trajectory(np.tile(np.eye(4), (30, 1, 1)), times_s, is_metric=True)
    return geovp.Clip("grey", np.full((30, 480, 640, 3), 90, np.uint8), times_s, camera, poses)


def kitti() -> Path:
    if "GEOVP_TEST_DATA" not in os.environ:
        pytest.skip("GEOVP_TEST_DATA is not set: the folder with KITTI odometry in kitti/")
    return Path(os.environ["GEOVP_TEST_DATA"]) / "kitti"


class ParsedError(Exception):
    """The arguments were understood; nothing is to be run."""


def parse_only(program: Callable[[], object], monkeypatch: pytest.MonkeyPatch) -> None:
    """Start a program and stop it when it has understood its arguments."""
    parse = argparse.ArgumentParser.parse_args

    def parse_then_stop(self: argparse.ArgumentParser, *given: object) -> None:
        parse(self, *given)  # type: ignore[call-overload]
        raise ParsedError

    with monkeypatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", parse_then_stop)
        with pytest.raises(ParsedError):
            program()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which results/demo and drive.mp4 lie."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "demo.toml").write_text(TINY)
    out = ["--out", str(folder / "results/demo"), "--keep", "all", "--no-report"]
    assert cli.main(["run", str(folder / "demo.toml"), *out]) == 0
    clip = geovp.open_clip({"name": "synthetic", "num_frames": 30, "size_px": [128, 128]})
    video.write_mp4(folder / "drive.mp4", clip.frames, 10.0)
    return folder


@pytest.mark.parametrize("words", list(shell_lines()))
def test_shell_line(
    words: list[str],
    results: Path,
    monkeypatch: pytest.MonkeyPatch,
    write_kitti_raw: Callable[..., Path],
    tmp_path: Path,
) -> None:
    program, *arguments = words
    if program == "geovp":
        monkeypatch.chdir(results)
        check_geovp(arguments, monkeypatch, write_kitti_raw, tmp_path)
    elif program == "python" and arguments[0] == "-m":
        monkeypatch.setattr(sys, "argv", arguments[1:])
        if "learned" in arguments and not HAS_TORCH:
            pytest.skip("torch is not installed")
        parse_only(lambda: runpy.run_module(arguments[1], run_name="__main__"), monkeypatch)
    elif program == "python":
        compile((ROOT / arguments[0]).read_text(), arguments[0], "exec")
    elif program == "make":
        target, settings, makefile = arguments[0], arguments[1:], (ROOT / "Makefile").read_text()
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)
        for name, _, value in (setting.partition("=") for setting in settings):
            assert re.search(rf"^{name} \?=", makefile, re.MULTILINE)
            assert name != "TESTS" or (ROOT / value).exists()
            assert (
                name != "MODULE" or (ROOT / "tests" / "mutation_testing" / f"{value}.toml").exists()
            )
    else:
        assert [program, arguments[0]] == ["pip", "install"], (
            f"{program} is not a program that this test knows"
        )
        extras = re.findall(r"\[(.*)\]", " ".join(arguments))
        assert set(extras) <= set(PYPROJECT["project"]["optional-dependencies"])


def check_geovp(
    arguments: list[str],
    monkeypatch: pytest.MonkeyPatch,
    write_kitti_raw: Callable[..., Path],
    folder: Path,
) -> None:
    """Parse a line of geovp, and run it where it is quick and its data is here."""
    for config in (
        word for word in arguments if word.startswith("benchmarks/geovp_benchmarks/configs/")
    ):
        assert (ROOT / config).is_file(), config
        matrix.read(ROOT / config)
    if "--fov" in arguments and not knows_fov():
        pytest.skip("this geovp predict has no --fov: it takes --intrinsics alone")
    if arguments == ["--version"]:
        with pytest.raises(SystemExit, match="0"):
            cli.main(arguments)
        return
    parse_only(lambda: cli.main(arguments), monkeypatch)
    if arguments[:2] == ["data", "doctor"] and "kitti" in arguments[2]:
        clip = geovp.open_clip({"name": "synthetic", "num_frames": 3, "size_px": [32, 32]})
        is_raw = arguments[2] == "path/to/kitti_raw"
        root = write_kitti_raw(folder, 60, clip).parents[1] if is_raw else kitti()
        assert cli.main(["data", "doctor", str(root)]) in (
            0,
            1,
        )  # 1: something is wrong with the data
    elif arguments[0] == "list" or (
        arguments[0] in ("table", "plot", "report", "score") and "results/demo" in arguments
    ):
        assert cli.main(arguments) == 0
    elif arguments[0] == "predict" and "--fov" in arguments:
        assert cli.main([*arguments, "--size", "96", "--out", str(folder / "predicted")]) == 0
        assert (folder / "predicted/strip.png").is_file()
    elif arguments[0] == "check" and arguments[2] == "depth-fusion":
        assert cli.main(arguments) == 0


def knows_fov() -> bool:
    parser = argparse.ArgumentParser()
    predict.add_arguments(parser)
    return "--fov" in parser.format_help()


def test_own_video_can_be_predicted(results: Path, tmp_path: Path) -> None:
    camera = geovp.open_clip(
        {"name": "synthetic", "num_frames": 30, "size_px": [128, 128]}
    ).intrinsics
    intrinsics = [
        str(number) for number in (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    ]
    command = [
        "predict",
        str(results / "drive.mp4"),
        "--intrinsics",
        *intrinsics,
        "--first",
        "0",
        "--size",
        "128",
    ]
    assert cli.main([*command, "--out", str(tmp_path / "out")]) == 0
    table = (ROOT / "docs/guide/own-video.md").read_text().partition("## What is written")[2]
    for line in re.findall(r"^\| (`.*?`) \|", table, re.MULTILINE):
        for name in re.findall(r"`([^`]+)`", line):
            assert (tmp_path / "out" / name).exists(), name
