"""The command line as users meet it: what is printed, what is written, and the exit codes."""

import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import duckdb
import pytest

from geovp_benchmarks import cli
from tests.benchmarks.conftest import Command, Says
from tests.benchmarks.made import METRICS, content, rows, values, write_matrix

TABLES = content(
    {"clips": 5},
    pose_sources={"steady": {"name": "toy-steady"}},
    renderers={"slide": {"name": "toy-slide"}},
    predictors={"still": {"name": "toy-still"}},
)


def matrix(folder: Path, **more: Any) -> Path:
    """The matrix file, with more predictors."""
    return write_matrix(
        folder / "streets.toml", {**TABLES, "predictors": {**TABLES["predictors"], **more}}
    )


def run(folder: Path, *arguments: str, **more: Any) -> list[str]:
    """The words of a command line that runs it."""
    return [
        "run",
        str(matrix(folder, **more)),
        "--out",
        str(folder / "out"),
        "--no-report",
        *arguments,
    ]


@pytest.mark.usefixtures("toys")
class TestRun:
    def test_all_done_is_0_with_the_table_printed_and_written(
        self, tmp_path: Path, printed: Says
    ) -> None:
        text = printed(*run(tmp_path))
        assert "| steady + slide [p] |     5 |" in text
        assert "| still " in text
        names = {path.name for path in (tmp_path / "out/tables").iterdir()}
        assert {"scores.md", "scores.tex", "scores.csv", "pixels-toy-difference.md"} <= names
        for ending, opening in (
            ("md", "## streets"),
            ("tex", r"\begin{table}"),
            ("csv", "method,privileged_inputs,clips"),
        ):
            assert printed("table", tmp_path / "out", "--format", ending).startswith(opening)

    def test_a_method_without_scores_is_1_and_named_with_the_reason(
        self, tmp_path: Path, command: Command, refused: Says
    ) -> None:
        ended = command(*run(tmp_path, other={"name": "toy-broken"}))
        assert ended.code == 1
        assert "\n- other: failed" in ended.out
        assert "1 of 3 methods are not done" in ended.err
        for words in ("--methods", "--against", "--per clip --methods"):
            said = refused("table", tmp_path / "out", *words.split(), "other")
            assert "other has no scores: failed: ZeroDivisionError: the road ended" in said

    def test_sigterm_is_handled_as_before_afterwards(self, tmp_path: Path, printed: Says) -> None:
        before = signal.getsignal(signal.SIGTERM)
        printed(*run(tmp_path))
        assert signal.getsignal(signal.SIGTERM) is before

    def test_all_scores_are_exported_as_one_table(
        self, tmp_path: Path, command: Command, printed: Says, refused: Says
    ) -> None:
        command(*run(tmp_path, other={"name": "toy-broken"}))  # a method without scores
        words = ["export", tmp_path / "out", "--method", "other", "--out", tmp_path / "x.csv"]
        assert "has no scores of these methods" in refused(*words)
        num_rows = sum(len(rows(tmp_path / "out", name)) for name in ("steady--slide", "still"))
        for ending in ("csv", "parquet"):
            path = tmp_path / f"scores.{ending}"
            printed("export", tmp_path / "out", "--format", ending, "--out", path)
            scores = duckdb.sql(f"SELECT * FROM '{path}'")
            assert scores.columns == ["method", "clip", "sample", "step", "metric", "value"]
            assert len(scores) == num_rows
            query = "SELECT value FROM scores WHERE method = 'still' AND clip = 'road/003'"
            assert duckdb.sql(query).fetchall() == [(1.0,), (2.0,)]
            printed("export", tmp_path / "out", "--method", "still", "--out", path)
            methods = duckdb.sql(f"SELECT DISTINCT method FROM read_csv('{path}')")
            assert methods.fetchall() == [("still",)]

    def test_options_without_effect_are_refused(
        self, tmp_path: Path, printed: Says, refused: Says
    ) -> None:
        printed(*run(tmp_path))
        out = tmp_path / "out"
        lines = printed("table", out, "--per", "clip", "--format", "csv").splitlines()
        assert lines[0].startswith("clip,")
        assert {line.partition(",")[0] for line in lines[1:6]} == {f"road/00{k}" for k in range(5)}
        for words in ("--per clip --steps 1", "--per clip --format tex", "--paper fvs20 --by kind"):
            assert words.split()[2] in refused("table", out, *words.split())
        text = printed("table", out, "--against", "still", "--spread", "standard-error")
        assert "±" in text
        alone = ["--against", "still", "--methods", "still"]
        assert "no other method to compare with still" in refused("table", out, *alone)
        serial = ("--fresh", "--workers", "0", "--time-limit", "9")
        assert "leave one out" in refused(*run(tmp_path, *serial))
        assert "--limit" in refused("export", out, "--limit", "1", "--out", tmp_path / "a.csv")


