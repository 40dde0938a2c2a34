"""The clips whose predictions are kept: a number of them, all, or those that are named."""

import pytest

from geovp_benchmarks.running.plan import select
from geovp_classic.errors import BadData

CLIPS = [f"03/{first:06d}" for first in range(0, 40, 5)]


@pytest.mark.parametrize(
    ("keep", "expected"),
    [
        ("0", []),
        ("1", [4]),  # the middle one
        ("3", [0, 4, 7]),  # 3.5 rounds to the even number
        ("99", range(8)),
        ("all", range(8)),
        ("03/000030,03/000005", [6, 1]),
    ],
)
def test_clips_are_kept_by_number_or_name(keep: str, expected: list[int]) -> None:
    assert select(keep, CLIPS) == {CLIPS[number] for number in expected}


@pytest.mark.parametrize("keep", ["some", "03/000005,04/000000"])
def test_other_words_are_one_sentence(keep: str) -> None:
    with pytest.raises(BadData, match=r"is not among 03/000000 to 03/000035$"):
        select(keep, CLIPS)
