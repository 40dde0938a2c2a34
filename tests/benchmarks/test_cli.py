"""The command line as users meet it: what is printed, what is written, and the exit codes."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from geovp_benchmarks import cli
from geovp_benchmarks.store import Results
from geovp_classic import registry

MATRIX = """
[protocol]
dataset = {{ name = "toy-road", clips = 5 }}
num_past = 3
num_future = 2
size_px = [8, 8]
stride = 1

[pose_sources]
steady = {{ name = "toy-steady" }}

[renderers]
slide = {{ name = "toy-slide" }}

[predictors]
still = {{ name = "toy-still" }}
{more}
[metrics]
frame = ["toy-difference"]
trajectory = ["toy-gap"]
"""


def matrix(folder: Path, more: str = "") -> Path:
    path = folder / "streets.toml"
    path.write_text(MATRIX.format(more=more))
    return path


def run(folder: Path, *arguments: str, more: str = "") -> int:
    return cli.main(["run", str(matrix(folder, more)), "--out", str(folder / "out"), "--no-report", *arguments])


@pytest.mark.usefixtures("toys")
class TestRun:
    def test_all_done_is_0_with_the_table_printed_and_written(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert run(tmp_path) == 0
        printed = capsys.readouterr().out
        assert "| steady + slide [p] |     5 |" in printed
        assert "| still " in printed
        names = {path.name for path in (tmp_path / "out/tables").iterdir()}
        assert {"scores.md", "scores.tex", "scores.csv", "pixels-toy-difference.md"} <= names

    def test_results_go_to_a_folder_of_the_files_name(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        assert cli.main(["run", str(matrix(tmp_path)), "--no-report"]) == 0
        assert Results(tmp_path / "results/streets").protocol()["name"] == "streets"

    @pytest.mark.parametrize("name", ["toy-broken", "toy-misfit", "toy-uninstalled"])
    def test_what_failed_or_was_skipped_is_1_and_named(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
    ) -> None:
        assert run(tmp_path, more=f'other = {{ name = "{name}" }}') == 1
        printed = capsys.readouterr()
        assert re.search(r"^- other: (failed|skipped): \w+", printed.out, re.MULTILINE)
        assert "1 of 3 cells are not done" in printed.err

    def test_limit_keep_and_workers(self, tmp_path: Path) -> None:
        assert run(tmp_path, "--limit", "2", "--keep", "all", "--workers", "1") == 0
        results = Results(tmp_path / "out")
        assert [clip for clip, _ in results.predictions("still")] == ["road/000", "road/001"]
        assert {cell.num_clips for cell in results.cells()} == {2}

    def test_root_replaces_what_the_file_says(self, tmp_path: Path) -> None:
        assert run(tmp_path, "--root", "/elsewhere") == 0
        assert Results(tmp_path / "out").protocol()["dataset"]["root"] == "/elsewhere"

    def test_tables_can_be_printed_again_in_any_format(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        run(tmp_path)
        for ending, opening in (("md", "## streets"), ("tex", r"\begin{table}"), ("csv", "method,grants,clips")):
            capsys.readouterr()
            assert cli.main(["table", str(tmp_path / "out"), "--format", ending]) == 0
            assert capsys.readouterr().out.startswith(opening)

    def test_an_interrupted_run_says_so_and_goes_on_later(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        def interrupt(*_: object) -> None:
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr("geovp_benchmarks.built_matrix.score", interrupt)
            assert run(tmp_path) == 130
        assert "interrupted" in capsys.readouterr().err
        assert run(tmp_path) == 0


@pytest.mark.usefixtures("toys")
class TestScore:
    def test_kept_predictions_are_scored_again_beside_the_stored_rows(self, tmp_path: Path) -> None:
        run(tmp_path, "--keep", "all")
        assert cli.main(["score", str(tmp_path / "out")]) == 0
        before, after = Results(tmp_path / "out"), Results(tmp_path / "out-rescored")
        for cell in ("steady--slide", "still"):
            assert after.scores(cell).equals(before.scores(cell))
            scored = after.cell(cell)
            assert scored is not None
            assert scored.record["peak_is_own"] is False  # nothing was predicted
        assert before.root.joinpath("still/cell.json").exists()

    def test_with_other_metrics_and_the_clips_that_were_kept(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        run(tmp_path, "--keep", "1")
        other = tmp_path / "other.toml"
        other.write_text(
            MATRIX.format(more="").replace('"toy-difference"', '{ name = "toy-difference", scale = 10.0 }')
        )
        assert cli.main(["score", str(tmp_path / "out"), "--metrics", str(other)]) == 0
        # of five clips the middle one is kept; 1 and 2 grey levels, ten times
        scores = Results(tmp_path / "out-rescored").scores("still")
        assert scores["value"].to_pylist() == [10.0, 20.0]
        assert re.search(r"^[|] still +[|] +1 [|] +15[.]00 [|]", capsys.readouterr().out, re.MULTILINE)

    def test_nothing_kept_or_the_same_folder_is_2(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        run(tmp_path, "--keep", "0")
        assert cli.main(["score", str(tmp_path / "out")]) == 2
        assert "keeps no predictions: run it again with --keep" in capsys.readouterr().err
        assert cli.main(["score", str(tmp_path / "out"), "--out", str(tmp_path / "out")]) == 2

    def test_skipped_cells_stay_skipped(self, tmp_path: Path) -> None:
        run(tmp_path, more='other = { name = "toy-misfit" }')
        assert cli.main(["score", str(tmp_path / "out")]) == 1
        other = Results(tmp_path / "out-rescored").cell("other")
        assert other is not None
        assert (other.status, other.num_clips) == ("skipped", 0)


@pytest.mark.usefixtures("toys")
class TestDoor:
    def test_the_version(self, capsys: pytest.CaptureFixture[str]) -> None:
        with pytest.raises(SystemExit) as ended:
            cli.main(["--version"])
        assert ended.value.code == 0
        assert re.fullmatch(r"geovp \d+\.\d+\.\d+\n", capsys.readouterr().out)

    @pytest.mark.parametrize("out", ["file", "file/below", "x" * 300, "/proc/none", "loop"])
    def test_a_folder_that_cannot_be_written_is_one_sentence(
        self, out: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        (tmp_path / "file").touch()
        (tmp_path / "loop").symlink_to(tmp_path / "loop")
        path = tmp_path / "m.toml"
        path.write_text(MATRIX.format(more=""))
        assert cli.main(["run", str(path), "--out", str(tmp_path / out), "--no-report"]) == 2
        said = capsys.readouterr().err.splitlines()
        assert said[-1].startswith("geovp: ")
        assert "Traceback" not in "".join(said)

    def test_the_folder_one_stands_in(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        run(tmp_path)
        monkeypatch.chdir(tmp_path / "out")
        assert cli.main(["score", "."]) == 0
        assert (tmp_path / "out-rescored/protocol.json").exists()


class TestList:
    def test_every_role_and_name_is_there(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["list"]) == 0
        printed = capsys.readouterr().out.splitlines()
        assert [line for line in printed if not line.startswith(" ")] == list(registry.ROLES)
        assert "  copy-last" in printed

    def test_a_plug_in_and_what_it_lacks(self, toys: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["list", "predictors"]) == 0
        printed = capsys.readouterr().out.splitlines()
        assert "  toy-still [geovp-toys]" in printed
        assert "  toy-uninstalled [geovp-toys] (needs package_that_nobody_has)" in printed

    def test_nothing_is_imported_for_it(self, toys: Path) -> None:
        heavy = ("cv2", "torch", "open3d", "scipy", "geovp_toys", "geovp_learned.lpips")
        code = (
            f"import sys; sys.path.insert(0, {str(toys)!r})\n"
            "from geovp_benchmarks import cli; cli.main(['list'])\n"
            f"assert not [name for name in {heavy!r} if name in sys.modules]"
        )
        printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        assert "  toy-still [geovp-toys]" in printed.splitlines()

    def test_without_torch_what_needs_it_is_marked(self, tmp_path: Path) -> None:
        code = (
            "import importlib.util as u; find = u.find_spec\n"
            "u.find_spec = lambda name, *more: None if name == 'torch' else find(name, *more)\n"
            "from geovp_benchmarks import cli; cli.main(['list', 'frame_metrics'])"
        )
        printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        assert "  lpips (needs extra: learned)" in printed.splitlines()
        assert "  psnr" in printed.splitlines()

    def test_an_unknown_role_is_2(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["list", "renderer"]) == 2
        assert capsys.readouterr().err == "geovp: there is no role or component 'renderer': did you mean 'renderers'?\n"


class TestCheck:
    def test_a_sound_component_is_0(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["check", "predictors", "copy-last"]) == 0
        printed = capsys.readouterr().out
        assert "kept    has the methods of its interface" in printed
        assert "copy-last: 0 of " in printed

    def test_a_broken_one_is_1_and_says_what_is_broken(self, toys: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert cli.main(["check", "predictors", "toy-broken"]) == 1
        assert re.search(r"^BROKEN  .*: ZeroDivisionError: the road ended$", capsys.readouterr().out, re.MULTILINE)

    def test_settings_are_written_as_in_toml(self, toys: Path) -> None:
        assert cli.main(["check", "predictors", "toy-broken", "--set", "brightness=256"]) == 0

    @pytest.mark.parametrize(
        ("arguments", "says"),
        [
            (["predictor", "copy-last"], "did you mean 'predictors'?"),
            (["predictors", "copy-lst"], "did you mean 'copy-last'?"),
            (["predictors", "copy-last", "--set", "sed=1"], "no field 'sed'"),
            (["predictors", "copy-last", "--set", "seed"], "is not FIELD=VALUE with a value as in TOML"),
        ],
    )
    def test_a_mistake_is_2(self, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str) -> None:
        assert cli.main(["check", *arguments]) == 2
        assert says in capsys.readouterr().err


def test_help_names_every_verb_and_imports_nothing_heavy() -> None:
    heavy = ("numpy", "cv2", "pyarrow", "matplotlib", "torch", "open3d", "tqdm")
    code = f"""
import sys
from geovp_benchmarks import cli
try:
    cli.main(["--help"])
except SystemExit as end:
    assert end.code == 0
assert not [name for name in {heavy!r} if name in sys.modules]
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ, check=False)
    assert done.returncode == 0, done.stderr
    for verb in cli.VERBS:
        assert re.search(rf"^ +{verb}( |$)", done.stdout, re.MULTILINE)


def test_studies_are_listed_without_being_imported() -> None:
    code = """
import sys
from geovp_benchmarks import cli
try:
    cli.main(["study", "--help"])
except SystemExit as end:
    assert end.code == 0
assert "numpy" not in sys.modules
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for name in ("depth", "dynamic-objects", "odometry"):
        assert re.search(rf"^ +{name}( |$)", done.stdout, re.MULTILINE)


@pytest.mark.parametrize(
    "arguments", [[], ["walk"], ["study"], ["study", "weather"], ["run"], ["run", "x.toml", "--limit", "0"], ["table"]]
)
def test_a_wrong_command_line_is_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(arguments)
    assert end.value.code == 2
    assert "usage: geovp" in capsys.readouterr().err
