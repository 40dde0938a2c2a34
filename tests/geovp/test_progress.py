"""Progress is reported after each item, and the bar stays off standard output."""

import logging
import sys
import time

import pytest

from geovp.progress import announce, progress_bar, report, tracked


def test_an_item_is_done_when_the_next_is_asked_for(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, "geovp.steps")
    items = tracked("ab")
    assert (next(items), caplog.messages) == ("a", [])
    assert (next(items), caplog.messages) == ("b", ["1 of 2"])
    assert list(items) == []
    assert caplog.messages == ["1 of 2", "2 of 2"]


def test_the_bar_says_what_is_done(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress_bar("letters"):
        report(0, 4)
        time.sleep(0.7)
        announce("compiling", done=1)
        shown = capsys.readouterr().err
        assert "letters:  25%|" in shown
        assert "compiling" in shown
        announce("b", done=9)  # never more than all
        assert "10/4" not in capsys.readouterr().err
        report(2, 4)
    assert "2/4" in capsys.readouterr().err


def test_redirected_logs_have_a_line_at_intervals(caplog: pytest.LogCaptureFixture) -> None:
    with progress_bar("letters", log_interval_s=0.2):
        report(1, 4)
        time.sleep(0.3)
        report(2, 4)
        report(3, 4)
    lines = [line for line in caplog.messages if line.startswith("letters")]
    assert lines == ["letters: 2 of 4"]
