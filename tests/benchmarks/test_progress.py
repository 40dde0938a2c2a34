"""Progress is reported after each item, and the bar stays off standard output."""

import sys
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


def test_the_bar_says_what_is_done(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress_bar("letters") as progress:
        progress(0, 4)
        time.sleep(0.7)
        announce("compiling", done=1)
        shown = capsys.readouterr().err
        assert "letters:  25%|" in shown
        assert "compiling" in shown
        announce("b", done=9)  # never more than all
        assert "10/4" not in capsys.readouterr().err
        progress(2, 4)
    assert "2/4" in capsys.readouterr().err


def test_redirected_logs_have_no_bar(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("letters") as progress:
        time.sleep(0.6)
        progress(2, 4)
    assert capsys.readouterr().err == ""
