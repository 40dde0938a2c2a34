"""`geovp metrics explain A B`: each thing that can differ has its sentence, and nothing else has
one.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from geovp_benchmarks.results.store import Results
from geovp_classic import files
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import STILL, content, go

pytestmark = pytest.mark.usefixtures("toys")


def folder(
    path: Path,
    dataset: dict[str, Any] | None = None,
    protocol: dict[str, Any] | None = None,
    **tables: Any,
) -> Path:
    made = content(dataset, **({"predictors": STILL} | tables))
    made["protocol"] |= protocol or {}
    go(path, made)
    return path


Explained = Callable[..., list[str]]  # of two folders or rows


@pytest.fixture
def explained(printed: Says) -> Explained:
    return lambda a, b: printed("metrics", "explain", a, b).splitlines()


def test_the_same_run_twice_differs_in_nothing(tmp_path: Path, explained: Explained) -> None:
    lines = explained(folder(tmp_path / "a"), folder(tmp_path / "b"))
    assert lines == [
        f"A: {tmp_path / 'a'}",
        f"B: {tmp_path / 'b'}",
        "",
        "still",
        "Nothing differs that is stored.",
        # one step ahead the frame is 1 level brighter, two steps ahead 2
        "toy difference: identical, 1.5000 on 5 clips.",
    ]


def test_clips_frames_and_split_are_told(tmp_path: Path, explained: Explained) -> None:
    a = folder(tmp_path / "a", {"clips": 3})
    b = folder(tmp_path / "b", {"clips": 4}, {"num_future": 4, "size_px": [8, 16]})
    lines = explained(a, b)
    assert lines[2].startswith("Protocol ids: ")
    assert "Data set: clips: 3 in A, 4 in B." in lines
    assert "Clips: A has 3, B 4, 3 in common; only in B: road/003." in lines
    assert "Protocol: frames predicted: 2 in A, 4 in B." in lines
    assert "Protocol: width and height in pixels: [8, 8] in A, [8, 16] in B." in lines
    # levels 1, 2 against 1, 2, 3, 4: means 1.5 and 2.5
    (scores,) = (line for line in lines if line.startswith("toy difference"))
    assert scores.startswith(
        "toy difference: A 1.5000 on 3 clips, B 2.5000 on 4 clips; A - B on the 3 common clips: -1"
    )


def test_two_rows_of_one_folder(tmp_path: Path, explained: Explained) -> None:
    sources = {f"at-{step_m:g}": {"name": "toy-steady", "step_m": step_m} for step_m in (1.5, 3.0)}
    made = folder(tmp_path / "a", pose_sources=sources, renderers={"slide": {"name": "toy-slide"}})
    lines = explained(f"{made}:at-1.5 + slide", f"{made}:at-3--slide")
    assert "at-1.5 + slide (A), at-3 + slide (B)" in lines
    assert [line for line in lines if line.startswith("Component")] == [
        "Component: pose_source.step_m: 1.5 in A, 3.0 in B."
    ]
    # the camera goes 1 m a step: .5 and 1 m off, against 2 and 4 m
    assert any(
        line.startswith("toy gap: A 0.7500 on 5 clips, B 3.0000 on 5 clips; A - B")
        for line in lines
    )
    assert any("common clips: -2.2500" in line for line in lines)
    assert not any(line.startswith(("Protocol", "Code", "Library")) for line in lines)
    lines = explained(f"{made}:still", f"{made}:at-3 + slide")
    assert 'Method: privileged inputs: nothing in A, ["PAST_POSES"] in B.' in lines


def edited(path: Path, **changes: Any) -> None:
    path.write_bytes(files.json_bytes({**json.loads(path.read_text()), **changes}))


def test_definitions_versions_and_weights_are_told(tmp_path: Path, explained: Explained) -> None:
    a, b = folder(tmp_path / "a"), folder(tmp_path / "b")
    shared = Results(b).protocol()
    shared["metrics"]["toy-difference"]["definition"] = "of squares"
    edited(
        b / "protocol.json",
        metrics=shared["metrics"],
        versions={**shared["versions"], "numpy": "0.9"},
    )
    edited(b / "still/method.json", about=["svg weights x"])
    lines = explained(a, b)
    assert any(
        line.endswith("in A, of squares in B.")
        for line in lines
        if "toy-difference: definition:" in line
    )
    assert (
        f"Library versions: numpy: {Results(a).protocol()['versions']['numpy']} in A, 0.9 in B."
        in lines
    )
    assert "Weights: svg weights x: nothing in A, used in B." in lines


def test_clips_that_one_row_could_not_predict_and_other_code(
    tmp_path: Path, explained: Explained
) -> None:
    a, b = folder(tmp_path / "a"), folder(tmp_path / "b")
    results = Results(b)
    for part in results.parts("still"):
        rows = results.scores("still").of_clips(part.clips)
        why = dict.fromkeys(part.clips[::2], ("failed", "no light", ""))
        results.write_part(
            "still", rows, type(part)(**{**vars(part), "failures": why, "code": "c0de"})
        )
    lines = explained(a, b)
    said = (
        "Only B could not predict road/000, road/002, road/004, scored as copies of the last "
        "frame: no light."
    )
    assert said in lines
    assert any(
        line.startswith("Code: version: ") and line.endswith(" in A, c0de in B.") for line in lines
    )
