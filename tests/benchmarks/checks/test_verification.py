"""Stored results are computed again and compared: what reproduces, what was changed, what was never
the same twice.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from geovp_benchmarks.results.store import Results
from tests.benchmarks.conftest import Command, Says
from tests.benchmarks.made import content, crossed, dicts, go, scores

ALL = ["--pairs", "99"]


Verified = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def verified(command: Command) -> Verified:
    """A function that verifies a folder; the exit code and the lines."""

    def run(*words: object) -> tuple[int, list[str]]:
        ended = command("verify", *words)
        return ended.code, ended.out.splitlines()

    return run


def shift(root: Path, method: str, clip: str, metric: str, by: float) -> None:
    """Change one stored value by hand."""
    results = Results(root)
    record = results.by_name()[method].scored[clip]
    lines = [row for row in dicts(results.scores(method)) if row["clip"] in record.clips]
    changed = next(
        row for row in lines if (row["clip"], row["metric"], row["step"]) == (clip, metric, 2)
    )
    changed["value"] += by
    results.write_scores([(scores([*row.values()] for row in lines), record)])


@pytest.mark.usefixtures("toys")
class TestReproduction:
    def test_all_of_it_is_identical_and_nothing_is_written(
        self, tmp_path: Path, verified: Verified
    ) -> None:
        root = tmp_path / "out"
        go(root, content(predictors={"still": "toy-still"}, **crossed(tmp_path / "log")))
        before = {path: path.stat().st_mtime_ns for path in root.rglob("*")}
        code, lines = verified(root, *ALL)
        assert (code, lines[-1]) == (
            0,
            "25 of 25 reproduce",
        )  # two sources with two renderers and still, five clips
        assert "a + r, road/000: identical" in lines
        assert {path: path.stat().st_mtime_ns for path in root.rglob("*")} == before

    def test_a_changed_row_is_found_and_how_far_it_is_off(
        self, tmp_path: Path, verified: Verified
    ) -> None:
        go(tmp_path, content(predictors={"still": "toy-still", "noise": "toy-noise"}))
        shift(tmp_path, "still", "road/003", "toy-difference", 0.25)
        shift(tmp_path, "still", "road/004", "toy-difference", 1e-6)  # no table prints that
        code, lines = verified(tmp_path, *ALL)
        assert (code, lines[-1]) == (1, "9 of 10 reproduce")
        assert [line for line in lines if "differs" in line] == [
            "still, road/003: differs: toy-difference 0.25 grey levels"
        ]
        assert "still, road/004: within the tolerance: toy-difference 1e-06 grey levels" in lines
        assert verified(tmp_path, *ALL, "--tolerance", "0")[1][-1] == "8 of 10 reproduce"
        assert verified(tmp_path, *ALL, "--tolerance", "0.2")[0] == 1
        code, lines = verified(tmp_path, *ALL, "--tolerance", "0.3")
        assert (code, lines[3]) == (
            0,
            "still, road/003: within the tolerance: toy-difference 0.25 grey levels",
        )

    def test_what_is_never_the_same_twice_is_named(
        self, tmp_path: Path, verified: Verified
    ) -> None:
        dice = {"name": "toy-noise", "seed": "none"}
        go(tmp_path, content({"clips": 1}, predictors={"dice": dice, "still": "toy-still"}))
        code, (line, still, last) = verified(tmp_path)
        assert (code, still, last) == (1, "still, road/000: identical", "1 of 2 reproduce")
        assert line.startswith("dice, road/000: differs: toy-difference ")
        assert line.endswith(
            " grey levels; not deterministic: two computations here differ as well"
        )

    def test_a_metric_that_is_unavailable_here_is_named_and_fails(
        self, tmp_path: Path, verified: Verified
    ) -> None:
        weights = tmp_path / "weights"
        weights.touch()
        lpips = {"name": "toy-weightless", "weights": str(weights)}
        metrics = {"frame": ["toy-difference", lpips], "trajectory": []}
        go(tmp_path / "out", content({"clips": 1}, metrics, predictors={"still": "toy-still"}))
        weights.unlink()
        code, lines = verified(tmp_path / "out")
        assert code == 1
        assert lines == [
            "still, road/000: identical; toy-weightless cannot be compared",
            "toy-weightless cannot be compared: weights of toy-weightless are not here: fetch them",
            "1 of 1 reproduce in the other metrics",
        ]


def test_another_root_is_read_and_a_missing_one_is_bad_input(
    street: Path, tmp_path: Path, verified: Verified, refused: Says
) -> None:
    tables = content(
        {"name": "kitti", "root": str(street), "sequences": ["07"]}, {"frame": ["psnr"]}
    )
    go(tmp_path, {**tables, "predictors": {"copy-last": "copy-last"}}, limit=2)
    elsewhere = tmp_path / "link"
    elsewhere.symlink_to(street)
    assert verified(tmp_path, "--root", str(elsewhere))[0] == 0
    assert "nowhere" in refused("verify", tmp_path, "--root", tmp_path / "nowhere")
