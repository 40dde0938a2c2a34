"""What every verb has in common: how much is said, JSON, built-in matrices, settings, completion."""

import os
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from geovp_benchmarks.results.store import Results
from geovp_classic import registry
from tests import registered

from .conftest import Command, Says
from .test_cli import run


@pytest.mark.usefixtures("toys")
class TestSettings:
    @pytest.mark.parametrize(
        ("setting", "says"),
        [
            ("protocol.strid=3", "unknown key 'strid': did you mean 'stride'?"),
            (
                "pose_sources.stedy.step_m=1",
                "[pose_sources] has no entry 'stedy': did you mean 'steady'?",
            ),
            ("protocol.stride", "is not KEY=VALUE"),
            ("protocol.stride=[1", "is not a value as in TOML"),
        ],
    )
    def test_a_mistake_is_2_and_says_what_is_meant(
        self, tmp_path: Path, refused: Says, setting: str, says: str
    ) -> None:
        assert says in refused(*run(tmp_path, "--set", setting))


class TestNames:
    def test_a_name_of_two_parts_and_a_component_that_is_only_named(self) -> None:
        from geovp_benchmarks.matrix import schema as matrices

        read = matrices.read(
            Path("demo"),
            ["pose_sources.vo+prior.num_samples=3", "renderers.fusion.inpainter.name=telea"],
        )
        assert read.name == "demo"
        assert read.pose_sources["vo+prior"].num_samples == 3
        assert read.renderers["fusion"] == {
            "name": "depth-fusion",
            "inpainter": {"name": "telea"},
        }


@pytest.mark.usefixtures("toys")
class TestDryRun:
    def test_it_counts_what_is_to_do_and_writes_nothing(
        self, tmp_path: Path, printed: Says
    ) -> None:
        text = printed(*run(tmp_path, "--dry-run"))
        assert re.search(r"^\| steady [+] slide \| +5 \| +0 \| +unknown", text, re.MULTILINE)
        assert "predictions: 10 to do, 0 stored" in text  # 5 clips, 2 methods
        text = printed(*run(tmp_path, "--dry-run", "--shard", "2/2"))
        assert "predictions: 6 to do, 0 stored" in text  # clips 3, 4 and 5
        assert not (tmp_path / "out").exists()

    def test_after_a_run_of_some_clips_its_times_are_used(
        self, tmp_path: Path, printed: Says
    ) -> None:
        printed(*run(tmp_path, "--limit", "2"))  # two clips a file
        before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*")}
        text = printed(*run(tmp_path, "--dry-run", "--keep", "0", other="toy-picky"))
        assert "predictions: 11 to do, 4 stored" in text  # 3 clips in 2 rows, 5 in the new one
        assert {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*")} == before

    def test_shared_steps_count_once_and_a_single_clip_is_a_bound(
        self, tmp_path: Path, printed: Says
    ) -> None:
        """Two renderers of one pose source: 60 s for both together, then 30 and 45 s."""
        words = run(tmp_path, "--set", "renderers.other=toy-slide", "--methods")
        words += ["steady + slide", "steady + other"]
        printed(*words, "--limit", "1")
        results = Results(tmp_path / "out")
        for method, view_s in zip(results.methods(), (30.0, 45.0), strict=True):
            record = method.scored["road/000"]
            seconds = {"motion": 60.0, "view": view_s}
            scored = results.scores(method.name), replace(record, seconds=seconds)
            results.write_scores([scored])
        text = printed(*words, "--dry-run")
        assert "time: at most about 9.0 min with 1 process" in text  # 4 clips x 135 s


@pytest.mark.usefixtures("toys")
class TestAmounts:
    def test_quiet_says_only_errors_and_results(self, tmp_path: Path, command: Command) -> None:
        assert command(*run(tmp_path, "--quiet")).err == ""
        ended = command(
            *run(tmp_path, "-q", "--set", "protocol.stride=3")
        )  # sets rows aside, which is said otherwise
        assert (ended.code, ended.err) == (0, "")
        assert "| steady + slide [p] |" in ended.out
        ended = command(*run(tmp_path, "-q", other="toy-broken"))
        assert ended.code == 1
        assert ended.err.startswith("geovp: 1 of 3 methods are not done")


@pytest.mark.parametrize("name", ["depth-fusion", "refined", "monocular", "motion-prior"])
def test_a_printed_component_is_its_default(name: str, printed: Says) -> None:
    """What is printed can be pasted into a matrix file."""
    (role,) = (role for role in registry.ROLES if name in registered.names(role))
    table = tomllib.loads(printed("list", name))
    settings = table[role][name] if role in table else table
    needed = {"source": {"name": "ground-truth"}} if name == "refined" else {}
    assert registry.build(role, {**settings, **needed}) == registry.build(
        role, {"name": name, **needed}
    )


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize("columns", [80, 120])
def test_a_table_is_no_wider_than_the_terminal(
    columns: int, tmp_path: Path, printed: Says, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "a-method-with-a-long-name"
    metrics = ", ".join(f'm{i} = {{ name = "toy-difference", scale = {i}.0 }}' for i in range(1, 9))
    wide = printed(*run(tmp_path, "--set", f"metrics.frame={{ {metrics} }}", **{name: "toy-still"}))
    assert max(map(len, wide.splitlines())) > 120
    written = (tmp_path / "out/tables/scores.md").read_text()
    monkeypatch.setenv("COLUMNS", str(columns))
    narrow = printed("table", tmp_path / "out")
    assert max(map(len, narrow.splitlines())) <= columns
    for i in range(1, 9):  # every column is there once in the main table
        assert len(re.findall(rf"\| +M{i}\b", narrow.partition("## streets: M1")[0])) == 1
    assert (tmp_path / "out/tables/scores.md").read_text() == written
    assert name in written


def completions(line: str, folder: Path) -> list[str]:
    """What the shell would offer behind a line: argcomplete's own protocol."""
    pytest.importorskip("argcomplete")
    out = folder / "completions"
    given = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(out),
    }
    given |= {"COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_COMP_WORDBREAKS": ""}
    code = (
        "import sys; from geovp_benchmarks import cli\n"
        "import os; leave = os._exit\n"
        "def ended(code):\n"
        "    assert not {'numpy', 'cv2', 'duckdb'} & set(sys.modules)\n"
        "    leave(code)\n"
        "os._exit = ended\n"
        "cli.main()"
    )
    subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **given}, check=True, cwd=folder
    )
    return [word.strip() for word in out.read_text().split("\n")]


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("geovp rep", {"report", "reproduce"}),
        ("geovp table x --spread ", {"interval", "standard-error"}),
    ],
)
def test_the_shell_completes(line: str, offered: set[str], tmp_path: Path) -> None:
    assert set(completions(line, tmp_path)) == offered
