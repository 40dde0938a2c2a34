"""The page of splits shows the ranges that the package has."""

import re
from pathlib import Path

import pytest

from geovp_classic.data.recordings import splits

PAGE = (Path(__file__).resolve().parents[1] / "docs/concepts/splits.md").read_text()
ROWS = dict(re.findall(r"^\| `([a-z0-9-]+)` \| (.*)", PAGE, re.MULTILINE))


@pytest.mark.parametrize("name", splits.names())
def test_ranges_and_their_number_are_those_of_the_split(name: str) -> None:
    ranges, number, _ = ROWS[name].split(" | ")
    expected = splits.load(name)
    assert re.findall("`(.*?)`", ranges) == [str(each) for each in expected]
    lengths = [each.last - each.first for each in expected if each.last is not None]
    assert int(number.replace(",", "")) == (sum(lengths) if lengths else len(expected))


def test_the_sample_splits_are_disjoint() -> None:
    names = ("train", "val", "test", "test-colour")
    frames = [
        (each.sequence, frame)
        for name in names
        for each in splits.load(name)
        for frame in range(each.first, each.last)
    ]
    assert len(frames) == len(set(frames)) == 1537 + 305 + 231 + 261
