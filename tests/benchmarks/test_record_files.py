"""Records and kept arrays that are not what a run writes are refused, with the file, the key and
what was expected.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks import kept_files, record_files
from geovp_classic import files
from geovp_classic.errors import BadData

CELL = {
    "label": "x",
    "kind": "predictor",
    "status": "done",
    "grants": ["PAST_POSES"],
    "num_samples": 1,
}
CELL |= {"num_clips": 2, "seconds": {}, "fingerprint": "f", "components": {}}
FRAMES = np.zeros((1, 2, 4, 5, 3), np.uint8)
POSES = np.tile(np.eye(4), (3, 1, 1))
MOTION = {
    "past": POSES,
    "past_times_s": np.arange(3.0),
    "futures": POSES[None, :2],
    "tracked": np.ones(3, bool),
}
MOTION |= {"is_metric": np.array(True)}
CLIP = {"frames": FRAMES[0], "times_s": np.arange(2.0), "intrinsics": np.arange(6.0)}


def cell(folder: Path, **changed: Any) -> dict[str, Any]:
    (folder / "cell.json").write_bytes(files.json_bytes(CELL | changed))
    return dict(record_files.cell(folder / "cell.json").record)


@pytest.mark.parametrize(
    "known",
    [
        {"peak_memory_mb": 3},
        {"peak_memory_mb": 3.5},
        {"peak_is_own": False},
        {"num_failed": 0, "reason": "", "unknown": [1]},
        {"grants": []},
    ],
)
def test_a_cell_may_say_more(known: dict[str, Any], tmp_path: Path) -> None:
    assert cell(tmp_path, **known) == CELL | known


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (
            {"num_samples": True},
            "num_samples is 'True', expected int: restore it, or remove it, run again",
        ),
        ({"num_samples": 1.5}, "num_samples is '1.5', expected int"),
        ({"label": 3}, "label is '3', expected str"),
        ({"grants": "PAST_POSES"}, "grants is 'PAST_POSES', expected a list of texts"),
        ({"grants": ["PAST_POSES", 1]}, "expected a list of texts"),
        ({"seconds": []}, r"seconds is '\[\]', expected dict"),
        ({"peak_memory_mb": "much"}, "peak_memory_mb is 'much', expected a number"),
        ({"peak_memory_mb": True}, "peak_memory_mb is 'True', expected a number"),
        ({"peak_is_own": 1}, "peak_is_own is '1', expected bool"),
        ({"num_clips": "7" * 90}, f"num_clips is '{'7' * 60}', expected int"),
    ],
)
def test_a_value_of_another_kind_is_refused(
    changed: dict[str, Any], says: str, tmp_path: Path
) -> None:
    with pytest.raises(BadData, match=rf"cell\.json: .*{says}"):
        cell(tmp_path, **changed)


def test_what_lacks_is_named_when_it_is_needed(tmp_path: Path) -> None:
    path = tmp_path / "cell.json"
    path.write_bytes(files.json_bytes({key: CELL[key] for key in CELL if key != "kind"}))
    with pytest.raises(
        BadData, match=r"cell\.json has no 'kind': restore it, or remove it and run again"
    ):
        record_files.cell(path)
    protocol = tmp_path / "protocol.json"
    protocol.write_bytes(files.json_bytes({"cells": ["x"]}))
    read = record_files.protocol(
        protocol
    )  # older runs wrote less: what they lack is only missed where it is used
    with pytest.raises(BadData, match=r"protocol\.json has no 'num_past'"):
        read["num_past"]


@pytest.mark.parametrize("name", ["../up", "/root", "a\nb"])
def test_names_that_lead_elsewhere_are_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    path.write_bytes(files.json_bytes({"cells": ["x", name], "datasets": ["near", name]}))
    with pytest.raises(BadData, match=r"file\.json: the cell .*"):
        record_files.protocol(path)
    with pytest.raises(BadData, match=r"file\.json: the data set .*"):
        record_files.labels(path)


def kept(folder: Path, arrays: dict[str, Any], is_clip: bool = False) -> dict[str, Any]:
    np.savez(folder / "a.npz", **arrays)
    kinds, needed = (
        (kept_files.CLIP, tuple(CLIP)) if is_clip else (kept_files.PREDICTION, ("frames",))
    )
    return kept_files.read_arrays(folder / "a.npz", kinds, *needed)


@pytest.mark.parametrize(
    ("more", "is_clip"),
    [
        ({}, False),
        (MOTION | {"covered": FRAMES[..., 0] == 0, "scale_uncertainty": np.array(0.5)}, False),
        (MOTION | {"past_times_s": np.arange(3)}, False),  # whole numbers of seconds are times, too
        ({}, True),
        ({"depths": np.full((2, 4, 5), np.inf, np.float32), "camera_height_m": np.array(2)}, True),
        ({"world_from_cam": POSES[:2], "is_metric": np.array(False)}, True),
    ],
)
def test_what_a_run_keeps_is_read(more: dict[str, Any], is_clip: bool, tmp_path: Path) -> None:
    arrays = (CLIP if is_clip else {"frames": FRAMES}) | more
    assert {name: array.shape for name, array in kept(tmp_path, arrays, is_clip).items()} == {
        name: array.shape for name, array in arrays.items()
    }


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (
            {"frames": FRAMES[0]},
            r"frames is uint8 \(2, 4, 5, 3\), expected u1 with 5 axes, finite: remove it",
        ),
        ({"frames": FRAMES[None]}, "frames is uint8 .*, expected u1 with 5 axes"),
        ({"frames": FRAMES.astype(np.uint16)}, "frames is uint16 .*, expected u1 with 5 axes"),
        ({"frames": FRAMES.astype(float)}, "frames is float64"),
        ({"covered": np.ones((1, 2, 4, 5))}, "covered is float64 .*, expected b with 4 axes"),
        (
            MOTION | {"past": np.full((3, 4, 4), np.nan)},
            "past is float64 .*, expected f with 3 axes, finite",
        ),
        (MOTION | {"tracked": np.ones(3, int)}, "tracked is int64 .*, expected b with 1 axes"),
        (
            {"colour": np.zeros(1)},
            r"colour is float64 \(1,\), expected one of frames, covered, tracked, ",
        ),
        ({"past": POSES}, r"a\.npz holds frames, past and lacks the rest: remove it and run again"),
        ({"is_metric": np.array(True)}, "holds frames, is_metric and lacks the rest"),
        ({name: MOTION[name] for name in MOTION if name != "is_metric"}, "lacks the rest"),
    ],
)
def test_other_arrays_of_a_prediction_are_refused(
    more: dict[str, Any], says: str, tmp_path: Path
) -> None:
    with pytest.raises(BadData, match=says):
        kept(tmp_path, {"frames": FRAMES} | more)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"intrinsics": np.arange(5.0)}, "5 intrinsics, expected 6: remove it and run again"),
        ({"intrinsics": np.arange(7.0)}, "7 intrinsics, expected 6"),
        ({"world_from_cam": POSES[:2]}, "lacks the rest"),
        ({"camera_height_m": np.array(np.inf)}, "camera_height_m is float64 .*finite"),
        ({"times_s": None}, "a.npz holds frames, intrinsics and lacks the rest"),
        (dict.fromkeys(CLIP), "a.npz holds nothing and lacks the rest"),
    ],
)
def test_other_arrays_of_a_clip_are_refused(
    changed: dict[str, Any], says: str, tmp_path: Path
) -> None:
    given = {name: array for name, array in {**CLIP, **changed}.items() if array is not None}
    with pytest.raises(BadData, match=says):
        kept(tmp_path, given, is_clip=True)


def test_what_was_not_kept_is_said_to_be_so(tmp_path: Path) -> None:
    with pytest.raises(
        BadData, match=r"b\.npz does not exist: only the predictions of a few clips are kept"
    ):
        kept_files.read_arrays(tmp_path / "b.npz", kept_files.PREDICTION, "frames")


def test_a_file_is_whole_or_not(tmp_path: Path) -> None:
    kept(tmp_path, {"frames": FRAMES})
    path = tmp_path / "a.npz"
    assert kept_files.is_whole(path)
    path.write_bytes(path.read_bytes()[:-30])
    assert not kept_files.is_whole(path)
