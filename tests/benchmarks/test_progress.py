"""Progress is reported after each item, and the bar stays off standard output."""

import time

import pytest

from geovp_benchmarks.progress import announce, progress_bar, tracked


def test_an_item_is_done_when_the_next_is_asked_for() -> None:
    calls: list[tuple[int, int]] = []
    items = tracked(iter("ab"), 2, lambda done, total: calls.append((done, total)))
    assert (next(items), calls) == ("a", [])
    assert (next(items), calls) == ("b", [(1, 2)])
    assert list(items) == []
    assert calls == [(1, 2), (2, 2)]


def test_the_bar_is_there_before_the_first_step_is_done_and_says_what_is_done(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress_bar("letters", "steps") as progress:
        progress(0, 4)
        announce("compiling")
        time.sleep(0.7)
        assert "letters:   0%|" in (shown := capsys.readouterr().err)
        assert "compiling" in shown
        announce("a", done=1)
        announce("b", done=9)  # never more than all
        assert "5/4" not in capsys.readouterr().err
        progress(2, 4)
    assert "2/4" in capsys.readouterr().err
