"""`geovp compare A B`: each thing that can differ has its sentence, and nothing else has
one.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from geovp_benchmarks.failure import Failure
from geovp_benchmarks.results.store import Results
from geovp_classic import files
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import STILL, content, go

pytestmark = pytest.mark.usefixtures("toys")


def folder(path: Path, **tables: Any) -> Path:
    go(path, content(**({"predictors": STILL} | tables)))
    return path


Explained = Callable[..., list[str]]  # of two folders or rows


@pytest.fixture
def explained(printed: Says) -> Explained:
    return lambda a, b: printed("compare", a, b).splitlines()


def test_the_same_run_twice_differs_in_nothing(tmp_path: Path, explained: Explained) -> None:
    lines = explained(folder(tmp_path / "a"), folder(tmp_path / "b"))
    assert lines == [
        f"A: {tmp_path / 'a'}",
        f"B: {tmp_path / 'b'}",
        "",
        "still",
        "Nothing differs that is stored.",
        # one step ahead the frame is 1 level brighter, two steps ahead 2
        "toy difference: A 1.5000 on 5 clips, B 1.5000 on 5; A - B on the 5 common clips: "
        "+0 [+0, +0].",
    ]


def test_two_rows_of_one_folder(tmp_path: Path, explained: Explained) -> None:
    sources = {f"at-{step_m:g}": {"name": "toy-steady", "step_m": step_m} for step_m in (1.5, 3.0)}
    made = folder(tmp_path / "a", pose_sources=sources, renderers={"slide": {"name": "toy-slide"}})
    lines = explained(f"{made}:at-1.5 + slide", f"{made}:at-3 + slide")
    assert "at-1.5 + slide (A), at-3 + slide (B)" in lines
    assert [line for line in lines if "component" in line] == [
        "components.pose_source.step_m: 1.5 in A, 3.0 in B."
    ]
    # the camera goes 1 m a step: .5 and 1 m off, against 2 and 4 m
    assert any(
        line.startswith("toy gap: A 0.7500 on 5 clips, B 3.0000 on 5; A - B") for line in lines
    )
    assert any("common clips: -2.25 " in line for line in lines)
    assert not any(line.startswith(("code", "versions")) for line in lines)
    lines = explained(f"{made}:still", f"{made}:at-3 + slide")
    assert 'privileged inputs: [] in A, ["PAST_POSES"] in B.' in lines


def edited(path: Path, **changes: Any) -> None:
    path.write_bytes(files.json_bytes({**json.loads(path.read_text()), **changes}))


def test_versions_weights_code_and_failures_are_told(tmp_path: Path, explained: Explained) -> None:
    a, b = folder(tmp_path / "a"), folder(tmp_path / "b")
    versions = Results(b).protocol()["versions"]
    edited(b / "protocol.json", versions={**versions, "numpy": "0.9"})
    edited(b / "still/method.json", about=["svg weights x"])
    results = Results(b)
    record = results.by_name()["still"].scored["road/000"]
    why = dict.fromkeys(record.clips[::2], Failure("failed", "no light"))
    changed = replace(record, failures=why, code="c0de")
    results.write_scores([(results.scores("still"), changed)])
    lines = explained(a, b)
    assert f'versions.numpy: "{versions["numpy"]}" in A, "0.9" in B.' in lines
    assert 'weights: [] in A, ["svg weights x"] in B.' in lines
    failures = [line for line in lines if line.startswith("failures, scored as copies")]
    assert [line.partition(".")[2] for line in failures] == [
        f'road/{number}: null in A, "no light" in B.' for number in ("000", "002", "004")
    ]
    assert any(
        line.startswith("code: ") and line.endswith(' in A, ["c0de"] in B.') for line in lines
    )


def test_clips_of_one_folder_are_counted(tmp_path: Path, explained: Explained) -> None:
    """Of five clips, two are in both: one line, and no interval of two clips."""
    a, b = folder(tmp_path / "a"), folder(tmp_path / "b")
    shared = Results(a).protocol()
    clips = shared["clips"][:2]
    digests = {clip: shared["digests"][clip] for clip in clips}
    edited(a / "protocol.json", clips=clips, digests=digests)
    lines = explained(a, b)
    assert "clips: 0 in A only, 3 in B only." in lines
    assert not any("nan" in line or line.startswith("digests") for line in lines)