@pytest.mark.usefixtures("toys")
class TestScore:
    def test_with_other_metrics_and_the_clips_that_were_kept(
        self, tmp_path: Path, printed: Says
    ) -> None:
        printed(*run(tmp_path, "--keep", "1"))
        metrics = {**METRICS, "frame": [{"name": "toy-difference", "scale": 10.0}]}
        other = write_matrix(tmp_path / "other.toml", {**TABLES, "metrics": metrics})
        text = printed("rescore", tmp_path / "out", "--matrix", other)
        # of five clips the middle one is kept; 1 and 2 grey levels, ten times
        assert values(tmp_path / "out-rescored", "still", "toy-difference") == [10.0, 20.0]
        assert re.search(r"^[|] still +[|] +1 [|] +15[.]00 [|]", text, re.MULTILINE)


def python(code: str, **more: Any) -> str:
    """What a new process prints that runs this code to its end."""
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, **more
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


class TestList:
    def test_plug_ins_are_there_and_nothing_is_imported_for_them(self, toys: Path) -> None:
        heavy = ("cv2", "torch", "open3d", "scipy", "geovp_toys", "geovp_learned.lpips")
        lines = python(
            f"import sys; sys.path.insert(0, {str(toys)!r})\n"
            "from geovp_benchmarks import cli; cli.main(['list'])\n"
            f"assert not [name for name in {heavy!r} if name in sys.modules]"
        ).splitlines()
        assert any(line.startswith("  toy-still [geovp-toys]") for line in lines)
        assert any(line.startswith("  toy-uninstalled [geovp-toys]") for line in lines)


class TestCheck:
    def test_a_broken_one_is_1_and_settings_are_written_as_in_toml(
        self, toys: Path, command: Command
    ) -> None:
        ended = command("check", "predictors", "toy-broken")
        assert ended.code == 1
        assert re.search(
            r"^FAILED  .*: ZeroDivisionError: the road ended$", ended.out, re.MULTILINE
        )
        assert command("check", "predictors", '{name = "toy-broken", brightness = 256}').code == 0


@pytest.mark.parametrize(
    ("words", "names"),
    [([], cli.COMMANDS), (["forecast"], ("--sequences",))],
)
def test_help_names_everything_and_imports_nothing_heavy(
    words: list[str], names: tuple[str, ...]
) -> None:
    heavy = ("numpy", "cv2", "duckdb", "matplotlib", "torch", "open3d", "tqdm")
    text = python(f"""
import sys
from geovp_benchmarks import cli
from geovp_benchmarks.matrix import CONFIGS
try:
    cli.main([*{words!r}, "--help"])
except SystemExit as end:
    assert end.code == 0
assert not [name for name in {heavy!r} if name in sys.modules]
""")
    for name in names:
        assert re.search(rf"^ +{name}( |$)", text, re.MULTILINE)


WRONG = [
    "",
    "walk",
    "run",
    "run x.toml --limit 0",
    "run x.toml --time-limit nan",
    "run x.toml --time-limit 0",
    "table x --per step",
    "plot x --width 5000",
    "table",
    "verify x --seed -1",
    "verify x --tolerance inf",
    "predict x --future 10000000",
    "display x --size 10x",
    "display x --loss 2",
    "display x --jitter 99",
    "display x --latency nan",
]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        *((words, "usage: geovp") for words in WRONG),
        ("run x.toml --limit 1.5", "'1.5' is not a whole number from 1 to"),
        ("predict x --size 5xa", "'a' is not a whole number from 1 to 8192"),
        ("predict x --fov 180", "'180' is not a number from 1 to 179"),
        ("run x.toml --shard 3", "'3' is not I/N, such as 3/64"),
    ],
)
def test_a_wrong_command_line_is_2_and_told_what_is_expected(
    words: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(words.split())
    assert expected in capsys.readouterr().err
