"""The clips that a report shows: the worst, the best or the usual ones by a score, or those that
are named.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geovp_benchmarks.results.store import Results
from geovp_benchmarks.running.selection import Selection, rank
from geovp_classic.errors import BadData
from tests.benchmarks.conftest import Says
from tests.benchmarks.made import write_matrix, write_protocol, write_row

PSNR = {"role": "frame", "unit": "dB", "higher_is_better": True, "unavailable": None}
ERROR = {"role": "trajectory", "unit": "m", "higher_is_better": False, "unavailable": None}
CLIPS = [f"03/{first:06d}" for first in range(0, 40, 5)]  # of five frames: none overlap


def fill(
    root: Path, rows: Mapping[str, Sequence[float | None]], kinds: dict[str, str], num_past: int = 3
) -> Results:
    """The PSNR of each method's clips, as many metres of error, and none of the last clip where one
    is missing.
    """
    results = Results(root)
    write_protocol(
        results,
        rows,
        CLIPS,
        metrics={"psnr": PSNR, "error": ERROR},
        num_past=num_past,
        num_future=2,
        stride=5,
    )
    for name, scores in rows.items():
        lines = [
            (clip, 0, 1, metric, score)
            for clip, score in zip(CLIPS, scores, strict=False)
            for metric in ("psnr", "error")
        ]
        write_row(
            results,
            name,
            lines,
            kind=kinds[name],
            status="done" if len(scores) == len(CLIPS) else "partial",
        )
    return results


SCORES_OF: dict[str, list[float | None]] = {
    "half--r": [1.0],
    "copy": [9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0],
    "a--r": [20.0, 11.0, 25.0, 12.0, 18.0, 30.0, 17.0, None],
}
KINDS = {"half--r": "geometric", "copy": "predictor", "a--r": "geometric"}


def numbers(selection: Selection) -> list[int]:
    return [CLIPS.index(clip) for clip in selection.clips]


@pytest.mark.parametrize(
    ("ranking", "expected"),
    [
        ("worst:psnr", [1, 3, 6]),  # 11, 12 and 17 dB of the first complete row with a pose source
        ("best:psnr", [5, 2, 0]),
        ("worst:error", [5, 2, 0]),  # an error is worst where it is largest
    ],
)
def test_clips_are_chosen_by_their_scores(
    tmp_path: Path, ranking: str, expected: list[int]
) -> None:
    assert numbers(rank(ranking, fill(tmp_path, SCORES_OF, KINDS))) == expected


@pytest.mark.parametrize(
    ("num_past", "expected"),
    [
        (4, [1, 3, 6]),  # of 4 + 2 frames, five apart: neighbours share one frame
        (3, [1, 2, 3]),
        (38, [1, 2, 3]),  # all share some: better three that do than one
    ],
)
def test_clips_that_share_frames_are_one_example(
    tmp_path: Path, num_past: int, expected: list[int]
) -> None:
    crowded = {"a--r": [20.0, 11.0, 12.0, 13.0, 18.0, 30.0, 17.0, 40.0]}
    assert numbers(rank("worst:psnr", fill(tmp_path, crowded, KINDS, num_past))) == expected


def test_no_complete_row_is_one_sentence(tmp_path: Path) -> None:
    results = fill(tmp_path, {"half--r": [1.0]}, KINDS)
    with pytest.raises(BadData, match="--keep worst:psnr: no method is complete"):
        rank("worst:psnr", results)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    protocol = {"num_past": 3, "num_future": 2, "size_px": [48, 48], "stride": 10}
    tables: dict[str, Any] = {
        "protocol": {"dataset": {"name": "synthetic", "num_clips": 4}, **protocol}
    }
    tables |= {"pose_sources": {"still": "stand-still"}, "renderers": {"far": "ground-far-plane"}}
    tables |= {"predictors": {"copy-last": "copy-last"}}
    return write_matrix(
        tmp_path / "m.toml",
        {**tables, "metrics": {"frame": ["psnr"], "trajectory": ["translation-error"]}},
    )


def run(file: Path, keep: str, *more: str) -> list[object]:
    return ["run", file, "--out", file.parent / "out", "--keep", keep, *more]


def test_the_report_shows_the_worst_clips_and_says_by_what(file: Path, printed: Says) -> None:
    printed(*run(file, "worst:psnr"))
    results = Results(file.parent / "out")
    means = results.means("still--far")["psnr"].mean(axis=1)
    worst = [results.protocol()["clips"][number] for number in means.argsort()[:3]]
    assert results.protocol()["kept"] == {"by": "worst PSNR of still + far", "clips": worst}
    for method in ("still--far", "copy-last"):  # all rows, not only the one that chose
        assert set(results.predictions(method)) == set(worst)
        assert np.isfinite(results.means(method)["psnr"]).sum() == 4
    page = (file.parent / "out" / "report.html").read_text(encoding="utf-8")
    assert "Clips were kept as worst PSNR of still + far." in page
    assert set(re.findall(r"<h3>(seed[^<]*)</h3>", page)) == set(worst)
