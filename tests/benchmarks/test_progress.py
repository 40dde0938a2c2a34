"""Progress is reported after each item, and the bar stays off standard output."""

import pytest

from benchmarks.progress import Bar, tracked


def test_an_item_is_done_when_the_next_is_asked_for() -> None:
    calls: list[tuple[int, int]] = []
    items = tracked(iter("ab"), 2, lambda done, total: calls.append((done, total)))
    assert (next(items), calls) == ("a", [])
    assert (next(items), calls) == ("b", [(1, 2)])
    assert list(items) == []
    assert calls == [(1, 2), (2, 2)]


def test_the_bar_is_on_standard_error_and_takes_a_new_total(capsys: pytest.CaptureFixture[str]) -> None:
    with Bar("letters", "steps") as bar:
        bar.show(0, 0)
        for done, total in ((1, 3), (3, 3), (1, 2), (2, 2)):
            bar.show(done, total)
        assert (bar._bar.n, bar._bar.total) == (2, 2)
    assert not capsys.readouterr().out
