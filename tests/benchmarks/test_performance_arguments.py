"""Wrong arguments of the performance scripts end with a message and exit code 2."""

from collections.abc import Callable, Sequence

import pytest

from performance import __main__ as page
from performance import clip, scoring, splat


@pytest.mark.parametrize(
    ("main", "arguments", "message"),
    [
        (clip.main, ["often"], "argument ROUNDS: invalid"),
        (clip.main, ["3", "--kitti", "root"], "argument --kitti: expected 2 arguments"),
        (splat.main, ["often"], "argument ROUNDS: invalid"),
        (splat.main, ["0"], "0 is not a whole number of 1 or more"),
        (clip.main, ["0"], "0 is not a whole number of 1 or more"),
        (scoring.main, ["0"], "0 is not a whole number of 1 or more"),
        (page.main, ["2", "--kitti", "root"], "argument --kitti: expected 2 arguments"),
    ],
)
def test_wrong_arguments_end_with_exit_code_2(
    main: Callable[[Sequence[str]], None],
    arguments: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    captured = capsys.readouterr()
    assert message in captured.err
    assert not captured.out
