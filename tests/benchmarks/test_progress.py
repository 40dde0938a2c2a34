"""Progress is reported after each item, and the bar stays off standard output."""

import time

import pytest

from geovp_benchmarks.progress import progress_bar, tracked


def test_an_item_is_done_when_the_next_is_asked_for() -> None:
    calls: list[tuple[int, int]] = []
    items = tracked(iter("ab"), 2, lambda done, total: calls.append((done, total)))
    assert (next(items), calls) == ("a", [])
    assert (next(items), calls) == ("b", [(1, 2)])
    assert list(items) == []
    assert calls == [(1, 2), (2, 2)]


def test_the_bar_is_on_standard_error_and_takes_a_new_total(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("letters", "steps") as progress:
        for done, total in ((0, 0), (1, 3), (3, 3), (1, 2)):
            progress(done, total)
        time.sleep(0.6)
        progress(2, 2)
    captured = capsys.readouterr()
    assert not captured.out
    assert "2/2" in captured.err
