"""The command line of the studies."""

import pytest

from studies import main


@pytest.mark.parametrize("words", ["", "weather", "depth many", "depth 0", "depth 1 2 3"])
def test_wrong_arguments_are_bad_input(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(words.split())
    assert end.value.code == 2
    assert "error: " in capsys.readouterr().err
